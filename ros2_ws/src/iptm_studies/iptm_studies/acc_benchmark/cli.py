"""The command behind ``scripts/acc_benchmark``: runs computed or found, and the page about them."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

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
from iptm_studies.acc_benchmark.page import PAGE, REAL, Findings, benchmark_page, draw_picture
from iptm_studies.acc_benchmark.scenes import LONGEST_S, SCENES, SHORTEST_S, Scene, measured_scenes
from iptm_studies.campaign import Campaign
from iptm_studies.laboratory import Laboratory, Session
from iptm_studies.store import ResultStore
from iptm_studies.study import Label

SHORT_SCENES = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    laboratory = Laboratory(
        "acc_benchmark", PAGE, __doc__, short="two lead vehicles and one car, in half a minute"
    )
    laboratory.parser.add_argument(
        "--measured",
        type=Path,
        metavar="DIR",
        help="folder with OpenACC files, the excerpts of the project by default",
    )
    names = [car.parameter_set for car in CARS]
    laboratory.parser.add_argument(
        "--car", choices=names, help="drive this car only; both by default"
    )
    return laboratory.run(_work, arguments)


def _work(session: Session) -> bool:
    options, store = session.options, session.store
    extent = (SHORT_SCENES, SHORTEST_S) if options.short else (SCENES, LONGEST_S)
    scenes = measured_scenes(options.measured, session.console.print, *extent)
    wanted = options.car or (CARS[-1].parameter_set if options.short else None)
    cars = [car for car in CARS if wanted in {None, car.parameter_set}]
    study = benchmark_study(scenes, cars, store.folder / "leads", compile_code=not options.short)
    campaign = Campaign([study])
    if not session.compute(campaign):
        return True
    keys = {tuple(state.case.labels.values()): state.key for state in campaign.cases}
    figures = {car: _figures(car, scenes, keys, store) for car in cars}
    if not all(rows[REAL] for rows in figures.values()):
        raise ScenarioError(
            f"{store.folder} lacks runs; allowed: all of one scene per car at least"
        )
    found = Findings(session.command, figures, campaign.failures)
    draw_picture(session.output, found)
    session.write(benchmark_page(found))
    return not (found.failures or found.collisions)


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


if __name__ == "__main__":
    sys.exit(main())
