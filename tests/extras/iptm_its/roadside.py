"""A roadside station on the test road for the tests of the receiver, and what it sends."""

from __future__ import annotations

from typing import Any

from tests.iptm_v2x_bridge.radio import ROAD

from iptm_core.routes.road_line import step_m
from iptm_its.mapem import SCALE_DEG, IntersectionMap, Lane
from iptm_its.spatem import (
    IntersectionPhases,
    Phase,
    SignalState,
)

HERE = (49, 7)
STATION = 1234
LINE_M = 500.0
GREEN, YELLOW, RED = SignalState.GREEN, SignalState.YELLOW, SignalState.RED
Stated = tuple[SignalState, float | None, float | None]
"""State, and after how many seconds it ends at the earliest and at the latest."""


def place_deg(along_m: float, left_m: float = 0.0) -> tuple[float, float]:
    """Return a place beside the test road, which leads north."""
    latitude, longitude, _ = ROAD.locate(along_m)
    per_degree, _ = step_m(float(latitude), float(longitude) + 1.0, (float(latitude), longitude))
    return float(latitude), float(longitude) - left_m / per_degree


def lane(
    number: int, nodes_m: tuple[tuple[float, float], ...], to_lane: int = 0, group: int = 1
) -> Lane:
    """Return a lane that leads to the intersection, with one connection."""
    return Lane(number, nodes_m, leads_in=True, connections=((to_lane, group),))


def lanes(*extra: Lane, revision: int = 3, line_m: float = LINE_M) -> IntersectionMap:
    """Return an intersection with the ego vehicle's lane, the one behind it, one beside and one across."""
    latitude, longitude = (
        round(value * SCALE_DEG) / SCALE_DEG for value in place_deg(line_m + 10.0)
    )
    found = (
        lane(1, ((0.0, -10.0), (0.0, -90.0), (0.0, -400.0)), 2, 1),
        Lane(2, ((0.0, 15.0), (0.0, 100.0)), leads_out=True),
        lane(3, ((-3.5, -10.0), (-3.5, -90.0)), 4, 2),
        lane(5, ((12.0, 0.0), (60.0, 0.0)), 2, 3),
        *extra,
    )
    return IntersectionMap(HERE, revision, latitude, longitude, found)


def phases(
    time_ms: int, *stated: Stated, groups: tuple[int, ...] = (1,), **more: Any
) -> IntersectionPhases:
    """Return the phases that signal groups have at an instant."""
    time_s = time_ms / 1000.0

    def mark(after_s: float | None) -> float | None:
        return None if after_s is None else time_s + after_s

    some = tuple(
        Phase(state, min_end_s=mark(earliest), max_end_s=mark(latest))
        for state, earliest, latest in stated
    )
    revision = more.pop("revision", 3)
    return IntersectionPhases(HERE, revision, time_ms, dict.fromkeys(groups, some), **more)
