"""Driving cycles, road slope and the motion of the preceding vehicle."""

from iptm_core.routes.comprehensive import RouteSegment, comprehensive_cycle
from iptm_core.routes.cycles import (
    CYCLE_NAMES,
    DrivingCycle,
    LeaderMotion,
    load_cycle,
    smooth_cycle,
)
from iptm_core.routes.route import ROUTE_CYCLES, SLOPE_CHOICES, Route, build_route
from iptm_core.routes.slope import SlopeProfile

__all__ = [
    "CYCLE_NAMES",
    "ROUTE_CYCLES",
    "SLOPE_CHOICES",
    "DrivingCycle",
    "LeaderMotion",
    "Route",
    "RouteSegment",
    "SlopeProfile",
    "build_route",
    "comprehensive_cycle",
    "load_cycle",
    "smooth_cycle",
]
