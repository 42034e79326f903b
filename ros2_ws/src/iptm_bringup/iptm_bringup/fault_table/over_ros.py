"""Trips over ROS 2: real processes in lock-step or real time, and what they published."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from iptm_bringup.environment import domain_of_run
from iptm_bringup.fault_table.catalogue import REAL_TIME_RATE, DriveMode, PlannedTrip
from iptm_bringup.fault_table.headless import PARAMETERS, leader_apart
from iptm_bringup.fault_table.observed import FaultInterval, ObservedTrip, StatusReport, TripTime
from iptm_bringup.monitor import Snapshot, heard_by_stamp
from iptm_bringup.run_folder import RunFolder
from iptm_bringup.runner import Driven, RunOptions, drive_processes
from iptm_bringup.scenario import AUTOMATIC_DOMAIN, Scenario, prepare
from iptm_bringup.scenario_files import scenario_text
from iptm_core.decision_record import Rung
from iptm_core.settings import LoopMode
from iptm_faults.kinds import FaultPlace
from iptm_faults.signals import Traffic
from iptm_interfaces.assembly import assemble_run
from iptm_interfaces.codecs import (
    decode_decision_record,
    decode_observation,
    encode_leader,
    s_from_ns,
    stamp_ns_of,
)
from iptm_interfaces.diagnostics import Level
from iptm_interfaces.process import StopRequest
from iptm_interfaces.topics import OBSERVATION_TOPICS, TICK_TOPICS, Topic

INPUT_TIMEOUT_S = {DriveMode.LOCK_STEP: 0.3, DriveMode.REAL_TIME: 0.05}
"""Wall time for which the controller waits for missing inputs; half a tick in real time."""


class _Quiet:
    """Progress display that shows nothing; the table prints a line for each trip."""

    def waiting(self, reason: str) -> None:
        """Do nothing."""

    def running(self, snapshot: Snapshot, wall_s: float) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


def scenario_of(plan: PlannedTrip) -> Scenario:
    """Return the scenario of a trip, as driven by `scripts/run_demo`."""
    lock_step = plan.mode is DriveMode.LOCK_STEP
    return Scenario(
        name=plan.name,
        description=f"Faults of the table: {len(plan.entries)} on {plan.cycle}",
        cycle=plan.cycle,
        duration_s=plan.route.duration_s,
        mode=LoopMode.LOCK_STEP if lock_step else LoopMode.REAL_TIME,
        rate_factor=1.0 if lock_step else REAL_TIME_RATE,
        node_parameters={"controller": {"input_timeout_s": INPUT_TIMEOUT_S[plan.mode]}},
        faults=plan.faults,
    )


def drive_over_ros(plan: PlannedTrip, folder: Path, stop: StopRequest) -> ObservedTrip:
    """Drive a trip with real processes.

    Args:
        plan: the trip.
        folder: for its scenario and logs; a subfolder of its own is made.
        stop: set when the user requests a stop.

    Raises:
        IptmError: the run cannot be set up, or no tick was received.
    """
    scenario = scenario_of(plan)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{plan.name}.yaml"
    file.write_text(scenario_text(scenario), encoding="utf-8")
    prepared = prepare(scenario)
    run_folder = RunFolder(folder / plan.name, numbered=True)
    record = any(fault.target == "recorder" for fault in plan.faults)
    options = RunOptions(record=record, picture=False)
    with domain_of_run(AUTOMATIC_DOMAIN, environment={}) as domain:
        driven = drive_processes(run_folder, prepared, options, domain, _Quiet(), stop)
    return _observed(plan, driven)


def _observed(plan: PlannedTrip, driven: Driven) -> ObservedTrip:
    heard = driven.monitor.recorded
    by_stamp = heard_by_stamp(heard, (*TICK_TOPICS, Topic.PLANT_SAFETY))
    complete = set.intersection(*(set(by_stamp[topic]) for topic in OBSERVATION_TOPICS))
    # A missing or disconnected bridge publishes no leader, but the leader is still on the road.
    traffic, leaders = Traffic(plan.faults), {}
    for stamp_ns in sorted(complete):
        host = decode_observation(
            {topic: by_stamp[topic][stamp_ns] for topic in OBSERVATION_TOPICS}
        )
        own = plan.route.leader.state_at(s_from_ns(stamp_ns))
        leaders[stamp_ns] = encode_leader(traffic.leader(own, host.state.position_m))
    trajectory = assemble_run({**by_stamp, Topic.LEADER: leaders}).trajectory
    decisions = heard_by_stamp(heard, (Topic.SOLVE,))[Topic.SOLVE]
    rungs: dict[float, Rung] = {
        s_from_ns(stamp_ns): decode_decision_record(message).rung
        for stamp_ns, message in decisions.items()
    }
    time = TripTime([stamp_ns_of(data) for data in heard[Topic.CLOCK]])
    reports = [
        StatusReport(
            time.at_s(report.about_ns, report.clocks),
            report.node,
            Level(report.status.level),
            report.status.message,
        )
        for report in driven.monitor.reports
    ]
    ended = driven.result.message
    if driven.result.last_lines:
        ended += f" ({driven.result.last_lines[-1]})"
    return ObservedTrip(
        plan,
        PARAMETERS,
        trajectory,
        leader_apart(plan, trajectory),
        rungs,
        sorted(reports, key=lambda report: report.time_s),
        list(_intervals(plan, driven, time, float(trajectory.time_s[-1]))),
        ended,
    )


def _intervals(
    plan: PlannedTrip, driven: Driven, time: TripTime, last_s: float
) -> Iterable[FaultInterval | None]:
    records = {record.fault: record for record in driven.process_faults.records}
    for _, fault in plan.entries:
        if fault.spec.place is not FaultPlace.PROCESS:
            yield FaultInterval(fault.start_s, fault.end_s) if fault.start_s <= last_s else None
            continue
        record = records.get(fault)
        if record is None:
            yield None
            continue
        began_s, ended_s = time.at_s(record.began_ns, record.began_clocks), last_s
        if record.ended_ns is not None:
            ended_s = time.at_s(record.ended_ns, record.ended_clocks)
        yield FaultInterval(began_s, max(ended_s, began_s))
