"""Command line of ``scripts/faults``: drive and judge trips with faults and write their page."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from iptm_bringup.fault_table.catalogue import (
    DriveMode,
    Entry,
    PlannedTrip,
    plan_trips,
    read_catalogue,
    sound_trip,
)
from iptm_bringup.fault_table.headless import HeadlessDriver
from iptm_bringup.fault_table.judge import TrialOutcome, judge_trip
from iptm_bringup.fault_table.observed import ObservedTrip
from iptm_bringup.fault_table.over_ros import drive_over_ros
from iptm_bringup.fault_table.page import faults_page
from iptm_bringup.fault_table.store import VerdictStore, failed
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.program import EXIT_OK, EXIT_SIGNAL, refused
from iptm_core.user_input import check_known
from iptm_faults.kinds import FaultKind
from iptm_interfaces.process import StopRequest

PROGRAM = "faults"
PAGE = "faults.md"
EXIT_RED = 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        0 if every fault passes, 1 if one fails, 2 for a usage error, 128 + n after signal n.
    """
    options = _parser().parse_args(arguments)
    try:
        return _run(options)
    except IptmError as error:
        return refused(PROGRAM, error)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=PROGRAM, description=__doc__)
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="KIND",
        help="only this kind of fault; repeatable. Earlier verdicts on other kinds are kept",
    )
    parser.add_argument(
        "--mode",
        action="append",
        default=[],
        choices=[mode.value for mode in DriveMode],
        help="only this mode; repeatable",
    )
    parser.add_argument(
        "--cycle", action="append", default=[], metavar="NAME", help="another cycle; repeatable"
    )
    parser.add_argument(
        "--catalogue",
        type=Path,
        metavar="FILE",
        help="catalogue of faults (default: the shipped one)",
    )
    parser.add_argument(
        "--folder",
        type=Path,
        metavar="DIR",
        help="folder of verdicts, scenarios and logs (default: results/faults)",
    )
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help=f"folder of {PAGE} (default: the folder of the verdicts)",
    )
    return parser


@dataclass(frozen=True)
class _Context:
    entries: tuple[Entry, ...]
    folder: Path
    driver: HeadlessDriver
    store: VerdictStore
    stop: StopRequest
    console: Console


def _run(options: argparse.Namespace) -> int:
    cycles, entries = read_catalogue(options.catalogue)
    for kind in options.only:
        check_known(kind, [one.value for one in FaultKind], "option --only", "kind", ScenarioError)
    folder = options.folder or Path(os.environ.get("IPTM_ROOT", ".")) / "results" / "faults"
    stop = StopRequest()
    stop.install()
    context = _Context(
        entries, folder, HeadlessDriver(), VerdictStore(folder), stop, Console(highlight=False)
    )
    chosen = [entry for entry in entries if not options.only or entry.fault.kind in options.only]
    modes = [DriveMode(mode) for mode in options.mode] or list(DriveMode)
    began_s = time.monotonic()
    own = dict.fromkeys(entry.cycle for entry in chosen if entry.cycle)
    for cycle in options.cycle or [*cycles, *own]:
        wanted = [
            entry
            for entry in chosen
            if options.cycle or entry.cycle == cycle or (not entry.cycle and cycle in cycles)
        ]
        if any(entry.supports(mode) for entry in wanted for mode in modes):
            _drive_cycle(context, wanted, modes, cycle)
        if stop.number is not None:
            return EXIT_SIGNAL + int(stop.number)
    verdicts = context.store.load(entries)
    page = (options.output or folder) / PAGE
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(faults_page("scripts/faults", verdicts), encoding="utf-8")
    red = sum(bool(verdict.problems) for verdict in verdicts)
    lasted_s = time.monotonic() - began_s
    print(f"{len(verdicts) - red} of {len(verdicts)} green, {red} red, {lasted_s:.0f} s: {page}")
    return EXIT_RED if red else EXIT_OK


def _drive_cycle(
    context: _Context, entries: Sequence[Entry], modes: Iterable[DriveMode], cycle: str
) -> None:
    fault_free = context.driver.drive(sound_trip(cycle))
    for mode in modes:
        waiting = list(entries)
        while waiting:
            tried: list[Entry] = []
            for plan in plan_trips(waiting, mode, cycle, fault_free.trajectory):
                began_s = time.monotonic()
                verdicts = _judged(context, plan, fault_free)
                if context.stop.is_set:
                    return  # an interrupted trip has no verdict
                # Faults after one that ended the trip are driven in another trip.
                came = [one for one in verdicts if not one.not_reached] or verdicts[:1]
                context.store.add(context.entries, came)
                tried += [one.entry for one in came]
                _print_outcomes(context.console, plan, came, time.monotonic() - began_s)
            waiting = [entry for entry in waiting if entry not in tried] if tried else []


def _judged(context: _Context, plan: PlannedTrip, fault_free: ObservedTrip) -> list[TrialOutcome]:
    try:
        if plan.mode is DriveMode.HEADLESS:
            trip = context.driver.drive(plan)
        else:
            trip = drive_over_ros(plan, context.folder, context.stop)
        return judge_trip(trip, fault_free)
    except Exception as error:  # noqa: BLE001  an unexpected error fails this trip only
        why = f"the trip failed: {type(error).__name__}: {error}"
        return [failed(entry, plan.mode, plan.cycle, why) for entry, _ in plan.entries]


def _print_outcomes(
    console: Console, plan: PlannedTrip, verdicts: Sequence[TrialOutcome], lasted_s: float
) -> None:
    if plan.mode is not DriveMode.HEADLESS:
        console.print(f"[dim]{plan.name}: {plan.route.duration_s:g} s in {lasted_s:.0f} s[/]")
    for one in verdicts:
        mark = "[red]✗[/]" if one.problems else "[green]✓[/]"
        normal = f"normal after {one.normal_after:g}" if not one.entry.ends else "ends"
        text = (
            f"{mark} {one.mode.value:<9} {one.cycle:<5} {one.entry.name:<45} {one.level.name:<5} "
            f"{normal:<16} gap {one.smallest_gap_m:.1f} (brakes {one.braking_gap_m:.1f}) m"
        )
        console.print(text + "".join(f"\n      {what}" for what in one.problems), soft_wrap=True)


if __name__ == "__main__":
    sys.exit(main())
