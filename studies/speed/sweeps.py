"""What sweeps and first trips cost: runs with other cars, workers, and the compiler on an empty cache.

python -m studies.speed.sweeps
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np
from studies.speed.harness import machine_in_words, run_benchmark

import iptm

FIRST_TRIP = "import iptm; iptm.simulate('us06', duration_s=10.0)"
SWEPT = {
    "body.mass_kg": (1200.0, 2400.0),
    "body.drag_coefficient": (0.2, 0.4),
    "cell.nominal_resistance_ohm": (0.002, 0.006),
    "gap.max_gap_m": (90.0, 190.0),
}
"""Ranges of the parameters that are swept."""


def sweeps(runs: int = 200, duration_s: float = 60.0, turns: int = 3) -> dict[str, Any]:
    """Time sweeps over parameters of the vehicle, and first trips.

    Args:
        runs: values of a parameter in a sweep in this process.
        duration_s: length of a run.
        turns: repetitions of first trips, and of sweeps with one and with two workers in turn.
    """
    iptm.simulate("us06", duration_s=duration_s)
    resident, run_s = [_resident_mb()], {}
    for key, ends in SWEPT.items():
        began_s = time.process_time()
        iptm.sweep(cycle="us06", duration_s=duration_s, overrides={key: np.linspace(*ends, runs)})
        run_s[key] = (time.process_time() - began_s) / runs
        resident.append(_resident_mb())
    walls_s = {
        workers: min(_sweep_s(workers, duration_s, turn) for turn in range(turns))
        for workers in (1, 2)
    }
    return {
        "machine": machine_in_words(),
        "processor time of a run with another value, s": run_s,
        "resident memory at the start and after each sweep, MB": resident,
        "two workers against one, ratio of the shortest wall times": walls_s[1] / walls_s[2],
        "first trip on an empty cache, wall s": [_first_trip_s() for _ in range(turns)],
    }


def _resident_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _sweep_s(workers: int, duration_s: float, turn: int) -> float:
    began_s = time.monotonic()
    masses_kg = (np.linspace(1200.0, 2400.0, 400) + 0.1 * (2 * turn + workers)).tolist()
    iptm.sweep(
        cycle="us06", duration_s=duration_s, overrides={"body.mass_kg": masses_kg}, workers=workers
    )
    return time.monotonic() - began_s


def _first_trip_s() -> float:
    """Return the wall time of a process that drives 10 s on an empty compiler cache."""
    with tempfile.TemporaryDirectory() as empty:
        began_s = time.monotonic()
        environment = {**os.environ, "IPTM_CACHE_DIR": empty}
        command = [sys.executable, "-c", FIRST_TRIP]
        subprocess.run(command, env=environment, check=True)  # noqa: S603 - this interpreter
        return time.monotonic() - began_s


if __name__ == "__main__":
    sys.exit(run_benchmark(sweeps))
