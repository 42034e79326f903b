"""Driving and cooling as production cars do it: adaptive cruise control, and a thermostat with hysteresis.

Nothing is optimised and nothing is predicted. The cruise control is the one that Milanés and Shladover
identified on production cars (Transportation Research Part C 48, 2014, pp. 285-300) with the modes of
Xiao, Wang and van Arem (Transportation Research Record 2623, 2017, pp. 1-9), of which the gentlest counts
instead of thresholds between them; the time gap lies between those that ISO 15622:2018 asks for. Where
the lead vehicle brakes harder than the limits of comfort allow the ego vehicle to, emergency braking
takes over, as in cars: the collision guard of the controller and the safety monitor of the vehicle.

The thermostat runs the compressor at half power from 33 degC of the warmer cell down to 30. Makers
publish no such thresholds: these are chosen, in the middle of the paper's limits of 25 and 40 degC.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_core.declaration import Settings, parameter
from iptm_core.errors import ParameterError
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import Command, LeaderState, VehicleState


@dataclass(frozen=True)
class ProductionSettings(Settings):
    """Time headway and gains of the cruise control, switching points and power of the thermostat."""

    acc_time_headway_s: float = parameter(
        1.6, "time headway of the cruise control, beyond the gap at standstill", "s", 0.8, 5.0
    )
    acc_gap_gain_1_s2: float = parameter(
        0.23, "acceleration for the error of the gap while following", "1/s^2", 0.001, 2.0
    )
    acc_speed_gain_1_s: float = parameter(
        0.07, "acceleration for the difference of speeds while following", "1/s", 0.0, 5.0
    )
    acc_closing_gap_gain_1_s2: float = parameter(
        0.04,
        "acceleration for the error of the gap while a large gap is closed",
        "1/s^2",
        0.001,
        2.0,
    )
    acc_closing_speed_gain_1_s: float = parameter(
        0.8,
        "acceleration for the difference of speeds while a large gap is closed",
        "1/s",
        0.0,
        5.0,
    )
    acc_set_speed_gain_1_s: float = parameter(
        0.4, "acceleration for the difference to the largest speed", "1/s", 0.01, 5.0
    )
    thermostat_on_k: float = parameter(
        306.15,
        "temperature of the warmer cell above which the compressor runs",
        "K",
        253.15,
        353.15,
    )
    thermostat_off_k: float = parameter(
        303.15, "temperature of the warmer cell below which it stops", "K", 253.15, 353.15
    )
    thermostat_power_share: float = parameter(
        0.5, "power of the running compressor as a share of its largest", "", 0.05, 1.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.thermostat_off_k > self.thermostat_on_k:
            raise ParameterError(
                f"thermostat_off_k is {self.thermostat_off_k}; allowed: at most thermostat_on_k, "
                f"{self.thermostat_on_k}"
            )


def cruise_control_m_s2(
    state: VehicleState,
    leader: LeaderState,
    parameters: ModelParameters,
    settings: ProductionSettings,
) -> float:
    """Return the acceleration of the constant-time-gap policy, within the limits of comfort.

    ``k_1 (s - s_st - T v) + k_2 (v_PV - v)``, the lower one of the gains for following and those for closing
    a large gap, and no more than ``k_3 (v_max - v)``. Both are at rest at the gap ``s_st + T v``.

    Args:
        leader: lead vehicle; the difference of positions is the gap s.
        parameters: gap at standstill s_st, limits of acceleration and speed.
    """
    limits = parameters.limits
    speed = state.speed_m_s
    gap_m = leader.position_m - state.position_m
    error_m = gap_m - parameters.gap.standstill_gap_m - settings.acc_time_headway_s * speed
    approach = leader.speed_m_s - speed
    wanted = min(
        settings.acc_gap_gain_1_s2 * error_m + settings.acc_speed_gain_1_s * approach,
        settings.acc_closing_gap_gain_1_s2 * error_m
        + settings.acc_closing_speed_gain_1_s * approach,
        settings.acc_set_speed_gain_1_s * (limits.max_speed_m_s - speed),
    )
    return min(max(wanted, limits.min_acceleration_m_s2), limits.max_acceleration_m_s2)


class ProductionLikeController:
    """Cruise control and thermostat; only the thermostat remembers anything."""

    def __init__(self, parameters: ModelParameters, settings: ProductionSettings) -> None:
        self._parameters = parameters
        self._settings = settings
        self.is_cooling = False

    def command(
        self, state: VehicleState, leader: LeaderState | None, at_most_m_s2: float = math.inf
    ) -> Command:
        """Return the command of a tick; jerk and the rate of the compressor are left to the limiter.

        Args:
            at_most_m_s2: what the rules of the road allow.
        """
        acceleration = at_most_m_s2
        if leader is not None:
            following = cruise_control_m_s2(state, leader, self._parameters, self._settings)
            acceleration = min(following, at_most_m_s2)
        return Command(acceleration, self._compressor_power_w(state))

    def _compressor_power_w(self, state: VehicleState) -> float:
        """Switch the compressor by the warmer cell."""
        warmest_k = max(state.cell_1_temperature_k, state.cell_n_temperature_k)
        if warmest_k > self._settings.thermostat_on_k:
            self.is_cooling = True
        elif warmest_k < self._settings.thermostat_off_k:
            self.is_cooling = False
        limits = self._parameters.limits
        if not self.is_cooling:
            return limits.min_compressor_power_w
        power_w = self._settings.thermostat_power_share * limits.max_compressor_power_w
        return max(power_w, limits.min_compressor_power_w)
