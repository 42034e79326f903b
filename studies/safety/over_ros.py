"""The command behind ``scripts/safety``: trials driven or found, judged, and a page about them."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from iptm.parts import CONTROLLER, CYCLE_NAMES, FaultKind, IptmError, Report, VEHICLE, git_revision
from studies.faults.catalogue import DriveMode, Entry, Trial
from studies.faults.driving import DrivenTrial, drive_over_ros
from iptm.studies.laboratory import Laboratory, Session
from studies.measured_cycles import LEADS, lead_cycles
from studies.safety.findings import Part, perform
from studies.safety.judging import judge_trial, trial_of
from studies.safety.page import safety_page
from studies.safety.trials import (
    CYCLES,
    DELAYED_S,
    DISTURBED_S,
    PERIODS_S,
    delay_study,
    disturbed_study,
    driving_study,
)
from iptm.studies.study import Case, Judged, Study
from iptm_ros.diagnostics import Level
from iptm_ros.process import StopRequest
from iptm_ros.topics import PLANT

PAGE = "safety-trials.md"
USUAL = {"trials": 1000, "braking": 20_000, "ros": 20, "seed": 1}
"""Options: numbers of trials, and the seed of all draws."""
SHORT = {"trials": 2, "braking": 4, "ros": 0, "seed": 1}
SHORT_S = 40.0


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
    for name, text in (
        ("trials", "disturbed trials"),
        ("braking", "trials with a braking lead vehicle"),
        ("ros", "of the disturbed trials that are driven over ROS 2 as well"),
        ("seed", "seed of all draws"),
    ):
        text = f"{text}, {USUAL[name]} by default"  # noqa: PLW2901
        parser.add_argument(f"--{name}", type=int, metavar="N", help=text)
    parser.add_argument(
        "--measured",
        type=Path,
        metavar="DIR",
        help=f"folder with measured drives, of which {LEADS} lead vehicles are taken",
    )
    return laboratory.run(_work, arguments)


def _work(session: Session) -> bool:
    options, store = session.options, session.store
    usual = SHORT if options.short else USUAL
    trials, braking, ros, seed = (
        usual[name] if getattr(options, name) is None else getattr(options, name) for name in USUAL
    )
    cycles, leads, longest_s = CYCLES, [], math.inf
    if options.short:
        cycles, longest_s = ("nycc",), SHORT_S
    if options.measured is not None or not options.short:
        leads = lead_cycles(options.measured, store.folder / "leads", session.console.print)
    driving = driving_study(cycles, leads, longest_s)
    periods_s = PERIODS_S[-1:] if options.short else PERIODS_S
    studies = {
        Part.DRIVING: driving,
        # The monitor brakes from instants of undisturbed drives.
        Part.BRAKING: driving,
        Part.TRIALS: disturbed_study(trials, seed, cycles, leads, min(DISTURBED_S, longest_s)),
        Part.DELAYS: delay_study(cycles, periods_s, min(DELAYED_S, longest_s)),
    }
    parts = [Part(name) for name in options.only or list(Part)]
    chosen = {part: study for part, study in studies.items() if part in parts}
    findings = perform(chosen, braking, seed, session, whole_cycles=not options.short)
    if findings is None:
        return True
    if Part.TRIALS in parts and not options.stored:
        driven = _over_ros(studies[Part.TRIALS], ros, session)
        findings = replace(findings, over_ros=tuple(driven))
    broken = findings.broken()
    for line in broken:
        print(line)
    print(f"{len(broken)} did not hold")
    session.write(safety_page(session.command, git_revision(), findings))
    return not broken


def _over_ros(study: Study, count: int, session: Session) -> Iterator[Judged]:
    """Drive the first disturbed trials on published cycles, alternating lock-step and real time.

    States that are late by ticks exist in real time only: in lock-step the plant waits.
    """
    stop = StopRequest()
    stop.install()
    fitting = [case for case in study.cases if case.spec.cycle in CYCLE_NAMES]
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
    run, reports = driven.run, list(_reports(driven))
    return judge_trial(trial_of(case, name), run.trajectory, run.parameters, spec.faults, reports)


def _reports(driven: DrivenTrial) -> Iterator[Report]:
    for report in driven.reports:
        text = "" if report.level is Level.OK else report.reason
        yield Report(report.time_s, VEHICLE if report.node == PLANT else CONTROLLER, text)


if __name__ == "__main__":
    sys.exit(main())
