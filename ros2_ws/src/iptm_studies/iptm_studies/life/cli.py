"""The command behind ``scripts/life``: trips computed or found, years composed of them, and the page."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from iptm_studies.campaign import Campaign
from iptm_studies.cli import EXIT_FAILED_RUNS, add_cluster_options, compute, perform_command
from iptm_studies.cluster import ClusterOptions
from iptm_studies.execution import survey
from iptm_studies.life.page import Findings, life_page
from iptm_studies.life.table import life_table
from iptm_studies.life.trips import Extent, trip_maps, trip_study
from iptm_studies.store import ResultStore, default_store_folder

FOLDER = "life"
PAGE = "life.md"
_SHORT = Extent((22.0, 36.0), compile_code=False, duration_s=60.0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return perform_command(_run, _parser().parse_args(arguments))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="life", description=__doc__)
    parser.add_argument(
        "--short", action="store_true", help="one minute of every trip; the page means nothing"
    )
    parser.add_argument(
        "--stored", action="store_true", help="drive nothing, write the page from what is stored"
    )
    parser.add_argument("--store", default="", metavar="DIR", help="folder of the results")
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help=f"folder of {PAGE}, that of the results by default",
    )
    add_cluster_options(parser)
    parser.add_argument(
        "--dry-run", action="store_true", help="show the runs that would be computed"
    )
    return parser


def _run(options: argparse.Namespace, console: Console) -> int:
    store = ResultStore(Path(options.store) if options.store else default_store_folder() / FOLDER)
    campaign = Campaign([trip_study(_SHORT if options.short else Extent())])
    if options.dry_run:
        for inputs in survey(campaign, store):
            print(f"{inputs.address:60} {inputs.spec.describe()}")
        return os.EX_OK
    if options.stored:
        survey(campaign, store)
    else:
        compute(campaign, store, ClusterOptions(options.scheduler, options.workers), console)
    if any(state.metrics is None for state in campaign.cases):
        for state in campaign.cases:
            if state.metrics is None:
                console.print(f"{state.address}: {state.reason}")
        return EXIT_FAILED_RUNS
    console.print("years are composed ...")
    rows, spent = life_table(trip_maps(campaign.cases, store))
    page = (options.output or store.folder) / PAGE
    page.parent.mkdir(parents=True, exist_ok=True)
    command = "scripts/life --short" if options.short else "scripts/life"
    page.write_text(life_page(Findings(command, rows, spent)), encoding="utf-8")
    print(page)
    return os.EX_OK


if __name__ == "__main__":
    sys.exit(main())
