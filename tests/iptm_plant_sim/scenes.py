"""Vehicles under a safety monitor, and range sensors on what is ahead of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from iptm_core.braking import SafetyMonitorSettings
from iptm_core.parameters import load_parameters
from iptm_core.state import Command, LeaderPreview, VehicleState
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.safety_monitor import SafetyMonitor

PARAMETERS = load_parameters().values
BRAKES = PARAMETERS.brakes
SETTINGS = SafetyMonitorSettings()
MONITOR = SafetyMonitor(SETTINGS, BRAKES)
ROAD = MONITOR.road_braking()
COAST = Command(0.0, 0.0)


def lead_at(
    position_m: float, speed_m_s: float, deceleration_m_s2: float = 0.0
) -> Callable[[VehicleState], LeaderPreview]:
    """Return a range sensor, 0.1 s between measurements, on a vehicle that brakes from 0 s on."""

    def sensor(state: VehicleState) -> LeaderPreview:
        times = state.time_s + 0.1 * np.arange(10)
        moving = times
        if deceleration_m_s2 > 0.0:
            moving = np.minimum(times, speed_m_s / deceleration_m_s2)
        positions = position_m + moving * (speed_m_s - 0.5 * deceleration_m_s2 * moving)
        return LeaderPreview(
            times, positions, np.maximum(speed_m_s - deceleration_m_s2 * times, 0.0)
        )

    return sensor


def driving(speed_m_s: float) -> tuple[Plant, VehicleState]:
    plant = Plant(PARAMETERS, np.zeros_like)
    return plant, plant.initial_state(speed_m_s=speed_m_s)
