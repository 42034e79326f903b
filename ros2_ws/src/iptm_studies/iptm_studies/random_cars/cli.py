"""The command behind ``scripts/campaign``: random runs, computed or found, judged, and a page about them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from iptm_core.user_input import number, whole_number
from iptm_studies.campaign import Campaign
from iptm_studies.cli import EXIT_FAILED_RUNS, add_cluster_options, compute, perform_command
from iptm_studies.cluster import ClusterOptions
from iptm_studies.execution import survey
from iptm_studies.random_cars.draws import FAULT_SHARE, IMPERFECT_SHARE, TWIN, random_study
from iptm_studies.random_cars.page import JudgedRun, campaign_page, verdict_lines
from iptm_studies.random_cars.verdicts import judge
from iptm_studies.run_inputs import resolve_inputs
from iptm_studies.store import ResultStore, default_store_folder

FOLDER = "campaign"
PAGE = "random-cars.md"
RUNS = 300
SEED = 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return perform_command(_run, _parser().parse_args(arguments))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="campaign", description=__doc__)
    parser.add_argument(
        "--runs",
        type=whole_number,
        default=RUNS,
        metavar="N",
        help=f"number of runs, {RUNS} by default",
    )
    parser.add_argument(
        "--seed",
        type=whole_number,
        default=SEED,
        metavar="S",
        help=f"seed of all draws, {SEED} by default",
    )
    parser.add_argument(
        "--duration-s", type=number, metavar="T", help="length of all trips instead of those drawn"
    )
    parser.add_argument(
        "--without-twins",
        action="store_true",
        help="leave out the warm twins of cold runs, and the verdict on traction energy with them",
    )
    parser.add_argument(
        "--fault-share",
        type=float,
        default=FAULT_SHARE,
        metavar="P",
        help=f"share of the runs with faults, {FAULT_SHARE:g} by default",
    )
    parser.add_argument(
        "--imperfect-share",
        type=float,
        default=IMPERFECT_SHARE,
        metavar="P",
        help=f"share of the runs without a perfect preview, {IMPERFECT_SHARE:g} by default",
    )
    parser.add_argument("--store", default="", metavar="DIR", help="folder of the results")
    parser.add_argument(
        "--output",
        default="",
        metavar="DIR",
        help=f"folder of {PAGE}, that of the results by default",
    )
    add_cluster_options(parser)
    parser.add_argument(
        "--dry-run", action="store_true", help="show the runs that would be computed"
    )
    return parser


def _run(options: argparse.Namespace, console: Console) -> int:
    study = random_study(
        options.runs,
        options.seed,
        options.duration_s,
        with_twins=not options.without_twins,
        fault_share=options.fault_share,
        imperfect_share=options.imperfect_share,
    )
    campaign = Campaign([study])
    store = ResultStore(Path(options.store) if options.store else default_store_folder() / FOLDER)
    if options.dry_run:
        for inputs in survey(campaign, store):
            print(f"{inputs.address:30} {inputs.spec.describe()}")
        return 0
    compute(campaign, store, ClusterOptions(options.scheduler, options.workers), console)
    runs = judged_runs(campaign, store)
    page = (Path(options.output) if options.output else store.folder) / PAGE
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(campaign_page(_command(options), runs), encoding="utf-8")
    for line in verdict_lines(runs):
        print(line)
    print(page)
    good = all(run.judgement is not None and not run.judgement.breaches for run in runs)
    return 0 if good else EXIT_FAILED_RUNS


def judged_runs(campaign: Campaign, store: ResultStore) -> list[JudgedRun]:
    """Judge the runs of a campaign of random cars, each beside its twin if there is one."""
    keys = {
        state.case.name: str(state.key) for state in campaign.cases if state.metrics is not None
    }
    judged = []
    for state in campaign.cases:
        name, spec = state.case.name, state.case.spec
        if name.endswith(TWIN):
            continue
        if name not in keys:
            judged.append(JudgedRun(name, spec, None, state.reason))
            continue
        twin_key = keys.get(f"{name}_{TWIN}")
        twin = None if twin_key is None else store.load(twin_key)
        found = judge(store.load(keys[name]), resolve_inputs(spec), twin)
        judged.append(JudgedRun(name, spec, found))
    return judged


def _command(options: argparse.Namespace) -> str:
    command = f"scripts/campaign --runs {options.runs} --seed {options.seed}"
    if options.duration_s is not None:
        command += f" --duration-s {options.duration_s:g}"
    if options.fault_share != FAULT_SHARE:
        command += f" --fault-share {options.fault_share:g}"
    if options.imperfect_share != IMPERFECT_SHARE:
        command += f" --imperfect-share {options.imperfect_share:g}"
    return command + (" --without-twins" if options.without_twins else "")


if __name__ == "__main__":
    sys.exit(main())
