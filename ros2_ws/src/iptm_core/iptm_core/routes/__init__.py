"""Driving cycles, road slope and the motion of the preceding vehicle."""

from iptm_core.routes.comprehensive import RouteSegment as RouteSegment
from iptm_core.routes.comprehensive import comprehensive_cycle as comprehensive_cycle
from iptm_core.routes.cycles import CYCLE_NAMES as CYCLE_NAMES
from iptm_core.routes.cycles import DrivingCycle as DrivingCycle
from iptm_core.routes.cycles import LeaderMotion as LeaderMotion
from iptm_core.routes.cycles import load_cycle as load_cycle
from iptm_core.routes.cycles import smooth_cycle as smooth_cycle
from iptm_core.routes.route import ROUTE_CYCLES as ROUTE_CYCLES
from iptm_core.routes.route import SLOPE_CHOICES as SLOPE_CHOICES
from iptm_core.routes.route import Route as Route
from iptm_core.routes.route import build_route as build_route
from iptm_core.routes.slope import SlopeProfile as SlopeProfile
