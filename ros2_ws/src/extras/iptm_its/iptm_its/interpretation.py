"""Messages of the roadside as seen from the road: stop lines, and when they are closed.

For an ego vehicle that keeps the rules a line is open only while it is certainly open: from the latest end of
the previous phase to the earliest end of the open one; unknown times count as closed. The leader's prediction
uses likely times; unknown times do not constrain it, as its bound covers them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from iptm_core.routes.road_line import RoadFix, RoadLine, step_deg
from iptm_its.mapem import IntersectionMap, Lane
from iptm_its.spatem import IntersectionId, IntersectionPhases, Phase
from iptm_v2x_bridge.prediction.road_rules import Span
from iptm_v2x_bridge.stations.station import LANE_HALF_WIDTH_M, MAX_HEADING_APART_DEG

SAME_LINE_M = 10.0
"""Stop lines nearer to each other than this are one, which is where the first of them is."""


@dataclass(frozen=True)
class StopLine:
    """A line that the ego vehicle has to pass.

    Attributes:
        position_m: along the ego vehicle's road.
        intersection: which it belongs to.
        revision: of its map.
        groups: signal groups that all have to be open.
    """

    position_m: float
    intersection: IntersectionId
    revision: int
    groups: frozenset[int]


def stop_lines(road: RoadLine, found: IntersectionMap) -> tuple[StopLine, ...]:
    """Return the lines of an intersection that lie on the ego vehicle's road, in driving order.

    A lane counts where its first node is in the ego vehicle's lane and it leads along the road, just as a
    station does. Of its connections those count that lead into lanes which begin on the ego vehicle's road
    ahead of the line; where none does, any of them may be the ego vehicle's, and all have to be open.
    """
    seen = _seen(road, found)
    out = {lane.number for lane in found.lanes if lane.leads_out and _is_along(lane, seen, -1.0)}
    lines = []
    for lane in found.lanes:
        if not (lane.leads_in and _is_along(lane, seen, 1.0)):
            continue
        position_m = seen[lane.number][0].position_m
        ours = [
            (to_lane, group)
            for to_lane, group in lane.connections
            if to_lane in out and seen[to_lane][0].position_m > position_m
        ]
        groups = {group for _, group in ours or lane.connections}
        lines.append((position_m, {group for group in groups if group is not None}))
    joined: list[tuple[float, set[int]]] = []
    for position_m, some in sorted(lines, key=lambda line: line[0]):
        if not some:
            continue  # no signal holds vehicles there
        if joined and position_m - joined[-1][0] < SAME_LINE_M:
            joined[-1][1].update(some)
        else:
            joined.append((position_m, some))
    return tuple(
        StopLine(position_m, found.intersection, found.revision, frozenset(some))
        for position_m, some in joined
    )


def _seen(road: RoadLine, found: IntersectionMap) -> dict[int, tuple[RoadFix, float]]:
    """Return of each lane its first node as seen from the road, and its heading from there on, in degrees."""
    first = np.array([lane.nodes_m[0] for lane in found.lanes]).reshape(-1, 2)
    onward = np.array([lane.nodes_m[1] for lane in found.lanes]).reshape(-1, 2) - first
    headings = np.degrees(np.arctan2(onward[:, 0], onward[:, 1])).tolist()
    here = np.full(len(first), found.latitude_deg), np.full(len(first), found.longitude_deg)
    places = np.stack(step_deg(*here, first[:, 0], first[:, 1]), axis=-1).tolist()
    return {
        lane.number: (road.project(*place), heading)
        for lane, place, heading in zip(found.lanes, places, headings, strict=True)
    }


def _is_along(lane: Lane, seen: dict[int, tuple[RoadFix, float]], way: float) -> bool:
    """Return whether a lane begins in the ego's lane and runs (-1) along the road or (1) against it."""
    fix, heading = seen[lane.number]
    driven = heading if way < 0.0 else heading + 180.0
    return abs(fix.lateral_m) <= LANE_HALF_WIDTH_M and is_same_way(driven, fix.heading_deg)


def is_same_way(heading_deg: float, road_heading_deg: float) -> bool:
    """Return whether a heading follows the road."""
    apart = float(np.mod(heading_deg - road_heading_deg + 180.0, 360.0)) - 180.0
    return abs(apart) < MAX_HEADING_APART_DEG


EARLY_OPENING_S = 1.0
"""Tolerance for a signal that opens before the earliest end of its closed phase (rounding, clock error)."""


def surely_closed(phases: Sequence[Phase]) -> list[Span]:
    """Return when a line is not sure to be open."""
    closed: list[Span] = []
    open_until = certain = -math.inf
    for phase in phases:
        begins, ends = certain, phase.min_end_s
        if phase.state.is_open and ends is not None and ends > begins:
            closed.append((open_until, begins))
            open_until = ends
        after = phase.max_end_s
        if after is None or math.isinf(after):
            break
        certain = max(after, certain)
    closed.append((open_until, math.inf))
    return [span for span in closed if span[0] < span[1]]


def likely_closed(phases: Sequence[Phase]) -> list[Span]:
    """Return when a line is likely to be closed."""
    closed = []
    begins = -math.inf
    for phase in phases:
        ends = phase.expected_end_s
        if ends is None:
            break
        if phase.state.is_open is False and ends > begins:
            closed.append((begins, ends))
        begins = max(ends, begins)
    return closed


def joined(spans: Iterable[Span]) -> tuple[Span, ...]:
    """Return spans without overlaps, in order."""
    found: list[Span] = []
    for begins, ends in sorted(spans):
        if found and begins <= found[-1][1]:
            found[-1] = found[-1][0], max(ends, found[-1][1])
        else:
            found.append((begins, ends))
    return tuple(found)


def opens_too_early(before: IntersectionPhases, after: IntersectionPhases) -> bool:
    """Return whether a signal opens before the announced earliest end of its closed phase.

    An early closing is accepted.
    """
    sent_s = after.sent_ms / 1000.0
    for group, phases in after.groups.items():
        known = before.groups.get(group)
        if not (known and phases and phases[0].state.is_open and known[0].state.is_open is False):
            continue
        earliest = known[0].min_end_s
        if earliest is not None and sent_s < earliest - EARLY_OPENING_S:
            return True
    return False
