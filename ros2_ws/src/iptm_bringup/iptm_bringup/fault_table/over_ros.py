"""Trips over ROS 2: real processes, lock-step or real time, and what was heard of them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from iptm_bringup.environment import domain_of_run
from iptm_bringup.fault_table.catalogue import REAL_TIME_RATE, PlannedTrip, Way
from iptm_bringup.fault_table.headless import PARAMETERS, leader_apart
from iptm_bringup.fault_table.observed import Happened, ObservedTrip, Statement, TripTime
from iptm_bringup.monitor import Snapshot, heard_by_stamp
from iptm_bringup.run_folder import RunFolder
from iptm_bringup.runner import Driven, RunOptions, drive_processes
from iptm_bringup.scenario import AUTOMATIC_DOMAIN, Scenario, prepare
from iptm_bringup.scenario_files import scenario_text
from iptm_core.decision_record import Rung
from iptm_core.settings import LoopMode
from iptm_faults.kinds import FaultPlace
from iptm_faults.traffic import Traffic
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

INPUT_TIMEOUT_S = {Way.LOCK_STEP: 0.3, Way.REAL_TIME: 0.05}
"""Wall time for which the controller waits for missing inputs; half a tick in real time."""


class _Quiet:
    """Shows nothing: the table has a line for each trip."""

    def waiting(self, reason: str) -> None:
        """Say nothing."""

    def running(self, snapshot: Snapshot, wall_s: float) -> None:
        """Say nothing."""

    def close(self) -> None:
        """Leave everything as it is."""


def scenario_of(plan: PlannedTrip) -> Scenario:
    """Return the scenario of a trip, as `scripts/run_demo` drives it as well."""
    lock_step = plan.way is Way.LOCK_STEP
    return Scenario(
        name=plan.name,
        description=f"Faults of the table: {len(plan.entries)} on {plan.cycle}",
        cycle=plan.cycle,
        duration_s=plan.route.duration_s,
        mode=LoopMode.LOCK_STEP if lock_step else LoopMode.REAL_TIME,
        rate_factor=1.0 if lock_step else REAL_TIME_RATE,
        node_parameters={"controller": {"input_timeout_s": INPUT_TIMEOUT_S[plan.way]}},
        faults=plan.faults,
    )


def drive_over_ros(plan: PlannedTrip, folder: Path, stop: StopRequest) -> ObservedTrip:
    """Drive a trip with real processes.

    Args:
        plan: the trip.
        folder: for its scenario and logs; a subfolder of its own is made.
        stop: tells that the user wants to stop.

    Raises:
        IptmError: the run cannot be set up, or not a single tick was heard.
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
    # A bridge that is away or deaf tells no leader; it is on the road all the same.
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
    statements = [
        Statement(
            time.at_s(said.about_ns, said.clocks),
            said.node,
            Level(said.status.level),
            said.status.message,
        )
        for said in driven.monitor.statements
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
        sorted(statements, key=lambda said: said.time_s),
        list(_happened(plan, driven, time, float(trajectory.time_s[-1]))),
        ended,
    )


def _happened(
    plan: PlannedTrip, driven: Driven, time: TripTime, last_s: float
) -> Iterable[Happened | None]:
    records = {record.fault: record for record in driven.process_faults.records}
    for _, fault in plan.entries:
        if fault.spec.place is not FaultPlace.PROCESS:
            yield Happened(fault.start_s, fault.end_s) if fault.start_s <= last_s else None
            continue
        record = records.get(fault)
        if record is None:
            yield None
            continue
        began_s, ended_s = time.at_s(record.began_ns, record.began_clocks), last_s
        if record.ended_ns is not None:
            ended_s = time.at_s(record.ended_ns, record.ended_clocks)
        yield Happened(began_s, max(ended_s, began_s))
