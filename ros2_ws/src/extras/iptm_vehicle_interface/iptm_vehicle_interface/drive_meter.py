"""Meter: energy, temperatures and ageing of an external drive, computed from its speeds.

The model of a car goes along with the measured motion. Speeds may come at any rate; the model is evaluated
once per `WINDOW_S`, between the speeds at both ends, so that the kinetic energy is exact and the noise of a
sensor at 50 Hz is not taken for accelerations. The pack is cooled by the thermostat that cars have.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from iptm_controller.ladder import thermostat_power_w
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import at_charge, pack_capacity_ah
from iptm_core.physics.power_thermal import (
    CellPair,
    electric_traction_power_w,
    rates_at_traction_power,
)
from iptm_core.physics.thermal_loop import reduce_channel
from iptm_core.state import BatteryReading, VehicleState

WINDOW_S = 1.0
LONGEST_GAP_S = 5.0
"""A longer time without speeds is left out: the motion in it would be a guess."""


@dataclass(frozen=True)
class MeterReading:
    """What a drive has needed so far.

    Attributes:
        state: of the car at the end of the last window; its capacity losses include the initial ones.
        driven_s: time that was metered.
        battery_energy_j: at the terminals of the pack, what came back taken off.
        traction_energy_j: of the motor, the same.
        cooling_energy_j: of compressor and auxiliaries of the cooling system.
        recovered_energy_j: what came back into the pack.
        capacity_loss: of both cells together during the drive.
        pack_current_a: mean of the last window, positive when discharging.
        pack_voltage_v: at the terminals, the same.
        left_out_s: time in gaps.
    """

    state: VehicleState
    driven_s: float = 0.0
    battery_energy_j: float = 0.0
    traction_energy_j: float = 0.0
    cooling_energy_j: float = 0.0
    recovered_energy_j: float = 0.0
    capacity_loss: float = 0.0
    pack_current_a: float = 0.0
    pack_voltage_v: float = math.nan
    left_out_s: float = 0.0


class DriveMeter:
    """Takes speeds in the order of time; `reading` has what they came to."""

    def __init__(
        self,
        parameters: ModelParameters,
        slope_at: Callable[[float], float] = lambda _: 0.0,
        cell_temperature_k: float | None = None,
    ) -> None:
        """Set up a meter.

        Args:
            parameters: of the car.
            slope_at: slope of the road in rad (positive uphill) at a distance from the start in m.
            cell_temperature_k: of all cells at the start; None takes it from the parameters.
        """
        self._parameters, self._slope_at = parameters, slope_at
        self._channel = reduce_channel(parameters.cooling, parameters.pack)
        kelvin = cell_temperature_k or parameters.environment.initial_cell_temperature_k
        self._start_loss = loss = parameters.aging.initial_capacity_loss
        charge = parameters.charge.initial_charge
        state = VehicleState(
            math.nan, 0.0, 0.0, 0.0, 0.0, kelvin, kelvin, loss, loss, state_of_charge=charge
        )
        self.reading = MeterReading(state)
        self._last: tuple[float, float] | None = None
        self._moved_m = 0.0
        self._consumed_j = 0.0

    def take(self, time_s: float, speed_m_s: float, consumers_w: float = 0.0) -> None:
        """Take a speed; one that is not finite counts as not measured.

        Args:
            consumers_w: of heater, air conditioning and others since the speed before, from the pack.
        """
        if not (math.isfinite(time_s) and math.isfinite(speed_m_s)):
            return
        state, speed_m_s = self.reading.state, max(speed_m_s, 0.0)
        if self._last is None or not 0.0 < time_s - self._last[0] <= LONGEST_GAP_S:
            left_out_s = 0.0 if self._last is None else max(time_s - self._last[0], 0.0)
            self.reading = replace(
                self.reading,
                state=replace(state, time_s=time_s, speed_m_s=speed_m_s),
                left_out_s=self.reading.left_out_s + left_out_s,
            )
            self._last, self._moved_m, self._consumed_j = (time_s, speed_m_s), 0.0, 0.0
            return
        step_s = time_s - self._last[0]
        self._moved_m += 0.5 * (self._last[1] + speed_m_s) * step_s
        self._consumed_j += consumers_w * step_s
        self._last = time_s, speed_m_s
        if time_s - state.time_s >= WINDOW_S - 1e-6:
            self._evaluate(time_s, speed_m_s)

    def _evaluate(self, time_s: float, speed_m_s: float) -> None:
        """Evaluate the model from the end of the window before to now."""
        reading, state = self.reading, self.reading.state
        window_s = time_s - state.time_s
        mean_m_s = self._moved_m / window_s
        change_m_s = speed_m_s - state.speed_m_s
        # With the mean speed by distance, force times distance has the exact kinetic energy.
        kinetic_m_s2 = 0.5 * (speed_m_s + state.speed_m_s) * change_m_s
        acceleration = kinetic_m_s2 / self._moved_m if self._moved_m > 0.0 else 0.0
        consumers_w = self._consumed_j / window_s
        base = at_charge(self._parameters, state.state_of_charge)
        auxiliary_w = base.cooling.auxiliary_power_w + consumers_w
        parameters = replace(base, cooling=replace(base.cooling, auxiliary_power_w=auxiliary_w))
        slope = self._slope_at(state.position_m + 0.5 * self._moved_m)
        compressor_w = thermostat_power_w(state, parameters)
        cells = CellPair(
            state.cell_1_temperature_k,
            state.cell_n_temperature_k,
            state.cell_1_capacity_loss,
            state.cell_n_capacity_loss,
        )
        traction_w = float(electric_traction_power_w(mean_m_s, acceleration, slope, parameters))
        rates = rates_at_traction_power(
            traction_w, mean_m_s, compressor_w, cells, parameters, self._channel
        )
        power_w, current_a = float(rates.battery_power_w), float(rates.pack_current_a)
        losses = (
            state.cell_1_capacity_loss + window_s * float(rates.cell_1_capacity_loss_rate_1_s),
            state.cell_n_capacity_loss + window_s * float(rates.cell_n_capacity_loss_rate_1_s),
        )
        capacity_ah = pack_capacity_ah(parameters, 0.5 * sum(losses))
        after = replace(
            state,
            time_s=time_s,
            position_m=state.position_m + self._moved_m,
            speed_m_s=speed_m_s,
            acceleration_m_s2=acceleration,
            compressor_power_w=compressor_w,
            cell_1_temperature_k=state.cell_1_temperature_k
            + window_s * float(rates.cell_1_temperature_rate_k_s),
            cell_n_temperature_k=state.cell_n_temperature_k
            + window_s * float(rates.cell_n_temperature_rate_k_s),
            cell_1_capacity_loss=losses[0],
            cell_n_capacity_loss=losses[1],
            state_of_charge=state.state_of_charge - current_a * window_s / 3600.0 / capacity_ah,
        )
        self.reading = MeterReading(
            after,
            reading.driven_s + window_s,
            reading.battery_energy_j + power_w * window_s,
            reading.traction_energy_j + traction_w * window_s,
            reading.cooling_energy_j + (compressor_w + base.cooling.auxiliary_power_w) * window_s,
            reading.recovered_energy_j + max(-power_w, 0.0) * window_s,
            sum(losses) - 2.0 * self._start_loss,
            current_a,
            power_w / current_a if current_a else reading.pack_voltage_v,
            reading.left_out_s,
        )
        self._moved_m = self._consumed_j = 0.0

    def battery(self) -> BatteryReading:
        """Return what a battery management system of the car would report."""
        reading, state = self.reading, self.reading.state
        mean_loss = 0.5 * (state.cell_1_capacity_loss + state.cell_n_capacity_loss)
        capacity_ah = pack_capacity_ah(self._parameters, mean_loss)
        return BatteryReading(
            state.time_s,
            reading.pack_voltage_v,
            reading.pack_current_a,
            (),
            (state.cell_1_temperature_k, state.cell_n_temperature_k),
            state.state_of_charge * capacity_ah,
            capacity_ah,
            pack_capacity_ah(self._parameters, 0.0),
        )
