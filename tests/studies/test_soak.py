"""A short soak, and the measures of the long one on made-up samples."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from studies.speed.soak import ALLOWED_GROWTH_MIB, LEAST_SAMPLES, MemoryWatch, random_faults

from iptm.faults.kinds import FaultKind


@pytest.mark.integration
@pytest.mark.slow
def test_no_tick_of_a_trip_with_random_faults_is_lost_without_a_report() -> None:
    command = (sys.executable, "-m", "studies.speed.soak", "--ticks", "120", "--every-s", "12")
    done = subprocess.run(command, capture_output=True, text=True, timeout=300.0, check=False)
    assert done.returncode == 0, done.stderr
    numbers = json.loads(done.stdout[done.stdout.index("{") :])
    assert numbers["ended"] == "finished"
    assert numbers["faults"] == len(random_faults(120.0, 12.0, seed=1)) >= 8
    assert numbers["states_heard"] == 121
    assert numbers["unanswered_without_report"] == 0


def test_a_process_that_grows_with_the_trip_is_seen() -> None:
    """What it takes at its start does not count, nor does a process that has not lived for long."""
    ticks = 1000
    watch = MemoryWatch(ticks)
    for time_s in np.linspace(0.0, ticks, 101):
        start_mib = 80.0 + min(time_s, 50.0)
        watch.samples["steady"].append((time_s, start_mib))
        watch.samples["leaking"].append((time_s, start_mib + 0.01 * time_s))
    watch.samples["restarted"] = [(900.0, 10.0), (1000.0, 90.0)]
    watch.samples["sampled rarely"] = [
        (at, at) for at in np.linspace(0.0, ticks, LEAST_SAMPLES - 1)
    ]
    grown = watch.growth_mib()
    assert set(grown) == {"steady", "leaking"}
    assert grown["steady"] == 0.0
    assert grown["leaking"] == pytest.approx(8.0, abs=0.2)
    assert grown["leaking"] > ALLOWED_GROWTH_MIB


def test_random_faults_are_of_every_kind_that_ends_no_trip_and_the_same_for_a_seed() -> None:
    faults = random_faults(100_000.0, 100.0, seed=1)
    assert faults == random_faults(100_000.0, 100.0, seed=1)
    ends = {FaultKind.PROCESS_KILLED, FaultKind.DISK_FULL, FaultKind.SOLVER_EXCEPTION}
    assert {fault.kind for fault in faults} == set(FaultKind) - ends
