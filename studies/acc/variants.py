"""Settings and variants of driving behind measured lead vehicles, and the search for the real headway."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from studies.acc.scenes import Scene
from studies.drives import DEFAULT, climate, trip
from studies.savings import (
    BASELINE,
    PREVIEWS,
    PRODUCTION,
    PRODUCTION_SIMPLE,
    RULE_PREVIEW,
    road_taken,
)
from studies.session import Case, Session

import iptm
from iptm_core.parameters import DEFAULT_SET, load_parameters
from iptm_core.parameters.model import ModelParameters

SHORTEST_HEADWAY_S, LONGEST_HEADWAY_S = 0.3, 1.5
ROOM_S = 0.25
"""Time headway between the lower limit of the gap and the desired one."""
ROUNDS = 3
CLOSE_S = 0.1
"""Difference of the median headways at which the search ends."""
EQUAL_S = 0.2
"""Difference that counts as equal: in the median over the scenes."""

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
    Variant(PRODUCTION_SIMPLE, "1.6 s", perfect=False),
    Variant(RULE_PREVIEW, "1.6 s", perfect=True),
    EQUAL_HEADWAY,
    Variant(BASELINE, "3.5 s", perfect=False),
    Variant(DEFAULT, EQUAL, perfect=False),
    Variant(DEFAULT, "120 m", perfect=False),
    Variant(DEFAULT, "120 m", perfect=True),
)


def headway_overrides(desired_s: float) -> dict[str, float]:
    """Return a desired time headway, and the lower limit of the gap below it, at most the shipped one."""
    lower_s = min(max(desired_s - ROOM_S, SHORTEST_HEADWAY_S), LONGEST_HEADWAY_S)
    return {
        "gap.desired_time_headway_s": round(desired_s, 2),
        "gap.time_headway_s": round(lower_s, 2),
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

    def case(self, variant: Variant, folder: Path, desired_s: float) -> Case:
        """Return a trip; the drive of the lead vehicle is written to a folder."""
        labels = {**self.labels, "variant": variant.name}
        equal = variant.distance == EQUAL
        call = trip(
            self.scene.write(folder),
            variant.role,
            self.car,
            self.ambient_c,
            headway_overrides(desired_s) if equal else None,
            duration_s=float(self.scene.duration_s),
            preview_mode="full" if variant.perfect else "none",
            value_beyond_trip=equal,
        )
        name = f"{self.scene.name}/{self.car}/{self.ambient_c:g}/{variant.name}/{desired_s:.2f}"
        return Case(name, labels, call)

    @property
    def headway_s(self) -> float:
        """The real follower's median time headway."""
        return float(np.median(self.scene.headways_s))


def equal_headways(session: Session, settings: Sequence[Setting], rounds: int) -> list[float]:
    """Return the desired headways with which the default, given a preview, has the real median headway.

    Each is moved by what the trip before it was off, until it is off by `CLOSE_S` or all rounds are driven;
    the nearest of the trips counts.
    """
    desired_s = [
        setting.headway_s
        - load_parameters(setting.car).values.gap.standstill_gap_m / setting.scene.mean_speed_m_s
        for setting in settings
    ]
    best = [(np.inf, each_s) for each_s in desired_s]
    for _ in range(rounds):
        open_ones = [place for place, (off_s, _) in enumerate(best) if off_s > CLOSE_S]
        cases = [
            settings[place].case(EQUAL_HEADWAY, session.scratch / "leads", desired_s[place])
            for place in open_ones
        ]
        for place, run in zip(open_ones, driven(session, cases), strict=True):
            if run is None:
                continue
            begin = settings[place].scene.run_in_s
            off_s = road_taken([run.trajectory], begin)["headway_s"] - settings[place].headway_s
            best[place] = min(best[place], (abs(off_s), desired_s[place]))
            desired_s[place] = max(desired_s[place] - off_s, SHORTEST_HEADWAY_S + ROOM_S)
    return [each_s for _, each_s in best]


def driven(session: Session, cases: Sequence[Case]) -> list[iptm.Run | None]:
    """Return the runs of cases."""
    if session.short:
        cases = [case.shortened(case.call["duration_s"]) for case in cases]
    return list(session.drive(cases).run) if cases else []
