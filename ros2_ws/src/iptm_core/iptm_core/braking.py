"""How hard vehicles can brake, and the settings of the safety monitor, which relies on that.

Both vehicles are on the same road. A tyre transmits at most ``mu g cos(theta)`` per mass, brakes apply what
they can up to that, and gravity along the road adds ``g sin(theta)``, which is negative downhill (R. N.
Jazar, Vehicle Dynamics, 2nd ed. 2014, section 1.3). What brakes showed lowers the own deceleration only: weak
brakes and a slippery road look alike, and the vehicle ahead may have better ones.

As in `iptm_core.settings`, each setting is declared once; trips and nodes are composed of the groups by
inheritance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

from iptm_core.declaration import Settings, parameter
from iptm_core.errors import ParameterError

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


SLIPPERY_LEAD_SHARE = 1.055
"""Deceleration of the vehicle ahead on a slippery road, relative to the own one."""


@dataclass(frozen=True)
class SensorAccuracySettings(Settings):
    """Stated accuracy of the measured vehicle ahead; it is taken to be nearer and slower by it."""

    gap_accuracy_m: float = parameter(
        0.0, "by how much the gap may be measured too long; 0: exact", "m", 0.0, 50.0
    )
    lead_speed_accuracy_m_s: float = parameter(
        0.0,
        "by how much the speed of the vehicle ahead may be measured too high; 0: exact",
        "m/s",
        0.0,
        10.0,
    )


@dataclass(frozen=True)
class RadioSettings(Settings):
    """What messages of the vehicle ahead may do on their own."""

    authenticated_radio: bool = parameter(
        default=True,
        description="messages of the vehicle ahead are authenticated: where they place it nearer or slower "
        "than the range sensor does, the safety monitor brakes for them; else such messages brake within "
        "comfort only, and by no more than 8 m/s; a trip sets it to false where CAM are not all verified "
        "(refuse_unverified), for nodes that are started by hand set it so",
    )


@dataclass(frozen=True)
class RangeSensorSettings(Settings):
    """Range sensor of the vehicle."""

    monitor_period_s: float = parameter(
        0.1, "time between two checks of the gap, and between measurements of it", "s", 0.01, 1.0
    )


@dataclass(frozen=True)
class SafetyMonitorSettings(
    RoadFrictionSettings, SensorAccuracySettings, RadioSettings, RangeSensorSettings
):
    """Safety monitor of the vehicle: what it assumes, and when it brakes and releases."""

    safety_monitor: bool = parameter(
        default=True, description="brake when the gap falls below the safe distance"
    )
    monitor_lead_deceleration_m_s2: float = parameter(
        9.0, "hardest deceleration assumed of the vehicle ahead", "m/s^2", 1.0, 12.0
    )
    monitor_own_deceleration_m_s2: float = parameter(
        7.0, "own deceleration that is relied on with sound brakes", "m/s^2", 1.0, 12.0
    )
    monitor_reaction_s: float = parameter(
        0.5,
        "time assumed before the vehicle brakes, on top of the delay of its brakes",
        "s",
        0.0,
        3.0,
    )
    monitor_slippery_deceleration_m_s2: float = parameter(
        2.75,
        "own deceleration on the most slippery road to expect where the friction is not known; the monitor "
        "brakes with as much before it brakes fully; 0: it relies on a dry road",
        "m/s^2",
        0.0,
        12.0,
    )
    monitor_margin_m: float = parameter(
        1.0, "gap that is left when both vehicles stand", "m", 0.0, 20.0
    )
    monitor_release_reaction_s: float = parameter(
        0.5,
        "further reaction time for which the gap must suffice before brakes are released",
        "s",
        0.0,
        3.0,
    )
    monitor_hold_s: float = parameter(
        0.5, "shortest time for which the brakes stay applied", "s", 0.0, 10.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.monitor_own_deceleration_m_s2 > self.monitor_lead_deceleration_m_s2:
            raise ParameterError(
                f"monitor_own_deceleration_m_s2 is {self.monitor_own_deceleration_m_s2:g} m/s^2; allowed: up "
                f"to monitor_lead_deceleration_m_s2, {self.monitor_lead_deceleration_m_s2:g} m/s^2"
            )
