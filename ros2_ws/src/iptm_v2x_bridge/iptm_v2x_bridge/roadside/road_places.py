"""Messages of the roadside as seen from the ego's road: stop lines of lanes, stretches of speed signs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from iptm_core.road_ahead import SpeedLimits
from iptm_core.routes.road_line import RoadFix, RoadLine, step_deg, step_m
from iptm_v2x_bridge.messages.ivim import SpeedSigns, SpeedZone, ZoneDirection
from iptm_v2x_bridge.messages.mapem import IntersectionMap, Lane
from iptm_v2x_bridge.messages.spatem import IntersectionId
from iptm_v2x_bridge.prediction.road_rules import NO_LIMITS
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
            entry
            for entry in lane.connections
            if entry.to_lane in out and seen[entry.to_lane][0].position_m > position_m
        ]
        groups = {entry.signal_group for entry in ours or lane.connections}
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
    """Return whether a heading is that of the road."""
    apart = float(np.mod(heading_deg - road_heading_deg + 180.0, 360.0)) - 180.0
    return abs(apart) < MAX_HEADING_APART_DEG


MAX_ASIDE_M = 10.0
"""How far from the ego's path the line of a zone may run; it may be that of another lane or of the road."""
SHORTEST_M = 1.0


@dataclass(frozen=True)
class Stretch:
    """A part of the ego vehicle's road: its beginning and end along the road, and the limit on it."""

    from_m: float
    to_m: float
    limit_m_s: float


def stretches(road: RoadLine, signs: SpeedSigns) -> tuple[Stretch, ...]:
    """Return the zones that lie on the ego vehicle's road all along and are relevant for its direction."""
    found = (_stretch(road, zone) for zone in signs.zones)
    return tuple(stretch for stretch in found if stretch is not None)


def _stretch(road: RoadLine, zone: SpeedZone) -> Stretch | None:
    fixes = [road.project(*zone.places_deg[0])]
    turned_deg = []
    for before, after in zip(zone.places_deg, zone.places_deg[1:], strict=False):
        fixes.append(road.project(*after, near_m=fixes[-1].position_m))
        east, north = step_m(*after, before)
        turned_deg.append(math.degrees(math.atan2(east, north)))
    if any(abs(fix.lateral_m) > MAX_ASIDE_M for fix in fixes):
        return None
    ends = fixes[0].position_m, fixes[-1].position_m
    along = all(
        is_same_way(heading, fix.heading_deg)
        for heading, fix in zip(turned_deg, fixes[1:], strict=True)
    )
    against = all(
        is_same_way(heading + 180.0, fix.heading_deg)
        for heading, fix in zip(turned_deg, fixes[1:], strict=True)
    )
    relevant = {
        ZoneDirection.OPPOSITE: against,
        ZoneDirection.BOTH: along or against,
    }.get(zone.direction, along)
    if not relevant or abs(ends[1] - ends[0]) < SHORTEST_M:
        return None
    return Stretch(min(ends), max(ends), zone.limit_m_s)


def limits_with(given: SpeedLimits | None, heard: Sequence[Stretch]) -> SpeedLimits | None:
    """Return the limits: the lowest received one on stretches with signs, elsewhere the given ones."""
    if not heard:
        return given
    known = given or NO_LIMITS
    before_m = min(known.starts_m[0], *(stretch.from_m for stretch in heard)) - SHORTEST_M
    places = {before_m, *known.starts_m.tolist()}
    places |= {place for stretch in heard for place in (stretch.from_m, stretch.to_m)}
    starts = sorted(places)
    limits = []
    for start in starts:
        received = [
            stretch.limit_m_s for stretch in heard if stretch.from_m <= start < stretch.to_m
        ]
        index = max(int(np.searchsorted(known.starts_m, start, side="right")) - 1, 0)
        limits.append(min(received, default=float(known.limits_m_s[index])))
    return SpeedLimits(np.array(starts), np.array(limits))
