"""The command behind ``scripts/acc_benchmark``: runs computed or found, and the page about them."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from iptm.studies.acc_benchmark.comparison import figures_of
from iptm.studies.acc_benchmark.drives import (
    CARS,
    VARIANTS,
    benchmark_study,
    parameters_of,
    real_follower,
)
from iptm.studies.acc_benchmark.page import PAGE, REAL, benchmark_page, draw_picture
from iptm.studies.acc_benchmark.scenes import LONGEST_S, SCENES, SHORTEST_S, Scene, measured_scenes
from iptm.studies.campaign import Campaign
from iptm.studies.laboratory import Laboratory, Session
from iptm.studies.store import ResultStore
from iptm.studies.tables import results
from iptm_core.errors import ScenarioError

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
    laboratory.parser.add_argument(
        "--car", choices=list(CARS), help="drive this car only; both by default"
    )
    return laboratory.run(_work, arguments)


def _work(session: Session) -> bool:
    options, store = session.options, session.store
    extent = (SHORT_SCENES, SHORTEST_S) if options.short else (SCENES, LONGEST_S)
    scenes = measured_scenes(options.measured, session.console.print, *extent)
    chosen = options.car or (list(CARS)[-1] if options.short else None)
    cars = [chosen] if chosen else list(CARS)
    study = benchmark_study(scenes, cars, store.folder / "leads")
    campaign = Campaign([study.shortened(compile_code=not options.short)])
    if not session.compute(campaign):
        return True
    by_name = {scene.name: scene for scene in scenes}
    rows = pd.DataFrame(
        row
        for (car, scene), runs in results(campaign.cases).groupby(["car", "scene"], sort=False)
        for row in _figures(
            car, by_name[scene], dict(zip(runs.variant, runs.key, strict=True)), store
        )
    )
    if rows.empty or set(rows.car) != set(cars):
        raise ScenarioError(
            f"{store.folder} lacks runs; allowed: all of one scene per car at least"
        )
    draw_picture(session.output, cars, rows)
    session.write(benchmark_page(session.command, cars, rows, campaign.failures))
    return not (campaign.failures or rows.collided.any())


def _figures(
    car: str, scene: Scene, keys: Mapping[str, str], store: ResultStore
) -> Iterator[dict[str, Any]]:
    """Yield the figures of all variants of driving, if all of their runs are there."""
    found = {variant: store.find(key) for variant, key in keys.items()}
    runs = {variant: run.trajectory for variant, run in found.items() if run is not None}
    if len(runs) < len(VARIANTS):
        return
    real = real_follower(scene, car)
    for variant, run in ({REAL: real} | runs).items():
        labels = {"car": car, "variant": variant}
        yield labels | figures_of(run, real, scene, parameters_of(car))


if __name__ == "__main__":
    sys.exit(main())
