"""The command behind ``scripts/safety``: trials driven or found, judged, and a page about them."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from iptm_bringup.fault_table.catalogue import DriveMode, Entry, Trial
from iptm_bringup.fault_table.driving import DrivenTrial, drive_over_ros
from iptm_core.errors import IptmError
from iptm_core.provenance import git_revision
from iptm_core.routes import CYCLE_NAMES
from iptm_faults.kinds import FaultKind
from iptm_interfaces.diagnostics import Level
from iptm_interfaces.process import StopRequest
from iptm_interfaces.topics import PLANT
from iptm_studies.laboratory import Laboratory, Session
from iptm_studies.run import CONTROLLER, VEHICLE, Report
from iptm_studies.safety.findings import Part, perform
from iptm_studies.safety.judging import judge_trial, trial_of
from iptm_studies.safety.lead_vehicles import LEADS, lead_cycles
from iptm_studies.safety.page import safety_page
from iptm_studies.safety.trials import SHORT, Extent, disturbed_study
from iptm_studies.study import Case, Judged

PAGE = "safety-trials.md"
ROS_TRIALS = 20


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code, 1 when something did not hold."""
    laboratory = Laboratory("safety", PAGE, __doc__, short="a little of everything, in seconds")
    parser = laboratory.parser
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        choices=[part.value for part in Part],
        help="only this part; repeatable",
    )
    for name, usual, text in (
        ("trials", Extent.trials, "disturbed trials"),
        ("braking", Extent.braking_trials, "trials with a braking lead vehicle"),
        ("ros", ROS_TRIALS, "of the disturbed trials that are driven over ROS 2 as well"),
        ("seed", Extent.seed, "seed of all draws"),
    ):
        parser.add_argument(f"--{name}", type=int, metavar="N", help=f"{text}, {usual} by default")
    parser.add_argument(
        "--measured",
        type=Path,
        metavar="DIR",
        help=f"folder with measured drives, of which {LEADS} lead vehicles are taken",
    )
    return laboratory.run(_work, arguments)


def _work(session: Session) -> bool:
    options, store = session.options, session.store
    extent = SHORT if options.short else Extent()
    given = {"trials": options.trials, "braking_trials": options.braking, "seed": options.seed}
    extent = replace(extent, **{name: value for name, value in given.items() if value is not None})
    if options.measured is not None or not options.short:
        leads = lead_cycles(options.measured, store.folder / "leads", session.console.print)
        extent = replace(extent, leads=tuple(leads))
    parts = [Part(name) for name in options.only or list(Part)]
    findings = perform(extent, parts, session)
    if findings is None:
        return True
    if Part.TRIALS in parts and not options.stored:
        count = options.ros if options.ros is not None else (0 if options.short else ROS_TRIALS)
        findings = replace(findings, over_ros=tuple(_over_ros(extent, count, session)))
    broken = findings.broken()
    for line in broken:
        print(line)
    print(f"{len(broken)} did not hold")
    session.write(safety_page(session.command, git_revision(), findings))
    return not broken


def _over_ros(extent: Extent, count: int, session: Session) -> Iterator[Judged]:
    """Drive the first disturbed trials on published cycles, alternating lock-step and real time.

    States that are late by ticks exist in real time only: in lock-step the plant waits.
    """
    stop = StopRequest()
    stop.install()
    fitting = [case for case in disturbed_study(extent).cases if case.spec.cycle in CYCLE_NAMES]
    for number, case in enumerate(fitting[:count]):
        if stop.is_set:
            return
        delayed = any(fault.kind is FaultKind.STATE_DELAYED for fault in case.spec.faults)
        mode = DriveMode.REAL_TIME if delayed or number % 2 else DriveMode.LOCK_STEP
        judged = _drive(case, mode, session.store.folder / "ros", stop)
        session.console.print(f"{judged.name}: {judged.problem_text or 'held'}")
        yield judged


def _drive(case: Case, mode: DriveMode, folder: Path, stop: StopRequest) -> Judged:
    spec, name = case.spec, f"{case.name}, {mode}"
    entries = [(Entry(fault), fault) for fault in spec.faults]
    try:
        driven = drive_over_ros(Trial.on(spec.cycle, spec.duration_s, mode, entries), folder, stop)
    except IptmError as error:
        return trial_of(case, name, str(error))
    if driven.ended:
        return trial_of(case, name, driven.ended)
    parameters, reports = driven.trial.inputs.parameters, list(_reports(driven))
    return judge_trial(trial_of(case, name), driven.trajectory, parameters, spec.faults, reports)


def _reports(driven: DrivenTrial) -> Iterator[Report]:
    for report in driven.reports:
        text = "" if report.level is Level.OK else report.reason
        yield Report(report.time_s, VEHICLE if report.node == PLANT else CONTROLLER, text)


if __name__ == "__main__":
    sys.exit(main())
