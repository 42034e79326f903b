"""The command behind ``scripts/safety``: trials driven or found, judged, and a page about them."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from iptm_bringup.safety_trials.over_ros import drive_trials
from iptm_core.provenance import git_revision
from iptm_studies.cli import EXIT_FAILED_RUNS, add_cluster_options, perform_command
from iptm_studies.cluster import ClusterOptions
from iptm_studies.safety.lead_vehicles import LEADS, lead_cycles
from iptm_studies.safety.page import safety_page
from iptm_studies.safety.performing import Part, Performer
from iptm_studies.safety.trials import SHORT, Extent, disturbed_study
from iptm_studies.store import ResultStore, default_store_folder

FOLDER = "safety"
PAGE = "safety-trials.md"
ROS_TRIALS = 20


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        0 when everything held, 1 when something did not, 2 for a mistake of the user, 128 + n after signal n.
    """
    return perform_command(_run, _parser().parse_args(arguments))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="safety", description=__doc__)
    parser.add_argument("--short", action="store_true", help="a little of everything, in seconds")
    parser.add_argument(
        "--stored", action="store_true", help="drive nothing, write the page from what is stored"
    )
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
    parser.add_argument("--store", default="", metavar="DIR", help="folder of the results")
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help=f"folder of {PAGE}, that of the results by default",
    )
    add_cluster_options(parser)
    return parser


def _run(options: argparse.Namespace, console: Console) -> int:
    store = ResultStore(Path(options.store) if options.store else default_store_folder() / FOLDER)
    extent = SHORT if options.short else Extent()
    given = {"trials": options.trials, "braking_trials": options.braking, "seed": options.seed}
    extent = replace(extent, **{name: value for name, value in given.items() if value is not None})
    if options.measured is not None or not options.short:
        leads = lead_cycles(options.measured, store.folder / "leads", console.print)
        extent = replace(extent, leads=tuple(leads))
    parts = [Part(name) for name in options.only or list(Part)]
    cluster = ClusterOptions(options.scheduler, options.workers)
    findings = Performer(extent, store, cluster, console, stored_only=options.stored).perform(parts)
    if Part.TRIALS in parts and not options.stored:
        count = options.ros if options.ros is not None else (0 if options.short else ROS_TRIALS)
        over_ros = drive_trials(disturbed_study(extent), count, store.folder / "ros", console)
        findings = replace(findings, over_ros=over_ros)
    page = (options.output or store.folder) / PAGE
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(safety_page(_command(options), git_revision(), findings), encoding="utf-8")
    broken = findings.broken()
    for line in broken:
        print(line)
    print(f"{len(broken)} did not hold: {page}")
    return EXIT_FAILED_RUNS if broken else os.EX_OK


def _command(options: argparse.Namespace) -> str:
    flags = [f"--{name}" for name in ("short", "stored") if getattr(options, name)]
    parts = ["scripts/safety", *flags]
    parts += [f"--only {part}" for part in options.only]
    for name in ("trials", "braking", "ros", "seed", "measured"):
        value = getattr(options, name)
        if value is not None:
            parts.append(f"--{name} {'DIR' if name == 'measured' else value}")
    return " ".join(parts)


if __name__ == "__main__":
    sys.exit(main())
