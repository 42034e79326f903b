"""Savings behind measured lead vehicles at the headway of the cars that followed them there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from studies.acc.figures import REAL, figures_of, spread
from studies.acc.scenes import RUN_IN_S, SHORTEST_S, Scene, long_scenes
from studies.acc.variants import (
    CARS,
    CLIMATES_C,
    EQUAL_HEADWAY,
    EQUAL_S,
    ROOM_S,
    ROUNDS,
    SHORTEST_HEADWAY_S,
    VARIANTS,
    Setting,
    driven,
    equal_headways,
    parameters_of,
)
from studies.savings import (
    BASELINE,
    BASES,
    COLUMNS,
    PREVIEWS,
    PRODUCTION,
    RULE_COLUMN,
    RULE_PREVIEW,
)
from studies.session import Session

import iptm
from iptm_controller.production import ProductionLikeController, ProductionSettings
from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters
from iptm_core.state import LeaderState
from iptm_core.trajectory import Trajectory
from iptm_plant_sim.plant import Plant

LONG_SCENES, SHORT_SCENES = 6, 1
LONG_S = 1200
PICTURE = "spread.png"
WIDTH_INCH, DPI = 9.0, 90
_PANELS = {
    "headway_s": "time headway, s",
    "jerk_m_s3": "jerk (rms), m/s³",
    "real_energy": "energy saved, %",
    "real_ageing": "ageing saved, %",
}
_SAVINGS = ["real_energy", "real_ageing"]
"""Of which the tables have the quartiles, too."""
FOLLOWED_EXACTLY = {
    "limits.min_acceleration_m_s2": -8.0,
    "limits.max_acceleration_m_s2": 12.0,
    "limits.max_jerk_m_s3": 50.0,
}
"""The real follower is not held to the limits of comfort."""


def real_follower(scene: Scene, car: str, ambient_c: float) -> Trajectory:
    """Return what the real follower's motion costs in a car, by the models of the benchmark.

    The speeds are followed exactly; the compressor, which was not measured, follows the thermostat of the
    strategy `production`.
    """
    parameters = parameters_of(car, ambient_c, FOLLOWED_EXACTLY)
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


def run(session: Session) -> bool:
    """Run the study; returns whether the real headway was met, and no lead vehicle touched.

    Raises:
        ScenarioError: a car and a climate have no scene with all of their trips.
    """
    cars, climates_c = (CARS[-1:], CLIMATES_C[:1]) if session.short else (CARS, CLIMATES_C)
    count, seconds = (SHORT_SCENES, SHORTEST_S) if session.short else (LONG_SCENES, LONG_S)
    scenes, pairs = long_scenes(count, seconds)
    settings = [Setting(scene, car, c) for car, c, scene in product(cars, climates_c, scenes)]
    desired_s = equal_headways(session, settings, 1 if session.short else ROUNDS)
    cases = [
        setting.case(variant, session.scratch / "leads", each_s)
        for setting, each_s in zip(settings, desired_s, strict=True)
        for variant in VARIANTS
    ]
    runs = driven(session, cases)
    rows = pd.DataFrame(
        row
        for place, setting in enumerate(settings)
        for row in _figures(setting, runs[place * len(VARIANTS) : (place + 1) * len(VARIANTS)])
    )
    groups = list(product(cars, climates_c))
    if rows.empty or set(zip(rows.car, rows.ambient_c, strict=True)) != {*groups}:
        raise ScenarioError("trips are missing; allowed: all of one scene per car at least")
    if not session.short:
        draw_picture(session.output, rows)
    tables = [
        (car, ambient_c, _by_variant(rows[(rows.car == car) & (rows.ambient_c == ambient_c)]))
        for car, ambient_c in groups
    ]
    equal = rows[rows.variant == EQUAL_HEADWAY.name]
    off_s = float(equal.off_headway_s.median())
    session.render(
        picture=PICTURE,
        columns=(*COLUMNS, RULE_COLUMN),
        scenes=len(scenes),
        pairs=pairs,
        collisions=int(rows.collided.sum()),
        minutes=seconds / 60.0,
        run_in_s=RUN_IN_S,
        off_s=off_s,
        production_s=_headway_s(rows, PRODUCTION),
        baseline_s=_headway_s(rows, BASELINE),
        equal_s=EQUAL_S,
        room_s=ROOM_S,
        shortest_s=SHORTEST_HEADWAY_S,
        descriptions={car: load_parameters(car).description for car in cars},
        tables=tables,
        equal=pd.DataFrame(
            {"car": car, "ambient_c": ambient_c, **table[table.name == EQUAL_HEADWAY.name].iloc[0]}
            for car, ambient_c, table in tables
        ),
    )
    return not rows.collided.any() and (session.short or off_s <= EQUAL_S)


def _headway_s(rows: pd.DataFrame, role: str) -> float:
    """Return the median of the median headways of a base."""
    return float(rows.headway_s[rows.control == f"`{role}`"].median())


def _figures(setting: Setting, runs: Sequence[iptm.Run | None]) -> Iterator[dict[str, Any]]:
    """Yield the figures of all variants of driving, if all of their trips are there."""
    found = {
        variant: one.trajectory
        for variant, one in zip(VARIANTS, runs, strict=True)
        if one is not None
    }
    if len(found) < len(VARIANTS):
        return
    real = real_follower(setting.scene, setting.car, setting.ambient_c)
    parameters = parameters_of(setting.car, setting.ambient_c)
    named = (*BASES, RULE_PREVIEW)
    bases = {variant.role: run for variant, run in found.items() if variant.role in named}
    shown = {REAL: (REAL, "measured", "none", real)} | {
        variant.name: (f"`{variant.role}`", variant.distance, PREVIEWS[variant.perfect], run)
        for variant, run in found.items()
    }
    for name, (control, distance, preview, run) in shown.items():
        labels = {"variant": name, "control": control, "distance": distance, "preview": preview}
        yield setting.labels | labels | figures_of(run, setting.scene, parameters, real, bases)


def _by_variant(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row per variant of driving: medians, sums of what counts, and savings with their quartiles."""
    variants = rows.groupby(["variant", "control", "distance", "preview"], sort=False)
    found = variants.median(numeric_only=True)
    for name in _SAVINGS:
        found[f"{name}_spread"] = variants[name].agg(spread, 1)
    found["collisions"] = variants.collided.sum()
    found["smallest_gap_m"] = variants.smallest_gap_m.min()
    found["emergencies"] = variants.emergency_s.agg(lambda seconds: (seconds > 0.0).sum())
    return found.reset_index().rename(columns={"variant": "name"})


def draw_picture(folder: Path, rows: pd.DataFrame) -> None:
    """Draw the spread over the lead vehicles as boxes from quartile to quartile, below a folder."""
    groups = rows.groupby(["car", "ambient_c"], sort=False)
    figure = Figure(figsize=(WIDTH_INCH, 2.6 * groups.ngroups), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(groups.ngroups, len(_PANELS), squeeze=False, sharey="row")
    for line, ((car, ambient_c), part) in zip(axes, groups, strict=True):
        variants = part.groupby("variant", sort=False)
        for axis, (name, label) in zip(line, _PANELS.items(), strict=True):
            is_saving = name in _SAVINGS
            values = [
                [] if is_saving and variant == REAL else one[name].dropna().tolist()
                for variant, one in variants
            ]
            if is_saving:
                axis.axvline(0.0, color="0.6", linewidth=0.8)
            axis.boxplot(values, orientation="horizontal", showfliers=False, widths=0.6)
            axis.set_xlabel(label)
            axis.grid(axis="x", alpha=0.3)
        line[0].set_yticks(np.arange(1, variants.ngroups + 1), list(variants.groups), fontsize=7)
        line[0].invert_yaxis()
        line[0].set_title(f"{car}, {ambient_c:g} °C", loc="left", fontsize="medium")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / PICTURE, metadata={"Software": None})
