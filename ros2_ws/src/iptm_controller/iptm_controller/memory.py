"""What a controller carries from one tick to the next, as one value: taken, given to another one, stored.

A controller that is given the memory of another one with the same options decides on as that one would.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from iptm_controller.actuation import ActuationMemory
from iptm_controller.estimator import EstimatorMemory
from iptm_controller.lead_check import LeadMemory
from iptm_controller.pack_observer import PackMemory
from iptm_controller.plan import Plan
from iptm_controller.preview_fusion import FusionMemory
from iptm_controller.preview_trust import TrustMemory
from iptm_controller.sender_clock import ClockMemory
from iptm_core.state import LeaderState, VehicleState


@dataclass(frozen=True)
class PaceMemory:
    """Of the road ahead: a driver at its limits at the last tick; ``is_held``: a lead vehicle was nearer."""

    time_s: float
    position_m: float
    speed_m_s: float
    is_held: bool


@dataclass(frozen=True)
class ControllerMemory:
    """Of a controller; the default is a controller that has not decided anything.

    Attributes:
        last_trusted: state that commands are limited against where none can be trusted.
        last_plan: newest usable plan.
        failures: ticks in a row without a usable plan.
        leader: lead vehicle that the collision guard measured last.
        leader_deceleration_m_s2: how hard it braked, not negative.
        lost_ticks: ticks without it since.
        trip_start: first state of the trip, from which the aging rate is averaged.
        foreseen_1_s: aging rate that was expected there.
        powers_w: traction powers of the trip so far.
        speeds_m_s: speeds at which they were measured.
        powers_until_s: when the newest one was measured.
        lead: lead vehicle by range sensor and by radio, see `iptm_controller.lead_check`.
        sender_clock: offset of the clock of who sends previews.
        leader_past: leader measured in the last seconds, oldest first.
        pace: of the road ahead, None where no rule has bound the vehicle.
        solves_since_second: of the check for better switching; None for one that has not solved anything.
    """

    last_trusted: VehicleState | None = None
    last_plan: Plan | None = None
    failures: int = 0
    leader: LeaderState | None = None
    leader_deceleration_m_s2: float = 0.0
    lost_ticks: int = 0
    trip_start: VehicleState | None = None
    foreseen_1_s: float = 0.0
    powers_w: tuple[float, ...] = ()
    speeds_m_s: tuple[float, ...] = ()
    powers_until_s: float = -math.inf
    lead: LeadMemory = field(default_factory=LeadMemory)
    sender_clock: ClockMemory = field(default_factory=ClockMemory)
    leader_past: tuple[LeaderState, ...] = ()
    fusion: FusionMemory = field(default_factory=FusionMemory)
    trust: TrustMemory = field(default_factory=TrustMemory)
    actuation: ActuationMemory = field(default_factory=ActuationMemory)
    pack: PackMemory = field(default_factory=PackMemory)
    estimator: EstimatorMemory = field(default_factory=EstimatorMemory)
    is_cooling: bool = False
    pace: PaceMemory | None = None
    solves_since_second: int | None = None
