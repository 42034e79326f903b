"""Driving and cooling without an optimiser: a car-following law, a thermostat and a controlled stop."""

from __future__ import annotations

from dataclasses import replace

from iptm_core.controlled_stop import controlled_stop_command
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.gap_policy import minimum_gap_m
from iptm_core.state import Command, LeaderState, VehicleState

THERMOSTAT_ON_K = 305.15  # full cooling is asked for 6 K above
THERMOSTAT_SPAN_K = 6.0
THERMOSTAT_POWER_W = 1500.0
FREE_FLOW_EXPONENT = 4


def safe_following(
    state: VehicleState, leader: LeaderState, parameters: ModelParameters
) -> Command:
    """Intelligent driver model behind the leader, with the thermostat.

    ``a_max (1 - (v / v_max)^4 - (s* / s)^2)`` with the desired gap ``s*`` of the paper's spacing policy,
    never less than the standstill gap. Needs the measured gap and leader speed only.
    """
    limits, policy = parameters.limits, parameters.gap
    gap_m = max(leader.position_m - state.position_m, 0.1)
    desired = minimum_gap_m(state.speed_m_s, leader.speed_m_s, policy, limits)
    desired = max(float(desired), policy.standstill_gap_m)
    free_flow = (state.speed_m_s / limits.max_speed_m_s) ** FREE_FLOW_EXPONENT
    interaction = (desired / gap_m) ** 2
    acceleration = limits.max_acceleration_m_s2 * (1.0 - free_flow - interaction)
    return Command(
        max(acceleration, limits.min_acceleration_m_s2), thermostat_power_w(state, parameters)
    )


def thermostat_power_w(state: VehicleState, parameters: ModelParameters) -> float:
    """Compressor power proportional to how far the warmer cell is above 32 degC, up to 1500 W."""
    warmest = max(state.cell_1_temperature_k, state.cell_n_temperature_k)
    demand = (warmest - THERMOSTAT_ON_K) / THERMOSTAT_SPAN_K
    power = THERMOSTAT_POWER_W * min(max(demand, 0.0), 1.0)
    return min(power, parameters.limits.max_compressor_power_w)


def controlled_stop(state: VehicleState, parameters: ModelParameters, tick_s: float) -> Command:
    """Brake comfortably to standstill without a jolt, the thermostat still cooling."""
    braking = controlled_stop_command(state, parameters.limits, tick_s)
    return replace(braking, compressor_power_w=thermostat_power_w(state, parameters))
