"""Trials driven without ROS and over it, and what was observed, in the same form."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

from iptm.driving import drive_in_memory
from iptm.faults.fault import WHOLE_TRIP_S, Fault, in_order
from iptm.faults.kinds import FaultKind, FaultPlace
from iptm.faults.signals import Traffic
from iptm.run import Run
from iptm.runner.drive import DriveResult, NodeDrive
from iptm.runner.monitor import heard_by_stamp
from iptm.runner.progress import Progress
from iptm.runner.run_folder import RunFolder
from iptm.runner.runner import RunOptions, check_over_ros, drive_processes
from iptm.runner.supervisor import domain_of_run
from iptm.trip import Trip
from iptm.trip_files import trip_text
from iptm.trip_settings import AUTOMATIC_DOMAIN
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.node_reports import (
    BREAKS,
    CONCERNS,
    LIMITS,
    WEAK_BRAKES,
    OperatorWatch,
    situation,
)
from iptm_core.declaration import TextEnum
from iptm_core.program import StopRequest
from iptm_core.settings import LoopMode
from iptm_core.state import NS_PER_S
from iptm_ros.assembly import assemble_decisions, assemble_run, split_trips
from iptm_ros.codecs import (
    decode_observation,
    encode_leader,
    s_from_ns,
    stamp_ns_of,
)
from iptm_ros.diagnostics import Level as Level  # noqa: PLC0414  for studies
from iptm_ros.stamp_gate import LEAST_REACH_NS
from iptm_ros.topics import CONTROLLER, PLANT, TICK_TOPICS, Topic

REAL_TIME_RATE = 10.0
"""Trip seconds per wall-clock second in real-time mode, and in lock-step where a process is hit."""


class DriveMode(TextEnum):
    """How a trip is driven."""

    HEADLESS = "headless"
    LOCK_STEP = "lock_step"
    REAL_TIME = "real_time"


@dataclass(frozen=True, eq=False)
class Trial:
    """A trip with faults in sequence.

    Attributes:
        mode: how it is driven.
        placed: faults in the order of their beginning.
        inputs: trip and vehicle; without the faults where it is driven over ROS 2.
    """

    mode: DriveMode
    placed: tuple[Fault, ...]
    inputs: Trip

    @property
    def cycle(self) -> str:
        """What the leader drives."""
        return self.inputs.road.cycle

    @property
    def faults(self) -> tuple[Fault, ...]:
        """All faults of the trial."""
        return in_order(self.placed)

    @property
    def name(self) -> str:
        """Name for files and progress: mode, cycle, the first fault and the number of others."""
        if not self.placed:
            return f"{self.mode}_{self.cycle}"
        first, others = self.placed[0], len(self.placed) - 1
        size = "" if first.size is None else f"{first.size:g}"
        more = f"and_{others}" if others else ""
        parts = [self.mode, self.cycle, first.kind, size, first.target, more]
        return "_".join(str(part) for part in parts if part)


INPUT_TIMEOUT_S = {DriveMode.LOCK_STEP: 0.3, DriveMode.REAL_TIME: 0.05}
"""Wall time for which the controller waits for missing inputs; half a tick in real time."""
_SEVERITY = {Level.OK: 0, Level.WARN: 1, Level.ERROR: 2, Level.STALE: 2}

MESSAGES_REFUSED = "messages were refused"
"""Reported for 3 s of wall time after such a message, so beyond the end of a fault."""

Interval = tuple[float, float]
"""Start and end in trip time."""


@dataclass(frozen=True)
class StatusReport:
    """Status of a node on the diagnostics, valid from a trip time until its next report."""

    time_s: float
    node: str
    level: Level
    reason: str

    @property
    def is_of_plant(self) -> bool:
        """Whether it is the status of the plant."""
        return self.node == PLANT

    @property
    def is_of_weak_brakes(self) -> bool:
        """Whether the controller reports that the brakes deliver less than commanded."""
        return WEAK_BRAKES in self.reason

    @property
    def is_calm(self) -> bool:
        """Whether the status is OK, or only reports violated limits or refused messages."""
        return self.level is Level.OK or (
            self.level is Level.WARN
            and (self.reason == MESSAGES_REFUSED or is_about_limits(self.reason))
        )


def is_about_limits(reason: str) -> bool:
    """Return whether the reason of a warning lists only limits that the trip violates."""
    parts = reason.removeprefix(BREAKS).split(", ")
    return all(part in CONCERNS or part in LIMITS for part in parts)


NO_REPORT = StatusReport(0.0, "", Level.OK, "")


@dataclass(frozen=True, eq=False)
class DrivenTrial:
    """What was observed of a trial.

    Attributes:
        trial: what was to be driven.
        run: what was driven, with the effective leader.
        reports: status reports in order.
        intervals: of each fault in the order of the trial, None if not reached; process faults do not keep
            to trip time.
        ended: why the trial ended early, empty if it did not.
    """

    trial: Trial
    run: Run
    reports: Sequence[StatusReport]
    intervals: Sequence[Interval | None]
    ended: str = ""

    def worst(self) -> list[StatusReport]:
        """Return the worst status of all nodes at every row, OK before the first report."""
        times_s = self.run.trajectory.time_s.tolist()
        rows = [NO_REPORT] * len(times_s)
        for node in sorted({report.node for report in self.reports}):
            own = [report for report in self.reports if report.node == node]
            place, status = 0, NO_REPORT
            for row, time_s in enumerate(times_s):
                while place < len(own) and own[place].time_s <= time_s + 1e-9:
                    status = own[place]
                    place += 1
                if _SEVERITY[status.level] > _SEVERITY[rows[row].level]:
                    rows[row] = status
        return rows


def drive_headless(trial: Trial) -> DrivenTrial:
    """Drive a trial without ROS, with the reports that the controller's node would make."""
    inputs = trial.inputs
    watch = OperatorWatch(inputs.parameters, inputs.controller)
    reports: list[StatusReport] = []

    def note(tick: int, measured: Measurements, decision: Decision) -> None:
        watch.update(measured, decision)
        status = situation(decision, "", watch)
        if not reports or (reports[-1].level, reports[-1].reason) != status:
            reports.append(StatusReport(float(tick), CONTROLLER, *status))

    run = drive_in_memory(inputs, on_tick=note)
    intervals = [(fault.start_s, fault.end_s) for fault in trial.placed]
    return DrivenTrial(trial, run, reports, intervals)


def trip_of(trial: Trial) -> Trip:
    """Return the trip of a trial over ROS 2."""
    lock_step = trial.mode is DriveMode.LOCK_STEP
    faults = trial.faults
    if lock_step and any(fault.spec.place is FaultPlace.PROCESS for fault in faults):
        # As fast as the machine can, a trip is over before a process has started or reports.
        pace = Fault(FaultKind.STATE_LATE, 0.0, WHOLE_TRIP_S, size=1.0 / REAL_TIME_RATE)
        faults = in_order((pace, *faults))
    return trial.inputs.changed(
        name=trial.name,
        description=f"Faults of the table: {len(trial.placed)} on {trial.cycle}",
        mode=LoopMode.LOCK_STEP if lock_step else LoopMode.REAL_TIME,
        rate_factor=1.0 if lock_step else REAL_TIME_RATE,
        input_timeout_s=INPUT_TIMEOUT_S[trial.mode],
        faults=faults,
    )


def drive_over_ros(trial: Trial, folder: Path) -> DrivenTrial:
    """Drive a trial with real processes.

    Raises:
        IptmError: the run cannot be set up, or no tick was received.
    """
    stop = StopRequest()
    stop.install()
    trip = check_over_ros(trip_of(trial))
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{trial.name}.yaml"
    file.write_text(trip_text(trip), encoding="utf-8")
    run_folder = RunFolder(folder / trial.name, numbered=True)
    record = any(fault.target == "recorder" for fault in trial.faults)
    options = RunOptions(record=record, picture=False)
    with domain_of_run(AUTOMATIC_DOMAIN, environment={}) as domain:
        driven = drive_processes(run_folder, {run_folder: trip}, options, domain, Progress(), stop)
    if stop.number is not None:
        raise KeyboardInterrupt
    return _observed(trial, *driven)


def _observed(trial: Trial, result: DriveResult, drive: NodeDrive) -> DrivenTrial:
    (monitor,) = drive.monitors
    heard = monitor.recorded
    by_stamp = heard_by_stamp(heard, TICK_TOPICS)
    # A missing or disconnected bridge publishes no leader, but the leader is still on the road.
    traffic, leaders = Traffic(trial.faults), {}
    for stamp_ns, state in sorted(by_stamp[Topic.PLANT_STATE].items()):
        ego = decode_observation(state)
        own = trial.inputs.route.leader.state_at(s_from_ns(stamp_ns))
        leaders[stamp_ns] = encode_leader(traffic.leader(own, ego.state.position_m))
    trajectory = assemble_run({**by_stamp, Topic.LEADER: leaders}).trajectory
    decisions = assemble_decisions(heard_by_stamp(heard, (Topic.SOLVE,))[Topic.SOLVE])
    run = Run(trial.name, {}, trial.inputs.parameters, trajectory, decisions)
    time = TripTime([stamp_ns_of(data) for data in heard[Topic.CLOCK]])
    reports = [
        StatusReport(
            time.at_s(report.about_ns, report.clocks),
            report.node,
            Level(report.status.level),
            report.status.message,
        )
        for report in monitor.reports
    ]
    return DrivenTrial(
        trial,
        run,
        sorted(reports, key=lambda report: report.time_s),
        list(_intervals(trial, drive, time, float(trajectory.time_s[-1]))),
        result.message + (f" ({result.last_lines[-1]})" if result.last_lines else ""),
    )


def _intervals(
    trial: Trial, drive: NodeDrive, time: TripTime, last_s: float
) -> Iterator[Interval | None]:
    records = {record.fault: record for record in drive.process_faults.records}
    for fault in trial.placed:
        record = records.get(fault)
        if fault.spec.place is not FaultPlace.PROCESS:
            yield (fault.start_s, fault.end_s) if fault.start_s <= last_s else None
        elif record is None:
            yield None
        else:
            began_s, ended_s = time.at_s(record.began_ns, record.began_clocks), last_s
            if record.ended_ns is not None:
                ended_s = time.at_s(record.ended_ns, record.ended_clocks)
            yield began_s, max(ended_s, began_s)


class TripTime:
    """Maps received messages to the time of the last trip of a run.

    A restarted plant begins at 0 again, a duplicate plant publishes another time, and a node that has
    just been started has none. Messages from before the last trip have negative times.
    """

    def __init__(self, clocks_ns: Sequence[int]) -> None:
        """Set up from the stamps of all clocks, in the order of arrival."""
        stamped = ((stamp, at) for at, stamp in enumerate(clocks_ns))
        counted = frozenset(split_trips(stamped)[-1].values())
        self._begins = min(counted, default=0)
        self._ended_ns = max(clocks_ns[: self._begins], default=0) + NS_PER_S
        own = (stamp if at in counted else -1 for at, stamp in enumerate(clocks_ns))
        self._newest_ns = list(accumulate(own, max))

    def at_s(self, about_ns: int, clocks: int) -> float:
        """Return the trip time in s of a message from its stamp and the number of clocks received before."""
        if clocks <= self._begins:
            return (
                min(about_ns - self._ended_ns, 0) / NS_PER_S
                if self._begins
                else about_ns / NS_PER_S
            )
        now_ns = self._newest_ns[clocks - 1]
        return (about_ns if abs(about_ns - now_ns) <= LEAST_REACH_NS else now_ns) / NS_PER_S
