"""The command behind ``scripts/acc_benchmark``: runs computed or found, and the page about them."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console

from iptm_core.errors import ScenarioError
from iptm_studies.acc_benchmark.comparison import Figures, Found, figures_of
from iptm_studies.acc_benchmark.drives import (
    CARS,
    WAYS,
    Car,
    benchmark_study,
    case_labels,
    real_follower,
)
from iptm_studies.acc_benchmark.page import PAGE, REAL, Findings, write_page
from iptm_studies.acc_benchmark.scenes import LONGEST_S, SCENES, SHORTEST_S, Scene, measured_scenes
from iptm_studies.campaign import Campaign
from iptm_studies.cli import EXIT_FAILED_RUNS, add_cluster_options, compute, perform_command
from iptm_studies.cluster import ClusterOptions
from iptm_studies.execution import survey
from iptm_studies.store import ResultStore, default_store_folder
from iptm_studies.study import Label

FOLDER = "acc_benchmark"
SHORT_SCENES = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return perform_command(_run, _parser().parse_args(arguments))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="acc_benchmark", description=__doc__)
    parser.add_argument(
        "--short", action="store_true", help="two lead vehicles and one car, in half a minute"
    )
    parser.add_argument(
        "--stored", action="store_true", help="drive nothing, write the page from what is stored"
    )
    parser.add_argument(
        "--measured",
        type=Path,
        metavar="DIR",
        help="folder with OpenACC files, the excerpts of the project by default",
    )
    names = [car.parameter_set for car in CARS]
    parser.add_argument("--car", choices=names, help="drive this car only; both by default")
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
    extent = (SHORT_SCENES, SHORTEST_S) if options.short else (SCENES, LONGEST_S)
    scenes = measured_scenes(options.measured, console.print, *extent)
    wanted = options.car or (CARS[-1].parameter_set if options.short else None)
    cars = [car for car in CARS if wanted in {None, car.parameter_set}]
    study = benchmark_study(scenes, cars, store.folder / "leads", compile_code=not options.short)
    campaign = Campaign([study])
    if options.dry_run:
        for inputs in survey(campaign, store):
            print(f"{inputs.address:60} {inputs.spec.describe()}")
        return os.EX_OK
    if options.stored:
        survey(campaign, store)
    else:
        compute(campaign, store, ClusterOptions(options.scheduler, options.workers), console)
    keys = {tuple(state.case.labels.values()): state.key for state in campaign.cases}
    figures = {car: _figures(car, scenes, keys, store) for car in cars}
    if not all(rows[REAL] for rows in figures.values()):
        raise ScenarioError(
            f"{store.folder} lacks runs; allowed: all of one scene per car at least"
        )
    found = Findings(_command(options), figures, campaign.failures)
    print(write_page(options.output or store.folder, found))
    return EXIT_FAILED_RUNS if found.failures or found.collisions else os.EX_OK


def _figures(
    car: Car,
    scenes: Sequence[Scene],
    keys: Mapping[tuple[Label, ...], str | None],
    store: ResultStore,
) -> Found:
    """Return the figures of a car by way of driving, for the scenes of which all runs are there."""
    parameters = car.parameters()
    found: dict[str, list[Figures]] = {REAL: [], **{way.name: [] for way in WAYS}}
    for scene in scenes:
        labels = {way.name: tuple(case_labels(scene, car, way).values()) for way in WAYS}
        runs = {way: store.find(keys[label] or "") for way, label in labels.items()}
        if not all(runs.values()):
            continue
        real = real_follower(scene, car)
        found[REAL].append(figures_of(real, real, scene, parameters))
        for way, run in runs.items():
            if run is not None:
                found[way].append(figures_of(run.trajectory, real, scene, parameters))
    return found


def _command(options: argparse.Namespace) -> str:
    flags = ["--short"] if options.short else []
    flags += [f"--car {options.car}"] if options.car else []
    flags += ["--measured DIR"] if options.measured else []
    return " ".join(["scripts/acc_benchmark", *flags])


if __name__ == "__main__":
    sys.exit(main())
