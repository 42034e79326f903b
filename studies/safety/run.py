"""Safety trials: leads that brake, disturbed measurements and previews, delays, and undisturbed driving."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import pandas as pd
from studies.faults.catalogue import trial_on
from studies.judged import Judged
from studies.measured_cycles import lead_cycles
from studies.safety.braking import braking_outcomes
from studies.safety.findings import BEFORE, Findings, delays_of, read_before, with_figures
from studies.safety.judging import judge_trial, trial_of
from studies.safety.options import USUAL
from studies.safety.page import safety_values
from studies.safety.trials import (
    CYCLES,
    DELAYED_S,
    DISTURBED_S,
    PERIODS_S,
    UNDISTURBED,
    delay_cases,
    disturbed_cases,
    driving_cases,
)
from studies.session import Case, Session
from studies.trial import DriveMode, DrivenTrial, Level, drive_over_ros

import iptm
from iptm.faults.kinds import FaultKind
from iptm.run import Report, Reporter
from iptm_core.routes.cycles import CYCLE_NAMES

SHORT = {"trials": 2, "braking": 4, "ros": 0, "seed": 1}
SHORT_S = 40.0


def run(session: Session) -> bool:
    """Run the study; returns whether everything held."""
    options = session.options
    usual = SHORT if session.short else USUAL
    trials, braking, ros, seed = (
        usual[name] if getattr(options, name) is None else getattr(options, name) for name in USUAL
    )
    cycles, leads, longest_s, periods_s = CYCLES, [], math.inf, PERIODS_S
    if session.short:
        cycles, longest_s, periods_s = ("nycc",), SHORT_S, PERIODS_S[-1:]
    if not session.short:
        leads = lead_cycles(session.scratch / "leads")
    driving = driving_cases(cycles, leads, longest_s)
    disturbed = disturbed_cases(trials, seed, cycles, leads, min(DISTURBED_S, longest_s))
    drives, disturbed_runs, delays = map(
        session.drive,
        (driving, disturbed, delay_cases(cycles, periods_s, min(DELAYED_S, longest_s))),
    )
    findings = Findings(
        _braking(session, driving, drives, braking, seed),
        judged_runs(disturbed, disturbed_runs, session),
        with_figures(drives),
        delays_of(delays),
        ({}, "") if session.short else read_before(BEFORE),
        tuple(_over_ros(session, disturbed, ros)),
    )
    broken = findings.broken()
    for line in broken:
        print(line)
    session.say(f"{len(broken)} did not hold")
    session.render(**safety_values(findings))
    return not broken


def _braking(
    session: Session, cases: Sequence[Case], drives: pd.DataFrame, trials: int, seed: int
) -> pd.DataFrame:
    """The monitor brakes from instants of undisturbed drives."""
    undisturbed = {
        str(row.cycle): (case.call, row.run.trajectory)
        for case, row in zip(cases, drives.itertuples(), strict=True)
        if row.setting == UNDISTURBED and row.run is not None
    }
    return braking_outcomes(session, undisturbed, trials, seed)


def judged_runs(cases: Sequence[Case], found: pd.DataFrame, session: Session) -> list[Judged]:
    """Judge what was driven; a trial that failed is a problem of its own."""
    judged = []
    for case, run in zip(cases, found.run, strict=True):
        if run is None:
            judged.append(trial_of(case, failure=session.failures.pop(case.name)))
        else:
            driven = run.trajectory, run.parameters, case.call["faults"], run.reports
            judged.append(judge_trial(trial_of(case), *driven))
    return judged


def _over_ros(session: Session, cases: Sequence[Case], count: int) -> Iterator[Judged]:
    """Drive the first disturbed trials on published cycles, alternating lock-step and real time.

    States that are late by ticks exist in real time only: in lock-step the plant waits.
    """
    fitting = [case for case in cases if case.call["cycle"] in CYCLE_NAMES][:count]
    for number, case in enumerate(fitting):
        faults = case.call["faults"]
        delayed = any(fault.kind is FaultKind.STATE_DELAYED for fault in faults)
        mode = DriveMode.REAL_TIME if delayed or number % 2 else DriveMode.LOCK_STEP
        name = f"{case.name}, {mode}"
        trial = trial_on(case.call["cycle"], case.call.get("duration_s"), mode, faults)
        call = {"trial": trial, "folder": session.scratch / "ros"}
        (driven,) = session.compute(drive_over_ros, [call], [name], workers=1)
        if driven is None or driven.ended:
            failure = session.failures.pop(name) if driven is None else driven.ended
            yield trial_of(case, name, failure)
        else:
            trip: iptm.Run = driven.run
            found = trip.trajectory, trip.parameters, faults, list(_reports(driven))
            yield judge_trial(trial_of(case, name), *found)


def _reports(driven: DrivenTrial) -> Iterator[Report]:
    for report in driven.reports:
        text = "" if report.level is Level.OK else report.reason
        source = Reporter.VEHICLE if report.is_of_plant else Reporter.CONTROLLER
        yield Report(report.time_s, source, text, report.is_of_weak_brakes)
