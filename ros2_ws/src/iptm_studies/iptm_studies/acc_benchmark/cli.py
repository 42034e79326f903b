"""The command behind ``scripts/acc_benchmark``: runs computed or found, and the page about them."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from iptm_core.errors import ScenarioError
from iptm_studies.acc_benchmark.comparison import figures_of
from iptm_studies.acc_benchmark.drives import (
    CARS,
    WAYS,
    Car,
    benchmark_study,
    case_labels,
    real_follower,
)
from iptm_studies.acc_benchmark.page import PAGE, REAL, benchmark_page, draw_picture
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
    rows = pd.DataFrame(
        row for car in cars for scene in scenes for row in _figures(car, scene, keys, store)
    )
    if rows.empty or set(rows.car) != {car.parameter_set for car in cars}:
        raise ScenarioError(
            f"{store.folder} lacks runs; allowed: all of one scene per car at least"
        )
    draw_picture(session.output, cars, rows)
    session.write(benchmark_page(session.command, cars, rows, campaign.failures))
    return not (campaign.failures or rows.collided.any())


def _figures(
    car: Car, scene: Scene, keys: Mapping[tuple[Label, ...], str | None], store: ResultStore
) -> Iterator[dict[str, Any]]:
    """Yield the figures of all ways of driving, if all of their runs are there."""
    found = {
        way.name: store.find(keys[tuple(case_labels(scene, car, way).values())] or "")
        for way in WAYS
    }
    runs = {way: run.trajectory for way, run in found.items() if run is not None}
    if len(runs) < len(WAYS):
        return
    real = real_follower(scene, car)
    for way, run in ({REAL: real} | runs).items():
        labels = {"car": car.parameter_set, "way": way}
        yield labels | figures_of(run, real, scene, car.parameters())


if __name__ == "__main__":
    sys.exit(main())
