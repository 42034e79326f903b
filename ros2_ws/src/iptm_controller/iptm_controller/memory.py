"""What a controller carries from one tick to the next, as one value: taken, given to another one, stored.

A controller that is given the memory of another one with the same options decides on as that one would.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from iptm_controller.actuation import ActuationMemory
from iptm_controller.estimator import EstimatorMemory
from iptm_controller.plan import Plan
from iptm_controller.preview_fusion import FusionMemory
from iptm_controller.preview_trust import TrustMemory
from iptm_controller.temperature_value import ValuationMemory
from iptm_core.state import LeaderState, VehicleState


@dataclass(frozen=True)
class LadderMemory:
    """Of the fallback ladder: the newest usable plan, and how many ticks in a row had none."""

    last_good: Plan | None = None
    failures: int = 0


@dataclass(frozen=True)
class GuardMemory:
    """Of the collision guard: the leader measured last, how hard it braked, ticks without it since."""

    leader: LeaderState | None = None
    deceleration_m_s2: float = 0.0
    lost_ticks: int = 0


@dataclass(frozen=True)
class TractionMemory:
    """Of the traction forecast: powers and speeds of the trip so far, and when the newest was measured."""

    powers_w: tuple[float, ...] = ()
    speeds_m_s: tuple[float, ...] = ()
    last_s: float = -math.inf


@dataclass(frozen=True)
class PaceMemory:
    """Of the road ahead: a driver at its limits at the last tick; ``is_held``: a lead vehicle was nearer."""

    time_s: float
    position_m: float
    speed_m_s: float
    is_held: bool


@dataclass(frozen=True)
class ControllerMemory:
    """Of a controller; the default is that of one which has not decided anything.

    Attributes:
        last_trusted: state that commands are limited against where none can be trusted.
        leader_past: leader measured in the last seconds, oldest first.
        pace: of the road ahead, None where no rule has bound the vehicle.
        solves_since_second: of the check for better switching; None for one that has not solved anything.
    """

    last_trusted: VehicleState | None = None
    ladder: LadderMemory = field(default_factory=LadderMemory)
    guard: GuardMemory = field(default_factory=GuardMemory)
    valuation: ValuationMemory = field(default_factory=ValuationMemory)
    traction: TractionMemory = field(default_factory=TractionMemory)
    leader_past: tuple[LeaderState, ...] = ()
    fusion: FusionMemory = field(default_factory=FusionMemory)
    trust: TrustMemory = field(default_factory=TrustMemory)
    actuation: ActuationMemory = field(default_factory=ActuationMemory)
    estimator: EstimatorMemory = field(default_factory=EstimatorMemory)
    is_cooling: bool = False
    pace: PaceMemory | None = None
    solves_since_second: int | None = None
