"""The platoons of OpenACC as a law of car following takes them: leader, vehicle ahead, what came next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from studies.validation import excerpts
from studies.validation.excerpts import OPENACC_STEP_S

from iptm_core.state import FloatArray
from iptm_its.car_following import PAST_S, Past

LEADS_S = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
PER_S = round(1.0 / OPENACC_STEP_S)
CAR_LENGTH_M = 4.5
MOVING_M_S = 1.0
HELD_OUT = (
    "long_setting__handling_part25",
    "mixed__dynamic_part7",
    "no_ACC__handling_part22",
    "short_setting__dynamic_part1",
    "short_setting__handling_part16",
)
"""Runs that the shipped law has not seen: each kind of setting, people, and both tracks."""
FITTED_TO = (
    "OpenACC, an open database of car-following experiments (Joint Research Centre, 2019, CC BY 4.0),"
    " all runs of the excerpt but " + ", ".join(HELD_OUT)
)


@dataclass(frozen=True, eq=False)
class Instants:
    """Once a second, a leader in a platoon.

    Attributes:
        run: recording, shape (n,).
        past: leader and the vehicle ahead of it.
        speeds_m_s: of the leader at `LEADS_S`, shape (n, leads).
        driven_m: distance that it drove by then, shape (n, leads).
    """

    run: NDArray[np.str_]
    past: Past
    speeds_m_s: FloatArray
    driven_m: FloatArray

    def where(self, chosen: NDArray[Any]) -> Instants:
        """Return some of them."""
        past = Past(*(column[chosen] for column in self.past))
        return Instants(self.run[chosen], past, self.speeds_m_s[chosen], self.driven_m[chosen])


def joined(parts: Sequence[Instants]) -> Instants:
    """Return the instants of several together."""
    past = Past(
        *(np.concatenate(columns) for columns in zip(*(each.past for each in parts), strict=True))
    )
    runs, speeds, driven = (
        np.concatenate([getattr(each, name) for each in parts])
        for name in ("run", "speeds_m_s", "driven_m")
    )
    return Instants(runs, past, speeds, driven)


@cache
def instants(vehicles_ahead: int = 1) -> Instants:
    """Return every second of every platoon in which leader and vehicle ahead are measured for long enough.

    Args:
        vehicles_ahead: 1 for the vehicle ahead of the leader, 2 for the one ahead of that, as a message of it
            shows it when the one between sends none.
    """
    by_name = {drive.name: drive for drive in excerpts.drives() if drive.gap_m is not None}
    found = []
    for name, own in by_name.items():
        run, place = name.rsplit("/", 1)
        ahead = [
            by_name.get(f"{run}/{int(place) - place_ahead}")
            for place_ahead in range(vehicles_ahead)
        ]
        gaps = [each.gap_m for each in ahead if each is not None and each.gap_m is not None]
        last = ahead[-1]
        if len(gaps) < vehicles_ahead or last is None or last.leader_speed_m_s is None:
            continue
        count = min(gap.size for gap in gaps)
        gap = np.sum([gap[:count] for gap in gaps], axis=0) + (vehicles_ahead - 1) * CAR_LENGTH_M
        found.append((run, *_of_pair(own.speed_m_s, last.leader_speed_m_s, gap)))
    runs = np.concatenate([np.full(len(past[0]), run) for run, past, *_ in found])
    past = Past(
        *(np.concatenate(columns) for columns in zip(*(each[1] for each in found), strict=True))
    )
    return Instants(runs, past, *(np.concatenate([each[k] for each in found]) for k in (2, 3)))


def _of_pair(
    speed: FloatArray, ahead: FloatArray, gap: FloatArray
) -> tuple[Past, FloatArray, FloatArray]:
    count = min(speed.size, ahead.size, gap.size)
    speed, ahead, gap = speed[:count], ahead[:count], gap[:count]
    before, after = PAST_S * PER_S, round(LEADS_S[-1]) * PER_S
    now = np.arange(before, count - after, PER_S)
    past = [column[now[:, None] - PER_S * np.arange(PAST_S + 1)] for column in (speed, ahead, gap)]
    future = speed[now[:, None] + np.arange(after + 1)]
    whole = np.isfinite(np.hstack([*past, future])).all(axis=1) & (
        future.max(axis=1, initial=0.0) > MOVING_M_S
    )
    driven = np.cumsum(0.5 * (future[:, 1:] + future[:, :-1]) * OPENACC_STEP_S, axis=1)
    leads = np.array([round(lead_s) * PER_S for lead_s in LEADS_S])
    v, u, g = (column[whole] for column in past)
    return (
        Past(v, u, g, np.ones_like(v)),
        future[whole][:, leads],
        driven[whole][:, leads - 1],
    )
