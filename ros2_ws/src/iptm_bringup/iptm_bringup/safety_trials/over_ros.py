"""Disturbed trials over ROS 2: real processes, judged like the headless trials."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from rich.console import Console

from iptm_bringup.fault_table.catalogue import DriveMode, Entry, PlannedTrip, ReportPolicy
from iptm_bringup.fault_table.observed import ObservedTrip
from iptm_bringup.fault_table.over_ros import drive_over_ros
from iptm_core.errors import IptmError
from iptm_core.routes import CYCLE_NAMES
from iptm_faults.kinds import FaultKind
from iptm_interfaces.diagnostics import Level
from iptm_interfaces.process import StopRequest
from iptm_interfaces.topics import PLANT
from iptm_studies.run import CONTROLLER, VEHICLE, Report
from iptm_studies.run_inputs import resolve_inputs
from iptm_studies.safety.findings import JudgedTrial
from iptm_studies.safety.judging import judge_trial
from iptm_studies.study import Case, Study


def drive_trials(
    study: Study, count: int, folder: Path, console: Console
) -> tuple[JudgedTrial, ...]:
    """Drive the first trials on published cycles, alternating lock-step and real time.

    States that are late by ticks exist in real time only: in lock-step the plant waits.

    Args:
        study: the disturbed trials.
        count: how many of them.
        folder: for scenarios and logs.
        console: shows the progress.
    """
    stop = StopRequest()
    stop.install()
    judged = []
    for number, case in enumerate(_first(study, count)):
        delayed = any(fault.kind is FaultKind.STATE_DELAYED for fault in case.spec.faults)
        way = DriveMode.REAL_TIME if delayed or number % 2 else DriveMode.LOCK_STEP
        if stop.is_set:
            break
        judged.append(_drive(case, way, folder, stop))
        console.print(f"{judged[-1].name}: {', '.join(judged[-1].problems) or 'held'}")
    return tuple(judged)


def _first(study: Study, count: int) -> Iterable[Case]:
    fitting = [case for case in study.cases if case.spec.cycle in CYCLE_NAMES]
    return fitting[:count]


def _drive(case: Case, way: DriveMode, folder: Path, stop: StopRequest) -> JudgedTrial:
    route, faults = resolve_inputs(case.spec).route, case.spec.faults
    entries = tuple((Entry(fault, ReportPolicy.NEVER), fault) for fault in faults)
    name, disturbed = f"{case.name}, {way}", str(case.labels["disturbed"])
    what = f"{case.spec.cycle}, {', '.join(fault.describe() for fault in faults)}"
    try:
        trip = drive_over_ros(PlannedTrip(way, case.spec.cycle, entries, route), folder, stop)
    except IptmError as error:
        return JudgedTrial(name, disturbed, what, faults, None, str(error))
    if trip.ended:
        return JudgedTrial(name, disturbed, what, faults, None, trip.ended)
    verdict = judge_trial(trip.trajectory, trip.parameters, faults, list(_reports(trip)))
    return JudgedTrial(name, disturbed, what, faults, verdict)


def _reports(trip: ObservedTrip) -> Iterator[Report]:
    for report in trip.reports:
        text = "" if report.level is Level.OK else report.reason
        yield Report(report.time_s, VEHICLE if report.node == PLANT else CONTROLLER, text)
