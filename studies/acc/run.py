"""What is saved behind measured lead vehicles at the headway of the cars that followed them there."""

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
from studies.acc.figures import REAL, figures_of, spread
from studies.acc.scenes import RUN_IN_S, SHORTEST_S, Scene, long_scenes
from studies.drives import DEFAULT, climate, trip
from studies.savings import BASELINE, BASES, COLUMNS, PREVIEWS, PRODUCTION, road_taken
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


SMALL_INITIAL_GAP_M = 8.0
"""Gap at standstill with a largest time headway, which does not count below it."""
SHORTEST_HEADWAY_S, LONGEST_HEADWAY_S = 0.3, 1.5
ROOM_S = 0.3
"""Time headway between the lower and the upper limit of the gap at the mean speed."""
FIRST_MORE_S = 0.2
"""Largest headway beyond the real follower's median with which the search for it begins."""
ROUNDS = 3
CLOSE_S = 0.1
"""Difference of the median headways at which the search ends."""
EQUAL_S = 0.2
"""Difference that counts as equal: in the median over the scenes."""
FOLLOWED_EXACTLY = {
    "limits.min_acceleration_m_s2": -8.0,
    "limits.max_acceleration_m_s2": 12.0,
    "limits.max_jerk_m_s3": 50.0,
}
"""The real follower is not held to the limits of comfort."""


CARS = (DEFAULT_SET, "bmw_i3")
CLIMATES_C = (35.0, 25.0)
"""Temperature of the air and of the cells at the start."""


def parameters_of(
    car: str, ambient_c: float, overrides: Mapping[str, float] | None = None
) -> ModelParameters:
    """Return the parameters of a car in a climate, some of them replaced."""
    return load_parameters(car, {**climate(ambient_c), **(overrides or {})}).values


@dataclass(frozen=True)
class Variant:
    """A variant of driving behind the lead vehicles.

    Attributes:
        role: of the controller, one of `STRATEGIES`.
        distance: for tables.
        perfect: whether the lead vehicle's future is known.
    """

    role: str
    distance: str
    perfect: bool

    @property
    def name(self) -> str:
        """For labels and the picture."""
        return f"{self.role}, {self.distance}, preview {PREVIEWS[self.perfect]}"


EQUAL = "real headway"
EQUAL_HEADWAY = Variant(DEFAULT, EQUAL, perfect=True)
VARIANTS = (
    Variant(PRODUCTION, "1.6 s", perfect=False),
    EQUAL_HEADWAY,
    Variant(BASELINE, "3.5 s", perfect=False),
    Variant(DEFAULT, EQUAL, perfect=False),
    Variant(DEFAULT, "120 m", perfect=False),
    Variant(DEFAULT, "120 m", perfect=True),
)


def headway_overrides(scene: Scene, car: str, largest_s: float) -> dict[str, float]:
    """Return gap limits with a largest time headway.

    Where the lower limit would be above the upper one at the mean speed, its time headway is cut.
    """
    standstill_m = load_parameters(car).values.gap.standstill_gap_m
    room_s = largest_s - standstill_m / scene.mean_speed_m_s - ROOM_S
    return {
        "gap.max_time_headway_s": round(largest_s, 2),
        "gap.time_headway_s": round(min(max(room_s, SHORTEST_HEADWAY_S), LONGEST_HEADWAY_S), 2),
        "gap.initial_gap_m": SMALL_INITIAL_GAP_M,
    }


@dataclass(frozen=True)
class Setting:
    """A scene, a car and a climate."""

    scene: Scene
    car: str
    ambient_c: float

    @property
    def labels(self) -> dict[str, Any]:
        """What tables group it by."""
        return {"scene": self.scene.name, "car": self.car, "ambient_c": self.ambient_c}

    def case(self, variant: Variant, folder: Path, largest_s: float) -> Case:
        """Return a trip; the drive of the lead vehicle is written to a folder."""
        labels = {**self.labels, "variant": variant.name}
        limits = headway_overrides(self.scene, self.car, largest_s)
        call = trip(
            self.scene.write(folder),
            variant.role,
            self.car,
            self.ambient_c,
            limits if variant.distance == EQUAL else None,
            duration_s=float(self.scene.duration_s),
            preview_mode="full" if variant.perfect else "none",
        )
        name = f"{self.scene.name}/{self.car}/{self.ambient_c:g}/{variant.name}/{largest_s:.2f}"
        return Case(name, labels, call)

    def headway_s(self) -> float:
        """Return the real follower's median time headway."""
        return float(np.median(self.scene.headways_s))


def equal_headways(session: Session, settings: Sequence[Setting], rounds: int) -> list[float]:
    """Return the largest headways with which the default, given a preview, has the real median headway.

    Each is moved by what the trip before it was off, until it is off by `CLOSE_S` or all rounds are driven;
    the nearest of the trips counts.
    """
    limits_s = [setting.headway_s() + FIRST_MORE_S for setting in settings]
    best = [(np.inf, limit_s) for limit_s in limits_s]
    for _ in range(rounds):
        open_ones = [place for place, (off_s, _) in enumerate(best) if off_s > CLOSE_S]
        cases = [
            settings[place].case(EQUAL_HEADWAY, session.scratch / "leads", limits_s[place])
            for place in open_ones
        ]
        for place, run in zip(open_ones, _driven(session, cases), strict=True):
            if run is None:
                continue
            begin = settings[place].scene.run_in_s
            off_s = road_taken([run.trajectory], begin)["headway_s"] - settings[place].headway_s()
            best[place] = min(best[place], (abs(off_s), limits_s[place]))
            limits_s[place] = max(limits_s[place] - off_s, SHORTEST_HEADWAY_S + ROOM_S)
    return [limit_s for _, limit_s in best]


def _driven(session: Session, cases: Sequence[Case]) -> list[iptm.Run | None]:
    """Return the runs of cases; in the short form with an interpreted solver."""
    if session.short:
        cases = [case.shortened(case.call["duration_s"]) for case in cases]
    return list(session.drive(cases).run) if cases else []


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


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this study."""
    parser.add_argument(
        "--measured",
        type=Path,
        metavar="DIR",
        help="folder with OpenACC files (default: the excerpts of the project)",
    )


def run(session: Session) -> bool:
    """Run the study; returns whether the real headway was met, and no lead vehicle touched.

    Raises:
        ScenarioError: a car and a climate have no scene with all of their trips.
    """
    cars, climates_c = (CARS[-1:], CLIMATES_C[:1]) if session.short else (CARS, CLIMATES_C)
    count, seconds = (SHORT_SCENES, SHORTEST_S) if session.short else (LONG_SCENES, LONG_S)
    scenes, pairs = long_scenes(session.options.measured, session.say, count, seconds)
    settings = [Setting(scene, car, c) for car, c, scene in product(cars, climates_c, scenes)]
    limits_s = equal_headways(session, settings, 1 if session.short else ROUNDS)
    cases = [
        setting.case(variant, session.scratch / "leads", limit_s)
        for setting, limit_s in zip(settings, limits_s, strict=True)
        for variant in VARIANTS
    ]
    runs = _driven(session, cases)
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
        columns=COLUMNS,
        scenes=len(scenes),
        pairs=pairs,
        collisions=int(rows.collided.sum()),
        minutes=seconds / 60.0,
        run_in_s=RUN_IN_S,
        off_s=off_s,
        production_s=_headway_s(rows, PRODUCTION),
        baseline_s=_headway_s(rows, BASELINE),
        equal_s=EQUAL_S,
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


def _figures(setting: Setting, driven: Sequence[iptm.Run | None]) -> Iterator[dict[str, Any]]:
    """Yield the figures of all variants of driving, if all of their trips are there."""
    found = {
        variant: one.trajectory
        for variant, one in zip(VARIANTS, driven, strict=True)
        if one is not None
    }
    if len(found) < len(VARIANTS):
        return
    real = real_follower(setting.scene, setting.car, setting.ambient_c)
    parameters = parameters_of(setting.car, setting.ambient_c)
    bases = {variant.role: run for variant, run in found.items() if variant.role in BASES}
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
