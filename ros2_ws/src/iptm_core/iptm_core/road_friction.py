"""How hard vehicles can brake on a road: its friction as far as it is known, and its slope.

Both vehicles are on the same road. A tyre transmits at most ``mu g cos(theta)`` per mass, brakes apply what
they can up to that, and gravity along the road adds ``g sin(theta)``, which is negative downhill (R. N.
Jazar, Vehicle Dynamics, 2nd ed. 2014, section 1.3). What brakes showed lowers the own deceleration only: weak
brakes and a slippery road look alike, and the vehicle ahead may have better ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

from iptm_core.declaration import Settings, parameter
from iptm_core.frozen import light

GRAVITY_M_S2 = 9.81
RELIED_SHARE = 0.875
"""Share of the stated friction that is relied on for the own braking: as 7 of the 8 m/s^2 of dry brakes."""
LEAST_DECELERATION_M_S2 = 0.3
"""A road that gives less than this is not driven on; keeps distances finite."""
MOST_FRICTION = 1.2
STEEPEST_RAD = 0.5
"""Slopes beyond are errors of a map."""


@dataclass(frozen=True)
class RoadFrictionSettings(Settings):
    """What is known of the road's friction before a vehicle has braked on it."""

    road_friction: float = parameter(
        0.0,
        "coefficient of friction of the road, e.g. 0.9 dry, 0.35 wet, 0.2 snow, 0.1 ice; 0: not known",
        "",
        0.0,
        MOST_FRICTION,
    )


@light
@dataclass(frozen=True)
class BrakingCapability:
    """Largest decelerations at a place of the road, both positive, in m/s^2."""

    own_m_s2: float
    lead_m_s2: float


@lru_cache(maxsize=256)
def braking_capability(
    own_m_s2: float, lead_m_s2: float, friction: float = 0.0, slope_rad: float = 0.0
) -> BrakingCapability:
    """Return the decelerations to count on: of the own vehicle at least, of the one ahead at most.

    Args:
        own_m_s2: deceleration of the own brakes that is relied on, on a dry and level road.
        lead_m_s2: hardest deceleration that is assumed of the vehicle ahead there.
        friction: coefficient of friction, 0 for one that is not known, which limits nothing.
        slope_rad: slope of the road, positive uphill.
    """
    slope_rad = (
        min(max(slope_rad, -STEEPEST_RAD), STEEPEST_RAD) if math.isfinite(slope_rad) else 0.0
    )
    if friction > 0.0:
        tyres_m_s2 = tyre_deceleration_m_s2(friction, slope_rad)
        own_m_s2 = min(own_m_s2, RELIED_SHARE * tyres_m_s2)
        lead_m_s2 = min(lead_m_s2, tyres_m_s2)
    if slope_rad:
        along_m_s2 = GRAVITY_M_S2 * math.sin(slope_rad)
        own_m_s2, lead_m_s2 = own_m_s2 + along_m_s2, lead_m_s2 + along_m_s2
    return BrakingCapability(
        max(own_m_s2, LEAST_DECELERATION_M_S2), max(lead_m_s2, LEAST_DECELERATION_M_S2)
    )


def tyre_deceleration_m_s2(friction: float, slope_rad: float) -> float:
    """Return the largest braking force per mass that tyres transmit, ``mu g cos(theta)``, in m/s^2."""
    return friction * GRAVITY_M_S2 * math.cos(slope_rad)


def further_gap_m(speed_m_s: float, known: BrakingCapability, dry: BrakingCapability) -> float:
    """Return by how much two vehicles of one speed have to be farther apart than on a dry road, in m."""
    apart = 1.0 / known.own_m_s2 - 1.0 / known.lead_m_s2
    apart -= 1.0 / dry.own_m_s2 - 1.0 / dry.lead_m_s2
    return max(0.5 * speed_m_s * speed_m_s * apart, 0.0)
