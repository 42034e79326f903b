"""The command behind ``scripts/faults``: trials with faults driven and judged, and their page."""

from __future__ import annotations

import os
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from rich.console import Console

from iptm_bringup.fault_table import judge
from iptm_bringup.fault_table.catalogue import (
    FIRST_S,
    REAL_TIME_RATE,
    DriveMode,
    Entry,
    ReportPolicy,
    Trial,
    plan_trials,
    read_catalogue,
)
from iptm_bringup.fault_table.driving import (
    INPUT_TIMEOUT_S,
    DrivenTrial,
    drive_headless,
    drive_over_ros,
)
from iptm_bringup.fault_table.judge import NOT_REACHED, judge_trial, verdict_of
from iptm_core.errors import ScenarioError
from iptm_core.markdown import markdown_table, render_page
from iptm_core.program import EXIT_SIGNAL
from iptm_core.user_input import check_known
from iptm_faults.kinds import FaultKind
from iptm_interfaces.process import StopRequest
from iptm_studies.judging import Judged
from iptm_studies.laboratory import Laboratory, Session
from iptm_studies.store import ResultStore, content_key
from iptm_studies.workers import Failed, perform_all

PAGE = "faults.md"
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code, 128 + n after signal n."""
    laboratory = Laboratory("faults", PAGE, __doc__)
    add = partial(laboratory.parser.add_argument, action="append", default=[])
    text = "only this kind of fault; repeatable. Earlier verdicts on other kinds are kept"
    add("--only", metavar="KIND", help=text)
    modes = [mode.value for mode in DriveMode]
    add("--mode", choices=modes, help="only this mode; repeatable")
    add("--cycle", metavar="NAME", help="another cycle; repeatable")
    laboratory.parser.add_argument(
        "--catalogue", type=Path, metavar="FILE", help="of faults (default: the shipped one)"
    )
    stop = StopRequest()
    code = laboratory.run(partial(_work, stop), arguments)
    return code if stop.number is None else EXIT_SIGNAL + int(stop.number)


def _work(stop: StopRequest, session: Session) -> bool:
    options = session.options
    cycles, entries = read_catalogue(options.catalogue)
    for kind in options.only:
        check_known(kind, [one.value for one in FaultKind], "option --only", "kind", ScenarioError)
    chosen = [entry for entry in entries if not options.only or entry.fault.kind in options.only]
    modes = [DriveMode(mode) for mode in options.mode] or list(DriveMode)
    own = [entry.cycle for entry in chosen if entry.cycle]
    wanted = tuple(dict.fromkeys(options.cycle or [*cycles, *own]))
    began_s = time.monotonic()
    stop.install()
    for cycle in () if options.stored else wanted:
        of_cycle = [
            entry
            for entry in chosen
            if options.cycle or entry.cycle == cycle or (not entry.cycle and cycle in cycles)
        ]
        if any(entry.supports(mode) for entry in of_cycle for mode in modes):
            _drive_cycle(session, of_cycle, modes, cycle, stop)
        if stop.is_set:
            return False
    if options.dry_run:
        return True
    verdicts = stored_verdicts(session.store, entries, [*cycles, *wanted])
    session.write(faults_page("scripts/faults", entries, verdicts))
    red = sum(bool(verdict.problems) for verdict in verdicts)
    lasted_s = time.monotonic() - began_s
    print(f"{len(verdicts) - red} of {len(verdicts)} green, {red} red, {lasted_s:.0f} s")
    return not red


def _drive_cycle(
    session: Session,
    entries: Sequence[Entry],
    modes: Sequence[DriveMode],
    cycle: str,
    stop: StopRequest,
) -> None:
    fault_free = drive_headless(Trial.on(cycle))
    for mode in modes:
        waiting = list(entries)
        while waiting:
            trials = plan_trials(waiting, mode, cycle, fault_free.trajectory)
            if session.options.dry_run:
                print(*(trial.name for trial in trials), sep="\n")
                break
            tried: list[str] = []

            def judged(
                trial: Trial, driven: DrivenTrial | Failed, tried: list[str] = tried
            ) -> None:
                verdicts = _verdicts(trial, driven, fault_free)
                # Faults after one that ended the trial are driven in another one.
                came = [one for one in verdicts if NOT_REACHED not in one.problems] or verdicts[:1]
                for one in came:
                    store_verdict(session.store, one)
                    _print_outcome(session.console, one)
                tried += [one.what for one in came]

            drive = _drive_headless if mode is DriveMode.HEADLESS else _drive_over_ros
            drive(session, trials, stop, judged)
            if stop.is_set:
                return
            waiting = [entry for entry in waiting if entry.name not in tried] if tried else []


_Take = Callable[[Trial, "DrivenTrial | Failed"], None]


def _drive_headless(session: Session, trials: list[Trial], stop: StopRequest, take: _Take) -> None:
    for trial, driven in perform_all(drive_headless, trials, session.workers):
        if stop.is_set:
            return
        take(trial, driven)


def _drive_over_ros(session: Session, trials: list[Trial], stop: StopRequest, take: _Take) -> None:
    for trial in trials:
        began_s = time.monotonic()
        try:
            driven: DrivenTrial | Failed = drive_over_ros(trial, session.store.folder, stop)
        except Exception as error:  # noqa: BLE001  an unexpected error fails this trial only
            driven = Failed(f"{type(error).__name__}: {error}")
        if stop.is_set:
            return  # an interrupted trial has no verdict
        lasted_s = time.monotonic() - began_s
        duration_s = trial.inputs.route.duration_s
        session.console.print(f"{trial.name}: {duration_s:g} s in {lasted_s:.0f} s", style="dim")
        take(trial, driven)


def _verdicts(trial: Trial, driven: DrivenTrial | Failed, fault_free: DrivenTrial) -> list[Judged]:
    why = driven.cause if isinstance(driven, Failed) else ""
    try:
        if isinstance(driven, DrivenTrial):
            return judge_trial(driven, fault_free)
    except Exception as error:  # noqa: BLE001  as above
        why = f"{type(error).__name__}: {error}"
    failed = f"the trip failed: {why}"
    return [verdict_of(entry, trial.mode, trial.cycle, failed=failed) for entry, _ in trial.entries]


def _print_outcome(console: Console, one: Judged) -> None:
    figures = one.figures
    gaps = ", ".join(
        f"{text} {figures[key]:.1f} m"
        for key, text in (("smallest_gap_m", "gap"), ("braking_gap_m", "brakes"))
        if key in figures
    )
    normal = f"normal after {figures['normal_after']:g}" if "normal_after" in figures else ""
    labels = one.labels
    console.print(
        f"{'✗' if one.problems else '✓'} {labels['mode']:<9} {labels['cycle']:<5} {one.what:<45} "
        f"{labels['level']:<5} {normal:<16} {gaps}"
        + "".join(f"\n      {what}" for what in one.problems.values()),
        style="red" if one.problems else None,
    )


def store_verdict(store: ResultStore, verdict: Judged) -> None:
    """Store a verdict; it replaces the one on the same fault, mode and cycle."""
    # Reports and problems keep their order.
    pairs = {"problems": list(verdict.problems.items()), "counts": list(verdict.counts.items())}
    store.save_content(content_key(verdict.name), asdict(verdict) | pairs)


def stored_verdicts(
    store: ResultStore, entries: Sequence[Entry], cycles: Sequence[str]
) -> list[Judged]:
    """Return the stored verdicts on the rows of a table, by cycle, mode and row."""
    found = []
    for cycle in dict.fromkeys(cycles):
        for mode in DriveMode:
            for entry in entries:
                stored = store.find_content(content_key(verdict_of(entry, mode, cycle).name))
                if stored is not None:
                    content = {name: stored[0][name] for name in Judged.__dataclass_fields__}
                    pairs = {name: dict(content[name]) for name in ("problems", "counts")}
                    found.append(Judged(**content | pairs))
    return found


def faults_page(command: str, entries: Sequence[Entry], verdicts: Sequence[Judged]) -> str:
    """Return the page.

    Args:
        command: the command that made the page.
        entries: the rows of the table.
        verdicts: of all faults and trials.
    """
    kinds = list(FaultKind)
    rows = [
        (entry, of_it)
        for entry in sorted(entries, key=lambda entry: kinds.index(entry.fault.kind))
        if (of_it := [one for one in verdicts if one.what == entry.name])
    ]
    return render_page(
        "iptm_bringup.fault_table",
        "page.md.j2",
        table=markdown_table,
        command=command,
        cores=os.cpu_count(),
        load=f"{os.getloadavg()[1]:.0f}",
        kinds=len({entry.fault.kind for entry, _ in rows}),
        verdicts=verdicts,
        cycles=dict.fromkeys(one.labels["cycle"] for one in verdicts),
        red=[
            (one.what, _MODES[DriveMode(one.labels["mode"])], one.labels["cycle"], text)
            for one in verdicts
            if (text := "; ".join(one.problems.values()))
        ],
        report_delay=judge.REPORT_DELAY_TICKS,
        late_report=judge.LATE_REPORT_TICKS,
        steady=judge.STEADY_TICKS,
        first_s=f"{FIRST_S:g}",
        rate=f"{REAL_TIME_RATE:g}",
        lock_step_s=f"{INPUT_TIMEOUT_S[DriveMode.LOCK_STEP]:g}",
        real_time_s=f"{INPUT_TIMEOUT_S[DriveMode.REAL_TIME]:g}",
        modes=list(_MODES.values()),
        results=[_row(entry, of_it) for entry, of_it in rows],
        reports=[(entry.name, _reasons(of_it)) for entry, of_it in rows],
    )


def _row(entry: Entry, verdicts: Sequence[Judged]) -> tuple[object, ...]:
    marks = []
    for mode in _MODES:
        of_mode = [one for one in verdicts if one.labels["mode"] == mode.value]
        green = sum(not one.problems for one in of_mode)
        mark = "✓" if green == len(of_mode) else "✗"
        marks.append(f"{mark} {green} of {len(of_mode)}" if of_mode else "–")
    known = [one.figures for one in verdicts if "braking_gap_m" in one.figures]
    tightest = min(known, key=lambda figures: figures["braking_gap_m"], default=None)
    gaps = [
        "–" if tightest is None else f"{tightest[name]:.1f}"
        for name in ("smallest_gap_m", "braking_gap_m")
    ]
    after = [one.figures.get("normal_after") for one in verdicts]
    slowest = "never" if None in after else f"{max(one or 0.0 for one in after):g}"
    normal = "–" if entry.ends else f"{slowest}; {entry.normal_within}"
    return (entry.name, _EXPECTED[entry.reported], *marks, normal, *gaps)


def _reasons(verdicts: Sequence[Judged]) -> str:
    counts: Counter[str] = Counter()
    for verdict in verdicts:
        counts.update(_FOLDER_OF_A_BAG.sub("", reason) for reason in verdict.counts)
    return "<br>".join(f"{reason} ({count})" for reason, count in counts.most_common()) or "nothing"


if __name__ == "__main__":
    sys.exit(main())
