"""The last check before the bus: pure functions, each states what a request violates.

It shares no code and no measurement with controller and monitor of the suite: its own process reads the bus
itself. What a violation leads to is in `checked`: a request beyond its limits is cut, one that is too old or
given while the driver brakes makes the car inactive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_core.declaration import TextEnum
from iptm_vehicle_interface.channel import ActuationLimits


class Violation(TextEnum):
    """What a request violates."""

    RANGE = "value outside the limits"
    RATE = "acceleration changes too fast"
    GAP = "gap below what braking within the limits needs"
    AGE = "command too old"
    DRIVER = "the driver brakes or accelerates"
    NOT_FINITE = "not a number"


SOFT_SHARE, SOFT_M = 0.05, 1.0
"""Above the safe gap braking begins, by this share of it and this distance: who comes near is not jerked."""
COMFORTABLE_JERK_M_S3 = 2.0
"""Rate of everything except braking below the safe gap."""
RESOLUTION_M_S2 = 0.02
"""A rate that is missed by less is jitter of the period."""


@dataclass(frozen=True)
class Request:
    """A request as it arrives, and what is measured then.

    Attributes:
        acceleration_m_s2: wanted.
        enabled: whether the suite asks to drive.
        age_s: since the request was made.
        last_m_s2: acceleration sent before.
        since_last_s: time since then.
        speed_m_s: of the ego vehicle; NaN where it is not known.
        gap_m: to the vehicle ahead; NaN for none.
        relative_speed_m_s: of the vehicle ahead less the own; NaN where it is not known.
        pedal: whether the driver has a foot on brake or accelerator.
    """

    acceleration_m_s2: float
    enabled: bool
    age_s: float
    last_m_s2: float
    since_last_s: float
    speed_m_s: float
    gap_m: float
    relative_speed_m_s: float
    pedal: bool


@dataclass(frozen=True)
class Passed:
    """What may be sent: an acceleration in m/s^2, or a set speed in m/s."""

    value: float
    enabled: bool
    violations: tuple[Violation, ...] = ()


def outside_range(acceleration_m_s2: float, limits: ActuationLimits) -> bool:
    """Return whether an acceleration is beyond what the channel may carry."""
    return not limits.min_acceleration_m_s2 <= acceleration_m_s2 <= limits.max_acceleration_m_s2


def safe_gap_m(speed_m_s: float, lead_speed_m_s: float, limits: ActuationLimits) -> float:
    """Return the gap from which braking within the limits avoids a collision.

    The vehicle ahead may brake with `lead_deceleration_m_s2` from now on; the ego vehicle goes on for the
    reaction time, builds its braking up within the rate, and brakes as hard as the channel allows then
    (definition 1 of responsibility-sensitive safety, arXiv:1708.06374).
    """
    braking = -limits.min_acceleration_m_s2
    build_up_s = limits.reaction_s + 0.5 * braking / limits.max_jerk_m_s3
    own_m = speed_m_s * build_up_s + speed_m_s * speed_m_s / (2.0 * braking)
    lead_m = lead_speed_m_s * lead_speed_m_s / (2.0 * limits.lead_deceleration_m_s2)
    return max(own_m - lead_m, 0.0) + limits.margin_m


def permitted_m_s2(
    speed_m_s: float, gap_m: float, relative_m_s: float, limits: ActuationLimits
) -> float:
    """Return the hardest acceleration that a measured gap permits.

    Below the safe gap it is the hardest braking; above, it rises to the hardest acceleration, which holds
    where there is no gap, too. A vehicle ahead without a relative speed counts as standing.
    """
    hardest, most = limits.min_acceleration_m_s2, limits.max_acceleration_m_s2
    if math.isnan(gap_m) or math.isnan(speed_m_s):
        return most
    lead_m_s = 0.0 if math.isnan(relative_m_s) else max(speed_m_s + relative_m_s, 0.0)
    safe_m = safe_gap_m(speed_m_s, lead_m_s, limits)
    share = (gap_m - safe_m) / (SOFT_SHARE * safe_m + SOFT_M)
    return hardest + min(max(share, 0.0), 1.0) * (most - hardest)


def too_old(age_s: float, limits: ActuationLimits) -> bool:
    """Return whether a command is too old to leave."""
    return not age_s <= limits.max_command_age_s


def inactivating(request: Request, limits: ActuationLimits) -> list[Violation]:
    """Return why a request makes the car inactive."""
    found = {
        Violation.NOT_FINITE: not math.isfinite(request.acceleration_m_s2),
        Violation.AGE: too_old(request.age_s, limits),
        Violation.DRIVER: request.pedal,
    }
    return [violation for violation, holds in found.items() if holds and request.enabled]


def checked_set_speed(request: Request, limits: ActuationLimits) -> Passed:
    """Return what may be sent of a set speed, which stands in place of the acceleration of a request.

    The car keeps the gap, and limits how fast it follows.
    """
    found = inactivating(request, limits)
    if found or not request.enabled:
        return Passed(0.0, enabled=False, violations=tuple(found))
    wanted = request.acceleration_m_s2
    sent = min(max(wanted, 0.0), limits.max_set_speed_m_s)
    return Passed(sent, enabled=True, violations=(Violation.RANGE,) if sent != wanted else ())


def checked(request: Request, limits: ActuationLimits) -> Passed:
    """Return what may be sent of a request.

    Below the safe gap the car brakes as hard as rate and range allow, everything else keeps the comfortable
    rate. Every value that is sent keeps range and rate.
    """
    found = inactivating(request, limits)
    if found or not request.enabled:
        return Passed(0.0, enabled=False, violations=tuple(found))
    wanted = request.acceleration_m_s2
    if outside_range(wanted, limits):
        found.append(Violation.RANGE)
    permitted = permitted_m_s2(request.speed_m_s, request.gap_m, request.relative_speed_m_s, limits)
    if wanted > permitted:
        found.append(Violation.GAP)
        wanted = permitted
    wanted = min(max(wanted, limits.min_acceleration_m_s2), limits.max_acceleration_m_s2)
    upwards = downwards = min(COMFORTABLE_JERK_M_S3, limits.max_jerk_m_s3)
    if permitted <= limits.min_acceleration_m_s2:
        downwards = limits.max_jerk_m_s3
    lowest = request.last_m_s2 - downwards * request.since_last_s
    sent = min(max(wanted, lowest), request.last_m_s2 + upwards * request.since_last_s)
    if abs(sent - wanted) > RESOLUTION_M_S2 and Violation.GAP not in found:
        found.append(Violation.RATE)
    # From a motion outside the channel's range it goes on at its end.
    sent = min(max(sent, limits.min_acceleration_m_s2), limits.max_acceleration_m_s2)
    return Passed(sent, enabled=True, violations=tuple(found))
