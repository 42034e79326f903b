"""Driving and cooling by rules: as production cars do, and as well as can be done without optimisation.

Nothing is optimised. The cruise control of `production_simple` is the one that Milanés and Shladover
identified on production cars (Transportation Research Part C 48, 2014, pp. 285-300) with the modes of
Xiao, Wang and van Arem (Transportation Research Record 2623, 2017, pp. 1-9), of which the gentlest counts
instead of thresholds between them; the time gap lies between those that ISO 15622:2018 asks for. Where
the lead vehicle brakes harder than the limits of comfort allow the ego vehicle to, emergency braking
takes over, as in cars: the collision guard of the controller and the safety monitor of the vehicle.
Its thermostat runs the compressor at half power from 33 degC of the warmer cell down to 30. Makers
publish no such thresholds: these are chosen, in the middle of the paper's limits of 25 and 40 degC.

`production` is the same car with gains and thermostat tuned once, on trips that no table of savings uses
(study `production`).

The strong baseline, `eco_acc`, has the thermostat of `production` and a cruise control with a long time gap
and gains so small that it smooths what the lead vehicle does. It keeps s_min by the reserve that the optimal
control problem has for a braking leader, and s_max by closing up. Gains, time gap and margin are tuned once,
on UDDS, SC03 and NYCC; a low-pass filter of the leader's speed was tried there too and made it worse.

`rule_preview` has the thermostat, too, and follows the preview by one formula (`rule_preview`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from iptm_controller.forecast import LeaderForecast
from iptm_controller.rule_preview import gentlest_acceleration_m_s2
from iptm_controller.strategy import DrivingRules
from iptm_core.declaration import Settings, parameter
from iptm_core.errors import ParameterError
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import braking_reserve_m, maximum_gap_m, minimum_gap_m
from iptm_core.state import Command, LeaderState, VehicleState


@dataclass(frozen=True)
class ProductionSettings(Settings):
    """Time headway and gains of the cruise control, switching points and power of the thermostat."""

    acc_time_headway_s: float = parameter(
        1.6, "time headway of the cruise control, beyond the gap at standstill", "s", 0.8, 5.0
    )
    acc_gap_gain_1_s2: float = parameter(
        0.03, "acceleration for the error of the gap while following", "1/s^2", 0.001, 2.0
    )
    acc_speed_gain_1_s: float = parameter(
        0.5, "acceleration for the difference of speeds while following", "1/s", 0.0, 5.0
    )
    acc_closing_gap_gain_1_s2: float = parameter(
        0.04,
        "acceleration for the error of the gap while a large gap is closed",
        "1/s^2",
        0.001,
        2.0,
    )
    acc_closing_speed_gain_1_s: float = parameter(
        0.7,
        "acceleration for the difference of speeds while a large gap is closed",
        "1/s",
        0.0,
        5.0,
    )
    acc_set_speed_gain_1_s: float = parameter(
        0.4, "acceleration for the difference to the largest speed", "1/s", 0.01, 5.0
    )
    thermostat_on_k: float = parameter(
        303.15,
        "temperature of the warmer cell above which the compressor runs",
        "K",
        253.15,
        353.15,
    )
    thermostat_off_k: float = parameter(
        301.15, "temperature of the warmer cell below which it stops", "K", 253.15, 353.15
    )
    thermostat_power_share: float = parameter(
        0.26, "power of the running compressor as a share of its largest", "", 0.05, 1.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.thermostat_off_k > self.thermostat_on_k:
            raise ParameterError(
                f"thermostat_off_k is {self.thermostat_off_k}; allowed: at most thermostat_on_k, "
                f"{self.thermostat_on_k}"
            )


SIMPLE = {
    "acc_gap_gain_1_s2": 0.23,
    "acc_speed_gain_1_s": 0.07,
    "acc_closing_gap_gain_1_s2": 0.04,
    "acc_closing_speed_gain_1_s": 0.8,
    "thermostat_on_k": 306.15,
    "thermostat_off_k": 303.15,
    "thermostat_power_share": 0.5,
}
"""Settings of `production_simple` in place of the tuned ones."""


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


ECO_TIME_HEADWAY_S = 3.5
ECO_GAP_GAIN_1_S2 = 0.002
ECO_SPEED_GAIN_1_S = 0.12
ECO_RESERVE_M = 4.5
"""Part of the reserve that is kept: `braking_reserve_m` may lie up to 5 m above the exact reserve."""
ECO_CLOSING_UP_M = 20.0
"""Distance below s_max from which a large gap is closed."""
ECO_CLOSING_GAINS = 0.05, 0.3
"""In 1/s^2 for the gap and in 1/s for the difference of speeds."""
BISECTIONS = 20


def eco_cruise_control_m_s2(
    state: VehicleState,
    leader: LeaderState,
    parameters: ModelParameters,
    settings: ProductionSettings,
    tick_s: float,
) -> float:
    """Return the acceleration of the strong baseline, within the limits of comfort.

    ``k_1 (s - s_st - T v) + k_2 (v_PV - v)`` with small gains; at most what keeps the braking reserve and
    s_min after one more tick, and near s_max at least what closes the gap.

    Args:
        leader: lead vehicle; the difference of positions is the gap s.
        tick_s: time for which an acceleration is held.
    """
    limits, gap = parameters.limits, parameters.gap
    speed = state.speed_m_s
    gap_m = leader.position_m - state.position_m
    approach = leader.speed_m_s - speed
    error_m = gap_m - gap.standstill_gap_m - ECO_TIME_HEADWAY_S * speed
    wanted = ECO_GAP_GAIN_1_S2 * error_m + ECO_SPEED_GAIN_1_S * approach
    beyond_m = gap_m - (float(maximum_gap_m(speed, gap)) - ECO_CLOSING_UP_M)
    if beyond_m > 0.0:
        by_gap, by_speed = ECO_CLOSING_GAINS
        wanted = max(wanted, by_gap * beyond_m + by_speed * approach)

    def is_safe(acceleration_m_s2: float) -> bool:
        after_m_s = max(speed + acceleration_m_s2 * tick_s, 0.0)
        left_m = gap_m + (leader.speed_m_s - 0.5 * (speed + after_m_s)) * tick_s - ECO_RESERVE_M
        reserve_m = braking_reserve_m(
            left_m, after_m_s, acceleration_m_s2, leader.speed_m_s, gap, limits
        )
        least_m = minimum_gap_m(after_m_s, leader.speed_m_s, gap, limits)
        return bool(reserve_m >= 0.0 and left_m >= least_m)

    jerk_step = limits.max_jerk_m_s3 * tick_s
    low = max(state.acceleration_m_s2 - jerk_step, limits.min_acceleration_m_s2)
    high = min(state.acceleration_m_s2 + jerk_step, limits.max_acceleration_m_s2)
    if not is_safe(low):
        wanted = limits.min_acceleration_m_s2
    elif not is_safe(high):
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if is_safe(middle) else (low, middle)
        wanted = min(wanted, low)
    wanted = min(wanted, settings.acc_set_speed_gain_1_s * (limits.max_speed_m_s - speed))
    return min(max(wanted, limits.min_acceleration_m_s2), limits.max_acceleration_m_s2)


class ProductionLikeController:
    """Cruise control and thermostat of some rules; only the thermostat remembers anything.

    Attributes:
        uses_preview: whether these rules use the predicted motion of the leader.
        is_cooling: the compressor runs.
    """

    def __init__(
        self,
        parameters: ModelParameters,
        settings: ProductionSettings,
        tick_s: float = 1.0,
        rules: DrivingRules = DrivingRules.PRODUCTION,
    ) -> None:
        """Set up a vehicle that does not cool.

        Args:
            rules: which cruise control drives, and which settings count.
        """
        self._parameters = parameters
        is_simple = rules == DrivingRules.PRODUCTION_SIMPLE  # a stored strategy holds the text
        self._settings = replace(settings, **SIMPLE) if is_simple else settings
        self._tick_s = tick_s
        self._rules = rules
        self.uses_preview = rules == DrivingRules.RULE_PREVIEW
        self.is_cooling = False

    def command(
        self,
        state: VehicleState,
        leader: LeaderState | None,
        at_most_m_s2: float = math.inf,
        forecast: LeaderForecast | None = None,
    ) -> Command:
        """Return the command of a tick; jerk and the rate of the compressor are left to the limiter.

        Args:
            at_most_m_s2: what the rules of the road allow.
            forecast: predicted motion of the leader, where it is used.
        """
        acceleration = at_most_m_s2
        if leader is not None:
            acceleration = min(self._following_m_s2(state, leader, forecast), at_most_m_s2)
        return Command(acceleration, self._compressor_power_w(state))

    def _following_m_s2(
        self, state: VehicleState, leader: LeaderState, forecast: LeaderForecast | None
    ) -> float:
        """Return the acceleration behind a lead vehicle."""
        law = (state, leader, self._parameters, self._settings)
        if self._rules == DrivingRules.ECO_ACC:
            return eco_cruise_control_m_s2(*law, self._tick_s)
        if forecast is not None:
            known_s = forecast.known_s - (state.time_s - leader.time_s)
            headway_s = self._settings.acc_time_headway_s
            foreseen = state, forecast.limiting, known_s, headway_s
            gentlest = gentlest_acceleration_m_s2(*foreseen, self._parameters, self._tick_s)
            if math.isfinite(gentlest):
                return gentlest
        return cruise_control_m_s2(*law)

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
