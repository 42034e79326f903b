"""Settings of the safety monitor, and of the range sensor by which it measures the gap.

As in `iptm_core.settings`, each is declared once; trips and nodes are composed of the groups by inheritance.
"""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.declaration import Settings, parameter
from iptm_core.errors import ParameterError
from iptm_core.road_friction import RoadFrictionSettings

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
class RangeSensorSettings(Settings):
    """Range sensor of the vehicle."""

    monitor_period_s: float = parameter(
        0.1, "time between two checks of the gap, and between measurements of it", "s", 0.01, 1.0
    )


@dataclass(frozen=True)
class SafetyMonitorSettings(RoadFrictionSettings, SensorAccuracySettings, RangeSensorSettings):
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
