"""Table of injected faults: expected reports, recovery times and collision checks."""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Sequence
from typing import Any

from studies.faults import catalogue, judge
from studies.faults.catalogue import (
    Entry,
    Placed,
    ReportPolicy,
    plan_trials,
    read_catalogue,
    trial_on,
)
from studies.faults.judge import judge_trial, verdict_of
from studies.judged import Judged
from studies.session import Session
from studies.trial import (
    INPUT_TIMEOUT_S,
    REAL_TIME_RATE,
    DriveMode,
    DrivenTrial,
    drive_headless,
    drive_over_ros,
)

from iptm.faults.kinds import FaultKind
from iptm_core.errors import ScenarioError
from iptm_core.user_input import check_known

SHORT_KINDS = ("preview_lost", "brakes_weak")
_MODES = {
    DriveMode.HEADLESS: "without ROS",
    DriveMode.LOCK_STEP: "lock-step",
    DriveMode.REAL_TIME: "real time",
}
_EXPECTED = {
    ReportPolicy.ALWAYS: "every tick",
    ReportPolicy.ONCE: "once",
    ReportPolicy.NEVER: "not required",
}
_FOLDER_OF_A_BAG = re.compile(r"/\S*/(?=\S+\.mcap)")
"""Folder part of a bag's path, removed because it depends on the machine."""


def run(session: Session) -> bool:
    """Run the study; returns whether everything held."""
    options = session.options
    cycles, entries = read_catalogue(options.catalogue)
    only = SHORT_KINDS if session.short else options.only or ()
    for kind in only:
        check_known(kind, [one.value for one in FaultKind], "option --only", "kind", ScenarioError)
    chosen = [entry for entry in entries if not only or entry.fault.kind in only]
    modes = [DriveMode(mode) for mode in options.mode or list(DriveMode)]
    own = [entry.cycle for entry in chosen if entry.cycle]
    wanted = dict.fromkeys(options.cycle or [*cycles, *own])
    if session.short:
        modes, wanted = [DriveMode.HEADLESS], dict.fromkeys(cycles[:1])
    verdicts: list[Judged] = []
    for cycle in wanted:
        of_cycle = [
            entry
            for entry in chosen
            if options.cycle or entry.cycle == cycle or (not entry.cycle and cycle in cycles)
        ]
        if any(entry.supports(mode) for entry in of_cycle for mode in modes):
            verdicts += _verdicts_on(session, of_cycle, modes, cycle)
    session.failures.clear()  # they are problems of their trials
    order = {entry.name: place for place, entry in enumerate(entries)}
    verdicts.sort(key=lambda one: order[one.what])
    kinds = list(FaultKind)
    rows = [
        _row(entry, of_it)
        for entry in sorted(entries, key=lambda entry: kinds.index(entry.fault.kind))
        if (of_it := [one for one in verdicts if one.what == entry.name])
    ]
    red = [one for one in verdicts if one.problems]
    session.render(
        machine="" if session.short else _machine(),
        kinds=len({row["kind"] for row in rows}),
        trials=len(verdicts),
        cycles=dict.fromkeys(one.labels["cycle"] for one in verdicts),
        red=[
            {
                "fault": one.what,
                "how": _MODES[DriveMode(one.labels["mode"])],
                "cycle": one.labels["cycle"],
                "what": "; ".join(one.problems.values()),
            }
            for one in red
        ],
        judge=judge,
        catalogue=catalogue,
        rate=REAL_TIME_RATE,
        lock_step_s=INPUT_TIMEOUT_S[DriveMode.LOCK_STEP],
        real_time_s=INPUT_TIMEOUT_S[DriveMode.REAL_TIME],
        rows=rows,
    )
    session.say(f"{len(verdicts) - len(red)} of {len(verdicts)} green, {len(red)} red")
    return not red


def _machine() -> str:
    return f"On {os.cpu_count()} cores at a load average of {os.getloadavg()[1]:.0f}: "


def _verdicts_on(
    session: Session, entries: Sequence[Entry], modes: Sequence[DriveMode], cycle: str
) -> list[Judged]:
    """Return the verdicts on the rows of a table on one cycle, mode by mode."""
    (fault_free,) = session.compute(drive_headless, [{"trial": trial_on(cycle)}], [cycle])
    verdicts: list[Judged] = []
    for mode in modes:
        trials = plan_trials(entries, mode, cycle, fault_free.run.trajectory)
        for placed, driven in zip(trials, _driven(session, mode, trials), strict=True):
            verdicts.append(_judged(session, placed, driven, fault_free))
            session.say(_outcome(verdicts[-1]))
    return verdicts


def _driven(session: Session, mode: DriveMode, trials: Sequence[Placed]) -> list[Any]:
    names = [placed.trial.name for placed in trials]
    calls: list[dict[str, Any]] = [{"trial": placed.trial} for placed in trials]
    if mode is DriveMode.HEADLESS:
        return session.compute(drive_headless, calls, names)
    # Processes of their own, one trial after the other.
    calls = [{**call, "folder": session.scratch / "ros"} for call in calls]
    return session.compute(drive_over_ros, calls, names, workers=1)


def _judged(
    session: Session, placed: Placed, driven: DrivenTrial | None, fault_free: DrivenTrial
) -> Judged:
    if driven is not None:
        return judge_trial(driven, placed.entry, fault_free)
    trial = placed.trial
    failed = f"the trip failed: {session.failures[trial.name]}"
    return verdict_of(placed.entry, trial.mode, trial.cycle, failed=failed)


def _outcome(one: Judged) -> str:
    figures, labels = one.figures, one.labels
    shown = [
        text.format(figures[key])
        for key, text in (
            ("normal_after", "normal after {:g}"),
            ("smallest_gap_m", "gap {:.1f} m"),
            ("braking_gap_m", "brakes {:.1f} m"),
        )
        if key in figures
    ]
    return (
        f"{'✗' if one.problems else '✓'} {labels['mode']:<9} {labels['cycle']:<5} {one.what:<45} "
        f"{labels['level']:<5} {', '.join(shown)}"
        + "".join(f"\n      {what}" for what in one.problems.values())
    )


def _row(entry: Entry, verdicts: Sequence[Judged]) -> dict[str, Any]:
    marks = {}
    for mode in _MODES:
        of_mode = [one for one in verdicts if one.labels["mode"] == mode.value]
        green = sum(not one.problems for one in of_mode)
        mark = "✓" if green == len(of_mode) else "✗"
        marks[mode.value] = f"{mark} {green} of {len(of_mode)}" if of_mode else None
    known = [one.figures for one in verdicts if "braking_gap_m" in one.figures]
    tightest = min(known, key=lambda figures: figures["braking_gap_m"], default={})
    after = [one.figures.get("normal_after", math.inf) for one in verdicts]
    slowest = "never" if math.inf in after else f"{max(after):g}"
    return {
        "kind": entry.fault.kind,
        "fault": entry.name,
        "expected": _EXPECTED[entry.reported],
        **marks,
        "normal": None if entry.ends else f"{slowest}; {entry.normal_within}",
        "gap_m": tightest.get("smallest_gap_m"),
        "braking_m": tightest.get("braking_gap_m"),
        "reasons": _reasons(verdicts),
    }


def _reasons(verdicts: Sequence[Judged]) -> str:
    counts: Counter[str] = Counter()
    for verdict in verdicts:
        counts.update(_FOLDER_OF_A_BAG.sub("", reason) for reason in verdict.counts)
    return "<br>".join(f"{reason} ({count})" for reason, count in counts.most_common()) or "nothing"
