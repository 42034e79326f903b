"""A named stretch of a route."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RouteSegment:
    """One stretch of a route: which cycle is driven there and how hilly it is.

    Attributes:
        name: what is driven, for example ``"1: us06 S"``.
        cycle: name of the driving cycle of this stretch.
        slope_kind: ``"flat"``, ``"small"``, ``"large"`` or ``"measured"``.
        start_s: time at which the leader enters it.
        end_s: time at which the leader leaves it.
        start_m: distance that the leader has travelled at ``start_s``; the stretch of road with
            this slope starts at the same road position (0 = start of the host).
        end_m: distance that the leader has travelled at ``end_s``.
    """

    name: str
    cycle: str
    slope_kind: str
    start_s: float
    end_s: float
    start_m: float
    end_m: float
