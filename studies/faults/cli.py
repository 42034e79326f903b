"""The command behind ``scripts/faults``: trials with faults driven and judged, and their page."""

from __future__ import annotations

import math
import os
import re
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from iptm.parts import EXIT_SIGNAL, FaultKind, ScenarioError, check_known, render_page
from studies.faults import catalogue, judge
from studies.faults.catalogue import (
    DriveMode,
    Entry,
    ReportPolicy,
    Trial,
    plan_trials,
    read_catalogue,
)
from studies.faults.driving import INPUT_TIMEOUT_S, DrivenTrial, drive_headless, drive_over_ros
from studies.faults.judge import NOT_REACHED, judge_trial, verdict_of
from iptm.studies.laboratory import Laboratory, Session
from iptm.studies.store import ResultStore, content_key
from iptm.studies.study import Judged
from iptm.studies.workers import Failed, perform_all
from iptm_ros.process import StopRequest

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
            trials = plan_trials(waiting, mode, cycle, fault_free.run.trajectory)
            if session.options.dry_run:
                print(*(trial.name for trial in trials), sep="\n")
                break
            tried: list[str] = []
            for trial, driven in _driven(session, mode, trials, stop):
                if stop.is_set:
                    return  # an interrupted trial has no verdict
                verdicts = _verdicts(trial, driven, fault_free)
                # Faults after one that ended the trial are driven in another one.
                for one in [v for v in verdicts if NOT_REACHED not in v.problems] or verdicts[:1]:
                    store_verdict(session.store, one)
                    _print_outcome(session.console, one)
                    tried.append(one.what)
            waiting = [entry for entry in waiting if entry.name not in tried] if tried else []


def _driven(
    session: Session, mode: DriveMode, trials: list[Trial], stop: StopRequest
) -> Iterator[tuple[Trial, DrivenTrial | Failed]]:
    if mode is DriveMode.HEADLESS:
        yield from perform_all(drive_headless, trials, session.workers)
        return
    for trial in trials:
        began_s = time.monotonic()
        try:
            yield trial, drive_over_ros(trial, session.store.folder, stop)
        except Exception as error:  # noqa: BLE001  an unexpected error fails this trial only
            yield trial, Failed(f"{type(error).__name__}: {error}")
        lasted = f"{trial.inputs.route.duration_s:g} s in {time.monotonic() - began_s:.0f} s"
        session.console.print(f"{trial.name}: {lasted}", style="dim")


def _verdicts(trial: Trial, driven: DrivenTrial | Failed, fault_free: DrivenTrial) -> list[Judged]:
    if not isinstance(driven, Failed):
        return judge_trial(driven, fault_free)
    failed = f"the trip failed: {driven.cause}"
    return [verdict_of(entry, trial.mode, trial.cycle, failed=failed) for entry, _ in trial.entries]


def _print_outcome(console: Console, one: Judged) -> None:
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
    console.print(
        f"{'✗' if one.problems else '✓'} {labels['mode']:<9} {labels['cycle']:<5} {one.what:<45} "
        f"{labels['level']:<5} {', '.join(shown)}"
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
    """Return the page."""
    kinds = list(FaultKind)
    rows = [
        _row(entry, of_it)
        for entry in sorted(entries, key=lambda entry: kinds.index(entry.fault.kind))
        if (of_it := [one for one in verdicts if one.what == entry.name])
    ]
    return render_page(
        "iptm.runner.fault_table",
        "page.md.j2",
        command=command,
        cores=os.cpu_count(),
        load=f"{os.getloadavg()[1]:.0f}",
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
            for one in verdicts
            if one.problems
        ],
        judge=judge,
        catalogue=catalogue,
        lock_step_s=INPUT_TIMEOUT_S[DriveMode.LOCK_STEP],
        real_time_s=INPUT_TIMEOUT_S[DriveMode.REAL_TIME],
        rows=rows,
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


if __name__ == "__main__":
    sys.exit(main())
