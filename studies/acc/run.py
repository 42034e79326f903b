"""The default strategy behind measured lead vehicles, compared with the adaptive cruise controls there."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from studies.acc.figures import figures_of, spread
from studies.acc.scenes import LONGEST_S, RUN_IN_S, SCENES, SHORTEST_S, Scene, measured_scenes
from studies.drives import DEFAULT, PRODUCTION, climate, trip
from studies.session import Case, Session

import iptm
from iptm.parts import (
    DEFAULT_SET,
    LeaderState,
    ModelParameters,
    Plant,
    ProductionLikeController,
    ProductionSettings,
    ScenarioError,
    Trajectory,
    load_parameters,
)

SHORT_SCENES = 2
PICTURE = "spread.png"
REAL = "real follower"
WIDTH_INCH, DPI = 9.0, 90
_PANELS = {
    "headway_s": "time headway, s",
    "jerk_m_s3": "jerk (rms), m/s³",
    "energy_saving": "energy saved, %",
    "aging_saving": "ageing saved, %",
}
_SAVINGS = ["energy_saving", "aging_saving"]
_DIGITS = {
    "gap_m": 1,
    "headway_s": 2,
    "below_percent": 0,
    "above_percent": 0,
    "jerk_m_s3": 2,
    "consumption_kwh_100_km": 1,
    "energy_saving": 1,
    "aging_saving": 1,
    "end_gap_m": 1,
    "end_kinetic_kj": 0,
}
"""Decimals of the figures of which median and quartiles are shown."""


SMALL_INITIAL_GAP_M = 8.0
"""Gap at standstill with a largest time headway, which does not count below it."""
SHORTEST_HEADWAY_S, LONGEST_HEADWAY_S = 0.3, 1.5
ROOM_S = 0.3
"""Time headway between the lower and the upper limit of the gap at the mean speed."""
FOLLOWED_EXACTLY = {
    "limits.min_acceleration_m_s2": -8.0,
    "limits.max_acceleration_m_s2": 12.0,
    "limits.max_jerk_m_s3": 50.0,
}
"""The real follower is not held to the limits of comfort."""


CARS: Mapping[str, float] = {DEFAULT_SET: 35.0, "bmw_i3": 25.0}
"""Temperature of the air and of the cells at the start in degC, by parameter set."""


def parameters_of(car: str, overrides: Mapping[str, float] | None = None) -> ModelParameters:
    """Return the parameters of a car in its climate, some of them replaced."""
    return load_parameters(car, {**climate(CARS[car]), **(overrides or {})}).values


@dataclass(frozen=True)
class Variant:
    """A variant of driving behind the lead vehicles.

    Attributes:
        name: for labels and tables.
        role: of the controller, one of `STRATEGIES`.
        preview: whether the lead vehicle's future is known.
        limited: whether the time headway is at most what the real follower's 95th percentile is.
    """

    name: str
    role: str
    preview: bool
    limited: bool


VARIANTS = (
    Variant("120 m, no V2X", DEFAULT, preview=False, limited=False),
    Variant("120 m, perfect preview", DEFAULT, preview=True, limited=False),
    Variant("real headway, no V2X", DEFAULT, preview=False, limited=True),
    Variant("real headway, perfect preview", DEFAULT, preview=True, limited=True),
    Variant("production strategy, no V2X", PRODUCTION, preview=False, limited=False),
)


def headway_overrides(scene: Scene, car: str) -> dict[str, float]:
    """Return gap limits with no larger time headway than the real follower's 95th percentile.

    Where the lower limit would be above the upper one at the mean speed, its time headway is cut.
    """
    largest_s = scene.largest_headway_s
    standstill_m = load_parameters(car).values.gap.standstill_gap_m
    room_s = largest_s - standstill_m / scene.mean_speed_m_s - ROOM_S
    return {
        "gap.max_time_headway_s": round(largest_s, 2),
        "gap.time_headway_s": round(min(max(room_s, SHORTEST_HEADWAY_S), LONGEST_HEADWAY_S), 2),
        "gap.initial_gap_m": SMALL_INITIAL_GAP_M,
    }


def benchmark_cases(scenes: Sequence[Scene], cars: Sequence[str], folder: Path) -> list[Case]:
    """Return all trips; the drives of the lead vehicles are written to a folder."""
    cases = []
    for scene in scenes:
        cycle = scene.write(folder)
        for car, variant in product(cars, VARIANTS):
            labels = {"scene": scene.name, "car": car, "variant": variant.name}
            call = trip(
                cycle,
                variant.role,
                car,
                CARS[car],
                headway_overrides(scene, car) if variant.limited else None,
                duration_s=float(scene.duration_s),
                preview_mode="full" if variant.preview else "none",
            )
            cases.append(Case("/".join(labels.values()), labels, call))
    return cases


def real_follower(scene: Scene, car: str) -> Trajectory:
    """Return what the real follower's motion costs in a car, by the models of the benchmark.

    The speeds are followed exactly; the compressor, which was not measured, follows the thermostat of the
    strategy `production`.
    """
    parameters = parameters_of(car, FOLLOWED_EXACTLY)
    plant = Plant(parameters, lambda positions: 0.0 * positions)
    thermostat = ProductionLikeController(parameters, ProductionSettings())
    step = plant.observe(plant.initial_state())
    observed = []
    for second in range(scene.duration_s + 1):
        state = step.state
        leader = LeaderState(
            state.time_s,
            state.position_m + float(scene.gap_m[second]),
            float(scene.leader_speed_m_s[second]),
        )
        observed.append((step, leader))
        if second < scene.duration_s:
            acceleration = float(scene.speed_m_s[second + 1]) - state.speed_m_s
            cooling = thermostat.command(state, leader)
            command = replace(cooling, acceleration_m_s2=acceleration)
            step = plant.advance(state, command)
    return Trajectory.from_ticks(observed)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this study."""
    parser.add_argument(
        "--measured",
        type=Path,
        metavar="DIR",
        help="folder with OpenACC files (default: the excerpts of the project)",
    )
    parser.add_argument("--car", choices=list(CARS), help="drive this car only (default: both)")


def run(session: Session) -> bool:
    """Run the study; returns whether no lead vehicle was touched.

    Raises:
        ScenarioError: a car has no scene with all of its trips.
    """
    options = session.options
    extent = (SHORT_SCENES, SHORTEST_S) if session.short else (SCENES, LONGEST_S)
    scenes = measured_scenes(options.measured, session.say, *extent)
    chosen = options.car or (list(CARS)[-1] if session.short else None)
    cars = [chosen] if chosen else list(CARS)
    cases = benchmark_cases(scenes, cars, session.scratch / "leads")
    if session.short:
        cases = [case.shortened(case.call["duration_s"]) for case in cases]
    by_name = {scene.name: scene for scene in scenes}
    rows = pd.DataFrame(
        row
        for (car, scene), driven in session.drive(cases).groupby(["car", "scene"], sort=False)
        for row in _figures(car, by_name[scene], dict(zip(driven.variant, driven.run, strict=True)))
    )
    if rows.empty or set(rows.car) != set(cars):
        raise ScenarioError("trips are missing; allowed: all of one scene per car at least")
    if not session.short:
        draw_picture(session.output, cars, rows)
    real = rows[rows.variant == REAL]
    session.render(
        picture=PICTURE,
        counts=sorted(set(real.groupby("car").size())),
        collisions=int(rows.collided.sum()),
        longest_s=LONGEST_S,
        run_in_s=RUN_IN_S,
        cars=[
            (car, CARS[car], load_parameters(car).description, _by_variant(rows[rows.car == car]))
            for car in cars
        ],
    )
    return not rows.collided.any()


def _figures(
    car: str, scene: Scene, runs: Mapping[str, iptm.Run | None]
) -> Iterator[dict[str, Any]]:
    """Yield the figures of all variants of driving, if all of their trips are there."""
    found = {variant: one.trajectory for variant, one in runs.items() if one is not None}
    if len(found) < len(VARIANTS):
        return
    real = real_follower(scene, car)
    for variant, driven in ({REAL: real} | found).items():
        labels = {"car": car, "variant": variant}
        yield labels | figures_of(driven, real, scene, parameters_of(car))


def _by_variant(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row of texts and numbers per variant of driving."""
    variants = rows.groupby("variant", sort=False)
    found = pd.DataFrame(
        {name: variants[name].agg(spread, digits) for name, digits in _DIGITS.items()}
    )
    found.loc[REAL, _SAVINGS] = "0"
    found["collisions"] = variants.collided.sum()
    found["smallest_gap_m"] = variants.smallest_gap_m.min()
    found["emergencies"] = variants.emergency_s.agg(lambda seconds: (seconds > 0.0).sum())
    return found.reset_index()


def draw_picture(folder: Path, cars: Sequence[str], rows: pd.DataFrame) -> None:
    """Draw the spread over the lead vehicles as boxes from quartile to quartile, below a folder."""
    figure = Figure(figsize=(WIDTH_INCH, 3.2 * len(cars)), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(cars), len(_PANELS), squeeze=False, sharey="row")
    for line, car in zip(axes, cars, strict=True):
        variants = rows[rows.car == car].groupby("variant", sort=False)
        for axis, (name, label) in zip(line, _PANELS.items(), strict=True):
            is_saving = name in _SAVINGS
            values = [
                [] if is_saving and variant == REAL else part[name].dropna().tolist()
                for variant, part in variants
            ]
            if is_saving:
                axis.axvline(0.0, color="0.6", linewidth=0.8)
            axis.boxplot(values, orientation="horizontal", showfliers=False, widths=0.6)
            axis.set_xlabel(label)
            axis.grid(axis="x", alpha=0.3)
        line[0].set_yticks(np.arange(1, variants.ngroups + 1), list(variants.groups))
        line[0].invert_yaxis()
        line[0].set_title(f"{car}, {CARS[car]:g} °C", loc="left", fontsize="medium")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / PICTURE, metadata={"Software": None})
