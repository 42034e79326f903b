"""The command behind ``scripts/real_cars``: runs computed or found, and the page about them."""

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
from iptm_studies.real_cars.drives import CYCLE, Extent
from iptm_studies.real_cars.page import Findings, real_cars_page
from iptm_studies.real_cars.savings import rows_on, savings_study
from iptm_studies.real_cars.simplifications import losses, simplification_study
from iptm_studies.real_cars.trips import trip_cycles
from iptm_studies.store import ResultStore, default_store_folder

FOLDER = "real_cars"
PAGE = "real-cars.md"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return perform_command(_run, _parser().parse_args(arguments))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="real_cars", description=__doc__)
    parser.add_argument("--short", action="store_true", help="a little of everything, in seconds")
    parser.add_argument(
        "--stored", action="store_true", help="drive nothing, write the page from what is stored"
    )
    parser.add_argument(
        "--measured",
        type=Path,
        metavar="DIR",
        help="folder with recorded trips of the i3, the excerpts of the project by default",
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
    trips = trip_cycles(options.measured, store.folder / "trips", console.print)
    extent = Extent.short(trips) if options.short else Extent(tuple(trips))
    studies = savings_study(extent), simplification_study(extent)
    campaign = Campaign(studies)
    if options.dry_run:
        for inputs in survey(campaign, store):
            print(f"{inputs.address:60} {inputs.spec.describe()}")
        return os.EX_OK
    if options.stored:
        survey(campaign, store)
    else:
        compute(campaign, store, ClusterOptions(options.scheduler, options.workers), console)
    savings, simplifications = (
        [state for state in campaign.cases if state.study is study] for study in studies
    )
    found = Findings(
        _command(options),
        extent,
        rows_on(extent, savings, [CYCLE]),
        rows_on(extent, savings, extent.trips),
        losses(simplifications),
        campaign.failures,
        len(campaign.keys) - campaign.finished - len(campaign.failures),
    )
    page = (options.output or store.folder) / PAGE
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(real_cars_page(found), encoding="utf-8")
    for name in found.too_large():
        print(f"simplification {name} costs more than it may")
    print(page)
    return EXIT_FAILED_RUNS if found.failures or found.too_large() else os.EX_OK


def _command(options: argparse.Namespace) -> str:
    flags = ["--short"] if options.short else []
    flags += ["--measured DIR"] if options.measured else []
    return " ".join(["scripts/real_cars", *flags])


if __name__ == "__main__":
    sys.exit(main())
