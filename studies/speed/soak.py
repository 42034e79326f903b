"""A long trip over ROS 2 with random faults: memory of every process, and ticks lost without a report.

    python -m studies.speed.soak --ticks 100000

A driving cycle is repeated until there are ticks enough, in lock-step and recorded. Random faults of topics,
clock, stamps, solver and processes come and go. Every process is measured while the trip lasts.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from studies.speed.harness import run_benchmark

import iptm
from iptm.parts import (
    NS_PER_S,
    Fault,
    FaultKind,
    FaultPlace,
    ScenarioError,
    StopRequest,
    in_order,
    load_cycle,
)
from iptm.runner.drive import Drive, DriveOutcome
from iptm.runner.monitor import Snapshot
from iptm.runner.progress import Progress
from iptm.runner.run_folder import RunFolder
from iptm.runner.runner import RunOptions, check_over_ros, drive_processes
from iptm.runner.supervisor import domain_of_run
from iptm.trip_settings import AUTOMATIC_DOMAIN
from iptm_ros.codecs import stamp_ns_of
from iptm_ros.diagnostics import Level
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.topics import Topic

WARM_UP_SHARE = 0.1
"""Share of the trip after which memory counts: caches and the first plans are filled by then."""
ALLOWED_GROWTH_MIB = 5.0
REPORT_WITHIN_S = 10.0
LEAST_SAMPLES = 30
"""Smallest number of memory samples of a process, one a second, for an estimate of its growth."""
# Each of these ends or restarts a trip, or the recorder, on purpose.
_ENDS = (FaultKind.PROCESS_KILLED, FaultKind.DISK_FULL, FaultKind.SOLVER_EXCEPTION)


class MemoryWatch(Progress):
    """Samples the memory of the processes of a run of a number of ticks.

    Attributes:
        samples: trip time and resident memory in MiB, by process name and number.
    """

    def __init__(self, ticks: int) -> None:
        self.ticks = ticks
        self.samples: dict[str, list[tuple[float, float]]] = defaultdict(list)
        self._sampled_s = 0.0
        self._shown = -1

    def running(self, snapshot: Snapshot, wall_s: float) -> None:
        """Take a sample once a second, and show every twentieth of the trip."""
        now_s = time.monotonic()
        if now_s - self._sampled_s >= 1.0:
            self._sampled_s = now_s
            for name, resident_mib in children_mib():
                self.samples[name].append((snapshot.time_s, resident_mib))
        twentieth = int(20 * snapshot.time_s / self.ticks)
        if twentieth > self._shown:
            self._shown = twentieth
            rate = snapshot.time_s / wall_s if wall_s else 0.0
            print(f"{snapshot.time_s:.0f} of {self.ticks} ticks, {rate:.0f} a second", flush=True)

    def growth_mib(self) -> dict[str, float]:
        """Return the growth after its warm-up of each process that lived long enough."""
        grown = {}
        for name, samples in self.samples.items():
            times_s, resident_mib = np.array(samples).T
            lived_s = times_s[-1] - times_s[0]
            if lived_s < 0.2 * self.ticks or len(samples) < LEAST_SAMPLES:
                continue
            share = (times_s - times_s[0]) / lived_s
            early = (share >= WARM_UP_SHARE) & (share <= 2.0 * WARM_UP_SHARE)
            late = share >= 1.0 - WARM_UP_SHARE
            grown[name] = float(np.median(resident_mib[late]) - np.median(resident_mib[early]))
        return grown


def children_mib() -> Iterator[tuple[str, float]]:
    """Yield module and process id, and resident memory in MiB, of the Python children of this process."""
    for task in Path("/proc/self/task").iterdir():
        for pid in (task / "children").read_text().split():
            try:
                words = Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
                pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
            except OSError:
                continue  # it has just ended
            if "-m" in words:
                module = words[words.index("-m") + 1]
                yield f"{module} {pid}", pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def random_faults(duration_s: float, every_s: float, seed: int) -> tuple[Fault, ...]:
    """Return one random fault every so often, of all kinds that do not end a trip."""
    random = np.random.default_rng(seed)
    kinds = [kind for kind in FaultKind if kind not in _ENDS]
    targets = ("v2x_bridge", "controller")
    faults = []
    for start_s in np.arange(every_s, duration_s - every_s, every_s).tolist():
        kind = kinds[int(random.integers(len(kinds)))]
        of_process = kind.spec.place is FaultPlace.PROCESS
        faults.append(
            Fault(
                kind,
                start_s + float(random.integers(int(every_s / 4.0))),
                float(random.integers(1, 6)),
                1.0 if random.random() < 0.5 else 0.5,
                seed=int(random.integers(1000)),
                size=2.0 if kind is FaultKind.PROCESS_FROZEN else None,
                target=targets[int(random.integers(len(targets)))] if of_process else "",
            )
        )
    return in_order(faults)


def long_cycle(name: str, ticks: int, folder: Path) -> Path:
    """Write a driving cycle, repeated, as a CSV file of the given length; return its path."""
    speeds = np.resize(load_cycle(name).speeds_m_s[:-1], ticks)
    path = folder / "soak.csv"
    rows = (f"{second},{speed!r}" for second, speed in enumerate([*speeds.tolist(), 0.0]))
    path.write_text("time_s,speed_m_s\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def measure(
    ticks: int = 100_000, every_s: float = 100.0, seed: int = 1, cycle: str = "nycc"
) -> dict[str, Any]:
    """Drive a long trip with random faults.

    Args:
        ticks: length of the trip in s.
        every_s: trip time from one fault to the next.
        seed: of the faults.
        cycle: what is repeated; one that begins and ends at standstill.

    Returns:
        Growth of memory by process, ticks, ticks without answer and report, and how it ended.

    Raises:
        ScenarioError: too few ticks; memory grew, a tick was lost without a report, or the trip ended early.
    """
    if ticks < 10 * every_s:
        raise ScenarioError(f"ticks is {ticks}; allowed: at least {10 * every_s:g}, ten faults")
    stop, watch = StopRequest(), MemoryWatch(ticks)
    stop.install()
    faults = random_faults(float(ticks), every_s, seed)
    with tempfile.TemporaryDirectory(prefix="soak_") as text:
        folder = Path(text)
        trip = iptm.Trip.of(
            long_cycle(cycle, ticks, folder),
            name="soak",
            slope="flat",
            input_timeout_s=0.3,
            faults=faults,
        )
        run_folder, options = RunFolder(folder / "run"), RunOptions(picture=False)
        with domain_of_run(AUTOMATIC_DOMAIN, environment={}) as domain:
            result, drive = drive_processes(
                run_folder, check_over_ros(trip), options, domain, watch, stop
            )
        found = _ticks_of(drive, run_folder.output)
    numbers = {
        "ticks": ticks,
        "ended": result.message or result.outcome.value,
        "faults": len(faults),
        "process_faults": len(drive.process_faults.records),
        "growth_mib": {name: round(grown, 2) for name, grown in watch.growth_mib().items()},
        **found,
    }
    _refuse_what_did_not_hold(numbers)
    return numbers


def _refuse_what_did_not_hold(numbers: dict[str, Any]) -> None:
    """Raise an error with all numbers if the trip was not as it should be."""
    problems = [
        f"{name} grew by {grown} MiB; allowed: {ALLOWED_GROWTH_MIB:g} MiB"
        for name, grown in numbers["growth_mib"].items()
        if grown > ALLOWED_GROWTH_MIB
    ]
    problems += [
        f"{key} is {numbers[key]}; allowed: 0"
        for key in ("states_missing", "states_not_in_bag", "unanswered_without_report")
        if numbers[key]
    ]
    if numbers["ended"] != DriveOutcome.FINISHED.value:
        problems.append(f"the trip ended early: {numbers['ended']}")
    if problems:
        raise ScenarioError(f"{'; '.join(problems)}\n{json.dumps(numbers, indent=1)}")


def _ticks_of(drive: Drive, bag: Path) -> dict[str, Any]:
    """Return what became of the ticks, from what the runner heard and from the bag."""
    heard = drive.monitor.recorded
    states = {stamp_ns_of(data) for data in heard[Topic.PLANT_STATE]}
    answered = {stamp_ns_of(data) for data in heard[Topic.SOLVE]}
    reports = drive.monitor.reports
    bad = [each for each in reports if each.status.level != Level.OK.value]
    reported = np.array([each.about_ns for each in bad])
    last_ns = max(states)
    unanswered = sorted(states - answered - {last_ns})
    silent = [
        stamp_ns
        for stamp_ns in unanswered
        if not np.any(np.abs(reported - stamp_ns) <= REPORT_WITHIN_S * NS_PER_S)
    ]
    with BagReader(bag) as reader:
        recorded = reader.topics["/plant/odometry"].message_count
    return {
        "states_heard": len(states),
        "states_missing": len(set(range(0, last_ns + 1, NS_PER_S)) - states),
        "states_not_in_bag": max(len(states) - recorded, 0),
        "unanswered": len(unanswered),
        "unanswered_without_report": len(silent),
    }


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
