"""The suite's vehicle state from what a car measures: position and ageing are integrated, cells are a pair.

A battery management system has the lowest and the highest cell temperature, so the first cell of a coolant
channel is the lowest and the last one the highest. Capacity loss is not measured: it is integrated by the law
of the parameter set (paper eq. 12) from current and temperatures.
"""

from __future__ import annotations

import math

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import capacity_loss_rate_1_s, pack_capacity_ah
from iptm_core.physics.powertrain import cell_current_a
from iptm_core.state import (
    BatteryReading,
    IntervalPowers,
    LeaderState,
    PlantObservation,
    SafetyRecord,
    VehicleState,
)
from iptm_vehicle_interface.frames import SignalTable

LONGEST_STEP_S = 0.5
"""Longer gaps between two updates are not integrated over: position and ageing would be guesses."""
NEEDED = (
    "speed_m_s",
    "brake_pressed",
    "lowest_cell_temperature_k",
    "highest_cell_temperature_k",
    "pack_current_a",
)
"""Signals without which nothing can be planned."""
LEADER = ("gap_m", "relative_speed_m_s", "target_valid")


class VehicleStateEstimator:
    """Integrates position and ageing between updates; one per drive."""

    def __init__(
        self, parameters: ModelParameters, capacity_losses: tuple[float, float] | None = None
    ) -> None:
        self._parameters = parameters
        loss = parameters.aging.initial_capacity_loss
        self.capacity_losses = capacity_losses or (loss, loss)
        self._position_m = 0.0
        self._energy_j, self._energy_s = 0.0, 0.0
        self._last: tuple[float, float] | None = None
        self._at_tick: tuple[float, float] | None = None

    def update(self, signals: SignalTable, now_s: float) -> None:
        """Integrate to an instant; to be called at 20 Hz or more."""
        speed = signals.value("speed_m_s", now_s)
        if math.isnan(speed):
            self._last = None
            return
        if self._last is not None:
            step_s = now_s - self._last[0]
            if 0.0 < step_s <= LONGEST_STEP_S:
                self._position_m += 0.5 * (self._last[1] + speed) * step_s
                self._age(signals, now_s, step_s)
                self._draw(signals, now_s, step_s)
        self._last = now_s, speed

    def _age(self, signals: SignalTable, now_s: float, step_s: float) -> None:
        parameters = self._parameters
        current_a = cell_current_a(signals.value("pack_current_a", now_s), parameters.pack)
        temperatures = (
            signals.value("lowest_cell_temperature_k", now_s),
            signals.value("highest_cell_temperature_k", now_s),
        )
        if math.isnan(current_a) or any(map(math.isnan, temperatures)):
            return
        first, last = (
            loss
            + step_s
            * float(
                capacity_loss_rate_1_s(
                    current_a, temperature_k, loss, parameters.aging, parameters.cell
                )
            )
            for temperature_k, loss in zip(temperatures, self.capacity_losses, strict=True)
        )
        self.capacity_losses = first, last

    def _draw(self, signals: SignalTable, now_s: float, step_s: float) -> None:
        power_w = signals.value("pack_voltage_v", now_s) * signals.value("pack_current_a", now_s)
        if not math.isnan(power_w):
            self._energy_j, self._energy_s = (
                self._energy_j + power_w * step_s,
                self._energy_s + step_s,
            )

    def at_tick(self, signals: SignalTable, tick_s: float, now_s: float) -> PlantObservation | None:
        """Return the observation at a tick that began a moment ago; None while a needed signal is stale.

        The acceleration and the power of the battery are means since the tick before, as the suite's plant
        has them; what a car does not measure is NaN.
        """
        self.update(signals, now_s)
        if signals.stale(NEEDED, now_s):
            self._at_tick = None
            return None
        late_s = now_s - tick_s
        own = signals.value("acceleration_m_s2", now_s)
        own = 0.0 if math.isnan(own) else own
        speed = max(signals.value("speed_m_s", now_s) - own * late_s, 0.0)
        acceleration = own
        if self._at_tick is not None and tick_s > self._at_tick[0]:
            acceleration = (speed - self._at_tick[1]) / (tick_s - self._at_tick[0])
        self._at_tick = tick_s, speed
        power_w = self._energy_j / self._energy_s if self._energy_s else math.nan
        self._energy_j = self._energy_s = 0.0
        compressor_w = signals.value("compressor_power_w", now_s)
        state = VehicleState(
            time_s=tick_s,
            position_m=self._position_m
            - 0.5 * (speed + signals.value("speed_m_s", now_s)) * late_s,
            speed_m_s=speed,
            acceleration_m_s2=acceleration,
            compressor_power_w=0.0 if math.isnan(compressor_w) else compressor_w,
            cell_1_temperature_k=signals.value("lowest_cell_temperature_k", now_s),
            cell_n_temperature_k=signals.value("highest_cell_temperature_k", now_s),
            cell_1_capacity_loss=self.capacity_losses[0],
            cell_n_capacity_loss=self.capacity_losses[1],
            state_of_charge=signals.value("state_of_charge", now_s),
        )
        powers = IntervalPowers(math.nan, compressor_w, math.nan, power_w, math.nan)
        unknown = SafetyRecord(*4 * (math.nan,))
        return PlantObservation(state, powers, math.nan, math.nan, unknown)

    def battery(self, signals: SignalTable, observed: PlantObservation) -> BatteryReading:
        """Return the readings at the terminals of the pack, with the remaining capacity."""
        state, parameters = observed.state, self._parameters
        capacity_ah = pack_capacity_ah(parameters, sum(self.capacity_losses) / 2.0)
        return BatteryReading(
            state.time_s,
            signals.value("pack_voltage_v", state.time_s),
            signals.value("pack_current_a", state.time_s),
            (),
            (state.cell_1_temperature_k, state.cell_n_temperature_k),
            state.state_of_charge * capacity_ah,
            capacity_ah,
            pack_capacity_ah(parameters, 0.0),
        )

    def leader(self, signals: SignalTable, now_s: float) -> LeaderState | None:
        """Return the vehicle ahead now, extrapolated over the age of the measurement; None for none."""
        if signals.stale(LEADER, now_s) or not signals.is_set("target_valid", now_s):
            return None
        relative = signals.value("relative_speed_m_s", now_s)
        speed = max(signals.value("speed_m_s", now_s) + relative, 0.0)
        gap_m = signals.value("gap_m", now_s) + relative * signals.age_s("gap_m", now_s)
        return LeaderState(now_s, self._position_m + gap_m, speed)
