"""Stretches of the host's road with a speed limit, out of the zones of speed signs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from iptm_core.road_ahead import SpeedLimits
from iptm_core.routes.road_line import RoadLine, step_m
from iptm_v2x_bridge.messages.ivim import SpeedSigns, SpeedZone, ZoneDirection
from iptm_v2x_bridge.prediction.speed_limits import NO_LIMITS
from iptm_v2x_bridge.roadside.stop_lines import is_same_way

MAX_ASIDE_M = 10.0
"""How far from the host's path the line of a zone may run; it may be that of another lane or of the road."""
SHORTEST_M = 1.0


@dataclass(frozen=True)
class Stretch:
    """A part of the host's road: its beginning and end along the road, and the limit on it."""

    from_m: float
    to_m: float
    limit_m_s: float


def stretches(road: RoadLine, signs: SpeedSigns) -> tuple[Stretch, ...]:
    """Return the zones that lie on the host's road all along and are relevant for its direction."""
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
