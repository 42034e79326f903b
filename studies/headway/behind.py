"""The cars behind: strings in which some cars have the controller and the others drive by `production`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
from studies.acc.variants import CLIMATES_C
from studies.drives import DEFAULT, trip
from studies.road_space.run import EQUAL
from studies.savings import PRODUCTION, road_taken, saved
from studies.session import Session

import iptm
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_string.headless import drive_string_in_memory

CYCLES = ("wltc_class3b", "us06")
STRING_CARS = 20
EVERY = {"5 %": STRING_CARS, "20 %": 5, "100 %": 1}
"""Distance between equipped cars in the string by their share; the first one is equipped."""
BEHIND = slice(1, 11)
SHORT_CARS, SHORT_S = 3, 60.0


def drive_mixed(
    cycle: str, equipped: Sequence[bool], settings: Mapping[str, Any]
) -> list[iptm.Run]:
    """Drive a string without a preview of its first leader; plans of equipped cars are heard behind them.

    Args:
        equipped: per car, the first one first.
        settings: of all trips.
    """
    trips = {
        True: iptm.Trip.of(**trip(cycle, DEFAULT, ambient_c=CLIMATES_C[0], **EQUAL, **settings)),
        False: iptm.Trip.of(**trip(cycle, PRODUCTION, ambient_c=CLIMATES_C[0], **settings)),
    }
    drivers = [trips[each] for each in equipped]
    return list(drive_string_in_memory(drivers[0], len(drivers), drivers))


def cars_behind(session: Session) -> list[dict[str, Any]]:
    """Return a row per cycle and share of equipped cars, against a string that drives by `production`."""
    cars = SHORT_CARS if session.short else STRING_CARS
    settings: dict[str, Any] = {"preview_mode": "none"}
    if session.short:
        settings["duration_s"] = SHORT_S
    strings = {"0 %": [False] * cars}
    strings |= {
        share: [place % every == 0 for place in range(cars)] for share, every in EVERY.items()
    }
    places = list(product(CYCLES[-1:] if session.short else CYCLES, strings))
    calls = [
        {"cycle": cycle, "equipped": strings[share], "settings": settings}
        for cycle, share in places
    ]
    names = [f"string of {cycle}, {share} equipped" for cycle, share in places]
    driven = dict(zip(places, session.compute(drive_mixed, calls, names), strict=True))
    return [
        {"cycle": cycle, "share": share, **_against(driven[cycle, share], driven[cycle, "0 %"])}
        for cycle, share in places
        if share in EVERY and driven[cycle, share] and driven[cycle, "0 %"]
    ]


def _against(string: Sequence[iptm.Run], base: Sequence[iptm.Run]) -> dict[str, float]:
    """Return what a string saves against another one: its first car, the ten behind it, and all."""
    parts = {"first": slice(1), "ten": BEHIND, "fleet": slice(None)}
    flows, late_s = [], []
    for runs in (string, base):
        flows.append(road_taken([run.trajectory for run in runs])["vehicles_h"])
        last = runs[-1].trajectory
        late_s.append(
            float(np.interp(0.9 * base[-1].metrics.distance_m, _way_m(last), last.time_s))
        )
    return {
        **{
            f"{part}_{kind}": percent
            for part, cars in parts.items()
            for kind, percent in saved(
                [run.metrics for run in string[cars]],
                [run.metrics for run in base[cars]],
                base[0].parameters,
            ).items()
        },
        "flow": 100.0 * flows[0] / flows[1],
        "late_s": late_s[0] - late_s[1],
        "smallest_gap_m": min(float(run.trajectory.gap_m.min()) for run in string),
        "interventions": float(sum(run.metrics.interventions for run in string)),
        "base_interventions": float(sum(run.metrics.interventions for run in base)),
    }


def _way_m(motion: Trajectory) -> FloatArray:
    way_m: FloatArray = motion.position_m - motion.position_m[0]
    return way_m
