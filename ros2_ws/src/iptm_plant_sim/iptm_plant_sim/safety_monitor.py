"""Safety monitor of the vehicle: worst-case reasoning from what is measured now, without any prediction.

The rule is the safe longitudinal distance of responsibility-sensitive safety (RSS): S. Shalev-Shwartz,
S. Shammah, A. Shashua, "On a formal model of safe and scalable self-driving cars", arXiv:1708.06374 (2017),
definition 1, with the assumptions that IEEE 2846-2022 names: the vehicle ahead may brake with its hardest
deceleration from now on; the ego vehicle continues at its present acceleration for the reaction time and
brakes then. UN R157 has the same form. Other than in definition 1 the brakes have a delay and build up.

The rule holds on the present road. Where its friction is known, both decelerations are limited by that
road. Where it is not, the rule is asked twice: for a dry road, and for a slippery one, on which both vehicles
brake badly. The first one calls for full braking, the second one for what a slippery road gives. A descent
takes as much from both vehicles on either road. The second rule counts it without the reaction time, which is
a reserve: usual driving downhill does not keep both. A vehicle ahead that is seen to brake harder than a
slippery road permits has a dry one under it, or better tyres; the ego vehicle may still be on the slippery
one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from iptm_core.braking import (
    RELIED_SHARE,
    SLIPPERY_LEAD_SHARE,
    BrakingCapability,
    SafetyMonitorSettings,
    braking_capability,
)
from iptm_core.frozen import replace
from iptm_core.lead_track import LeadTrack
from iptm_core.parameters.model import BrakeParameters
from iptm_core.radio_lead import RadioLead
from iptm_core.state import ROUNDING_S, LeaderState

SHARE_TIME_CONSTANT_S = 0.3
"""Time constant of the estimated brake share, which settles within 1 s of braking."""
LEAST_SHARE = 0.1
JUDGED_FROM_M_S2 = 0.3
JUDGED_FROM_M_S = 0.5
"""Smallest requested deceleration and speed at which the brake share is estimated."""
DELIVERED_SHARE = 0.95
"""Brakes that deliver at least this share of a request follow it."""
SATURATED_SHARE = 1.2
"""Brakes that deliver no more than this times what they once delivered in full have met the limit of the
road; weak brakes fall short of gentle requests as well."""
HARDER_SHARE = 1.4
"""A vehicle ahead brakes harder than a slippery road permits from this times that deceleration on: 4.1 m/s^2
with the default settings, more than in any published cycle and beyond noise of its measured speed; no less
downhill, although a slippery road permits less there."""
WAITED_S = 0.3
"""Part of the reaction time that may pass while a measurement is awaited; the monitor itself needs less."""


@dataclass(frozen=True)
class MonitorMemory:
    """What monitor and brakes carry from one instant to the next.

    Attributes:
        braking: the monitor brakes.
        gently: it brakes with what a slippery road gives, not fully.
        since_s: trip time of its request to brake; of the last one while it does not brake.
        reason: the numbers behind that request, empty before the first one.
        requested_m_s2: acceleration that is requested at present, after delay and build-up of the brakes.
        brake_share: share of the requested deceleration that the brakes deliver, as estimated.
        followed_m_s2: hardest deceleration that the brakes delivered in full.
        road_m_s2: deceleration at which the road met its limit, 0 where it has not.
        lead: the vehicle ahead.
        radio: the same by its newest message, None before the first one.
    """

    braking: bool = False
    gently: bool = False
    since_s: float = 0.0
    reason: str = ""
    requested_m_s2: float = 0.0
    brake_share: float = 1.0
    followed_m_s2: float = 0.0
    road_m_s2: float = 0.0
    lead: LeadTrack = field(default_factory=LeadTrack)
    radio: RadioLead | None = None


def stopping_distance_m(
    speed_m_s: float,
    acceleration_m_s2: float,
    wait_s: float,
    deceleration_m_s2: float,
    build_up_m_s3: float,
) -> float:
    """Return the distance to standstill of a vehicle that brakes after a while.

    Args:
        acceleration_m_s2: acceleration now, kept until the brakes act.
        wait_s: time until the brakes act.
        deceleration_m_s2: deceleration of the brakes, positive.
        build_up_m_s3: rate at which it builds up.
    """
    a, speed = acceleration_m_s2, speed_m_s
    if speed + a * wait_s <= 0.0:
        return speed * speed / (-2.0 * a) if a < 0.0 else 0.0
    distance = wait_s * (speed + 0.5 * a * wait_s)
    speed += a * wait_s
    if a > -deceleration_m_s2:
        rise_s = (a + deceleration_m_s2) / build_up_m_s3
        after = speed + rise_s * (a - 0.5 * build_up_m_s3 * rise_s)
        if after <= 0.0:
            rise_s = (a + math.sqrt(a * a + 2.0 * build_up_m_s3 * speed)) / build_up_m_s3
        distance += rise_s * (speed + rise_s * (0.5 * a - build_up_m_s3 * rise_s / 6.0))
        speed = max(after, 0.0)
    return distance + speed * speed / (2.0 * deceleration_m_s2)


@dataclass(frozen=True)
class RoadBraking:
    """What both vehicles can do at a place.

    Attributes:
        full: at best.
        slippery: if it is slippery, a descent not counted; None where friction is known.
        better_grip_m_s2: deceleration beyond which the vehicle ahead has a better road.
        descent: if it is slippery, as it descends; None where it does not.
    """

    full: BrakingCapability
    slippery: BrakingCapability | None
    better_grip_m_s2: float = math.inf
    descent: BrakingCapability | None = None

    def behind(self, shown_m_s2: float) -> RoadBraking:
        """Return the same behind a vehicle that is seen to brake with a deceleration."""
        if self.slippery is None or shown_m_s2 <= self.better_grip_m_s2:
            return self
        lead_m_s2, descent = self.full.lead_m_s2, self.descent
        return replace(
            self,
            slippery=replace(self.slippery, lead_m_s2=lead_m_s2),
            descent=descent and replace(descent, lead_m_s2=lead_m_s2),
        )


class SafetyMonitor:
    """The rule with its parameters; pure, what changes is in `MonitorMemory`.

    The friction of the road is the one of its settings: a value that is published while driving lengthens the
    distance that the controller keeps, in comfort. Here it would brake at once.
    """

    def __init__(self, settings: SafetyMonitorSettings, brakes: BrakeParameters) -> None:
        self.settings = settings
        self._brakes = brakes
        self._own_m_s2 = min(settings.monitor_own_deceleration_m_s2, brakes.max_deceleration_m_s2)

    @property
    def gentle_deceleration_m_s2(self) -> float:
        """Deceleration of a request on a road that may be slippery."""
        return self.settings.monitor_slippery_deceleration_m_s2 / RELIED_SHARE

    def road_braking(self, slope_rad: float = 0.0, shown_m_s2: float = 0.0) -> RoadBraking:
        """Return what can be counted on at a place.

        Args:
            slope_rad: slope there, positive uphill.
            shown_m_s2: deceleration at which the road met its limit, 0 for none.
        """
        settings, lead_m_s2 = self.settings, self.settings.monitor_lead_deceleration_m_s2
        slippery_m_s2 = min(settings.monitor_slippery_deceleration_m_s2, self._own_m_s2)
        friction = settings.road_friction
        full = braking_capability(self._own_m_s2, lead_m_s2, friction, slope_rad)
        slippery, descent, better_grip_m_s2 = None, None, math.inf
        if friction == 0.0 and slippery_m_s2 > 0.0:
            both = slippery_m_s2, min(SLIPPERY_LEAD_SHARE * slippery_m_s2, lead_m_s2)
            slippery = braking_capability(*both, 0.0, max(slope_rad, 0.0))
            descent = braking_capability(*both, 0.0, slope_rad) if slope_rad < 0.0 else None
            better_grip_m_s2 = HARDER_SHARE * slippery.lead_m_s2
        if shown_m_s2 > 0.0 and full.own_m_s2 > shown_m_s2:
            full = replace(full, own_m_s2=shown_m_s2)
        return RoadBraking(full, slippery, better_grip_m_s2, descent)

    def safe_distance_m(
        self,
        speed_m_s: float,
        acceleration_m_s2: float,
        lead_speed_m_s: float,
        brake_share: float = 1.0,
        further_reaction_s: float = 0.0,
        capability: BrakingCapability | None = None,
    ) -> float:
        """Return the smallest gap from which a collision can be avoided whatever the vehicle ahead does.

        As the ego vehicle is not assumed to brake harder than the one ahead, the gap is smallest either now
        or when both stand.

        Args:
            capability: of both vehicles; by default on a level road of the known friction.

        Returns:
            Distance in m. 0 for a vehicle that stands and does not accelerate.
        """
        settings = self.settings
        both = self.road_braking().full if capability is None else capability
        own_m = stopping_distance_m(
            speed_m_s,
            acceleration_m_s2,
            max(settings.monitor_reaction_s + further_reaction_s, 0.0) + self._brakes.delay_s,
            both.own_m_s2 * brake_share,
            self._brakes.build_up_m_s3 * brake_share,
        )
        if own_m <= 0.0:
            return 0.0
        slower_m_s = max(lead_speed_m_s - settings.lead_speed_accuracy_m_s, 0.0)
        lead_m = slower_m_s * slower_m_s / (2.0 * both.lead_m_s2)
        margin_m = settings.monitor_margin_m + settings.gap_accuracy_m
        return max(own_m - lead_m, 0.0) + margin_m

    def is_unsafe(
        self,
        gap_m: float,
        speed_m_s: float,
        acceleration_m_s2: float,
        lead_speed_m_s: float,
        brake_share: float,
        road: RoadBraking,
        waited_s: float = 0.0,
    ) -> bool:
        """Return whether the vehicle has to brake now, fully or gently; see `safe_distance_m`."""
        waited_s = min(waited_s, WAITED_S)
        motion = (speed_m_s, acceleration_m_s2, lead_speed_m_s, brake_share, -waited_s)
        full_m = self.safe_distance_m(*motion, road.full)
        return gap_m < full_m or gap_m < self.slippery_distance_m(*motion, road)

    def slippery_distance_m(
        self,
        speed_m_s: float,
        acceleration_m_s2: float,
        lead_speed_m_s: float,
        brake_share: float,
        further_reaction_s: float,
        road: RoadBraking,
    ) -> float:
        """Return the safe distance on a road that may be slippery, 0 where its friction is known."""
        if road.slippery is None:
            return 0.0
        motion = speed_m_s, acceleration_m_s2, lead_speed_m_s, brake_share
        level_m = self.safe_distance_m(*motion, further_reaction_s, road.slippery)
        if road.descent is None:
            return level_m
        without_s = further_reaction_s - self.settings.monitor_reaction_s
        return max(level_m, self.safe_distance_m(*motion, without_s, road.descent))

    def judge(
        self,
        memory: MonitorMemory,
        time_s: float,
        ego: tuple[float, float, float],
        lead: LeaderState | None,
        road: RoadBraking,
        unseen_s: float = 0.0,
    ) -> MonitorMemory:
        """Decide at one instant whether to brake.

        Args:
            ego: position, speed and the acceleration that the vehicle has if the monitor does not brake.
            lead: the vehicle ahead now; None for a free road, on which brakes are released.
            road: what can be counted on here.
            unseen_s: time for which measurements of the vehicle ahead have been missing.
        """
        position_m, speed_m_s, acceleration_m_s2 = ego
        held = time_s - memory.since_s >= self.settings.monitor_hold_s - ROUNDING_S
        if lead is None:
            return replace(memory, braking=memory.braking and not held)
        gap_m = lead.position_m - position_m
        onset = acceleration_m_s2, -min(unseen_s, WAITED_S)
        release = max(acceleration_m_s2, 0.0), self.settings.monitor_release_reaction_s

        def motion(given: tuple[float, float]) -> tuple[float, float, float, float, float]:
            acceleration, further_s = given
            return speed_m_s, acceleration, lead.speed_m_s, memory.brake_share, further_s

        was_full = memory.braking and not memory.gently
        safe_m = self.safe_distance_m(*motion(release if was_full else onset), road.full)
        fully = gap_m < safe_m or (was_full and not held)
        braking = fully or (memory.braking and not held)
        if not fully and road.slippery is not None:
            safe_m = self.slippery_distance_m(*motion(release if memory.braking else onset), road)
            braking = braking or gap_m < safe_m
        if memory.braking and not (fully and memory.gently):
            return replace(memory, braking=braking, gently=braking and not fully)
        if not braking:
            return memory
        reason = (
            f"gap {gap_m:.1f} m is below the safe distance of {safe_m:.1f} m at {speed_m_s:.1f} m/s behind "
            f"{lead.speed_m_s:.1f} m/s"
        )
        if unseen_s:
            reason += f"; the range measurement is {unseen_s:.1f} s late"
        since_s = memory.since_s if memory.braking else time_s
        return replace(memory, braking=True, gently=not fully, since_s=since_s, reason=reason)


def with_delivery(
    memory: MonitorMemory,
    requested_m_s2: float,
    delivered_m_s2: float,
    speed_m_s: float,
    duration_s: float,
) -> MonitorMemory:
    """Return a memory that has learned from what brakes and road made of a request.

    Weak brakes deliver a share of every request. A slippery road delivers gentle requests in full and nothing
    beyond its limit.

    Args:
        requested_m_s2: acceleration requested over an interval, delay and build-up of the brakes allowed for.
        speed_m_s: speed at the end of the interval; standing vehicles show nothing.
    """
    if requested_m_s2 > -JUDGED_FROM_M_S2 or speed_m_s < JUDGED_FROM_M_S:
        return memory
    share, given_m_s2 = delivered_m_s2 / requested_m_s2, -delivered_m_s2
    road_m_s2, in_full_m_s2 = memory.road_m_s2, memory.followed_m_s2
    if share >= DELIVERED_SHARE:
        in_full_m_s2 = max(in_full_m_s2, -requested_m_s2)
        road_m_s2 = max(road_m_s2, -requested_m_s2) if road_m_s2 else 0.0
    elif memory.brake_share > DELIVERED_SHARE and given_m_s2 <= SATURATED_SHARE * in_full_m_s2:
        return replace(memory, road_m_s2=given_m_s2)
    else:
        road_m_s2 = in_full_m_s2 = 0.0
    gain = -math.expm1(-duration_s / SHARE_TIME_CONSTANT_S)
    brake_share = memory.brake_share
    brake_share += gain * (min(max(share, LEAST_SHARE), 1.0) - brake_share)
    return replace(memory, brake_share=brake_share, followed_m_s2=in_full_m_s2, road_m_s2=road_m_s2)
