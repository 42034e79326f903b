"""Terminal cost of the cell temperatures: marginal cost of a kelvin at the end of the horizon.

A warmer cell ages faster until the kelvin is gone. With the aging rate q of both cells, its sensitivity to
temperature alpha = d ln q / dT (paper eq. 12, at their mean) and the decay time tau of a kelvin, it costs

    w = lambda_Q alpha q tau,    alpha = (E_a - B c) / (z R T^2)

per kelvin of both. The rate is the mean of the trip so far, before there is any the forecast of the leader's
motion. A kelvin persists until the end of the trip or until it pays to cool it away, whichever is
sooner: running the chiller ages the cells by the power that it draws, which pays after the
payback time

    tau = C_pack (1 + b c) / (COP alpha P),    b = B / (z R T)

with the heat capacity of the pack, the mean power P at its terminals and the mean C-rate c. A kelvin more
to be cooled away is the last one to go: COP is the best coefficient of performance at the lowest
temperature that a cell may have. Between the cells the price is shared as the coolant mixes them. Nothing is
to be tuned.
The derivation and a comparison with the costates of whole trips: docs/explanation/optimal-control.md.
"""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass

import numpy as np

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import aging_current_a
from iptm_core.physics.ops import doubles
from iptm_core.physics.power_thermal import CellPair, power_thermal_rates
from iptm_core.physics.thermal_loop import most_efficient_cooling, reduce_channel
from iptm_core.state import FloatArray, LeaderPreview, VehicleState
from iptm_core.units import SECONDS_PER_HOUR

FORECAST_WEIGHT_S = 60.0
"""Prior weight of the initial forecast, in seconds of trip data."""
FORECAST_STEP_S = 1.0
C_RATE_ITERATIONS = 6
LEAST_RATE_1_S = 1e-15


@dataclass(frozen=True)
class TemperatureValue:
    """Price of a kelvin of both cells at the end of the horizon, and what it was made of.

    Attributes:
        cell_1_marginal_cost_1_k: cost of a kelvin more in cell 1 (w_1), in the unit of the cost.
        cell_n_marginal_cost_1_k: the same for cell N (w_N).
        aging_rate_1_s: mean rate of the capacity loss, sum of both cells (q).
        aging_sensitivity_1_k: relative change of the rate with temperature (alpha).
        temperature_decay_time_s: decay time of a temperature difference (tau).
        temperature_weight_1_k2_s: weight of J2 by the calendar loss, on top of the strategy's weight.
        reference_temperature_k: reference of that.
        thermal_energy_price_1_j: cost of the energy of compressor and heater, on top of J3.
    """

    cell_1_marginal_cost_1_k: float
    cell_n_marginal_cost_1_k: float
    aging_rate_1_s: float
    aging_sensitivity_1_k: float
    temperature_decay_time_s: float
    temperature_weight_1_k2_s: float = 0.0
    reference_temperature_k: float = 0.0
    thermal_energy_price_1_j: float = 0.0


NO_VALUE = TemperatureValue(0.0, 0.0, 0.0, 0.0, 0.0)
"""Of strategies without a cost to go."""


def mixing_weights(parameters: ModelParameters) -> tuple[float, float, float]:
    """Return how the coolant mixes the two cells while the chiller takes nothing.

    A temperature difference decays, a weighted mean stays: the left null vector of the loop's matrix. The
    last cell weighs more, because it stands for more of what the coolant brings to the first one.

    Returns:
        Weights of cell 1 and cell N in the mean that stays, and the rate in 1/s at which a difference decays.
    """
    channel = reduce_channel(parameters.cooling, parameters.pack)
    rate_1_s = parameters.cooling.convective_coefficient_w_k / parameters.cell.heat_capacity_j_k
    inlet_of_n = channel.outlet.cell_n / (1.0 - channel.outlet.inlet)
    to_1 = rate_1_s * inlet_of_n
    to_n = rate_1_s * (channel.last_cell.inlet * (1.0 - inlet_of_n) + channel.last_cell.cell_1)
    return to_n / (to_1 + to_n), to_1 / (to_1 + to_n), to_1 + to_n


class NoValuation:
    """A strategy without a price of the temperatures."""

    def value(self, state: VehicleState, leader: LeaderPreview) -> TemperatureValue:  # noqa: ARG002
        """Return no price."""
        return NO_VALUE


class TemperatureValuation:
    """Follows the trip and prices the temperatures at every tick.

    Attributes:
        start: first state of the trip.
        foreseen_1_s: aging rate that was expected there.
    """

    def __init__(
        self,
        library: ctypes.PyDLL,
        parameters: ModelParameters,
        aging_weight: float,
        horizon_s: float,
        trip_duration_s: float = math.inf,
        coldest_below_limit_k: float = 0.0,
    ) -> None:
        """Keep what does not change.

        Args:
            aging_weight: lambda_Q.
            coldest_below_limit_k: as in `Strategy`.
        """
        self._parameters = parameters
        self._heat_capacity_j_k = parameters.pack_heat_capacity_j_k
        self._aging_weight = aging_weight
        self._horizon_s = horizon_s
        self._trip_duration_s = trip_duration_s
        self._share_1, self._share_n, _ = mixing_weights(parameters)
        _, self._performance = most_efficient_cooling(
            parameters.limits.min_temperature_k - coldest_below_limit_k, parameters
        )
        self._library, self._numbers = library, (ctypes.c_double * 17)(*self.numbers)
        self._aged, self._write = doubles(6)
        self._found = (ctypes.c_double * 5)()
        self.start: VehicleState | None = None
        self.foreseen_1_s = 0.0

    @property
    def numbers(self) -> tuple[float, ...]:
        """What does not change, in the order of ``iptm_valuation`` in C."""
        aging, cell, pack = self._parameters.aging, self._parameters.cell, self._parameters.pack
        z, capacity_ah = aging.throughput_exponent, cell.nominal_capacity_ah
        scale = z * aging.pre_exponential_factor ** (1.0 / z) / SECONDS_PER_HOUR
        c_rate_1_h = aging_current_a(capacity_ah, capacity_ah, aging) / capacity_ah
        return (
            self._aging_weight,
            self._horizon_s,
            self._trip_duration_s,
            self._share_1,
            self._share_n,
            self._performance,
            self._heat_capacity_j_k,
            scale * capacity_ah,
            aging.compensation_factor_j_mol * c_rate_1_h - aging.activation_energy_j_mol,
            aging.activation_energy_j_mol,
            aging.compensation_factor_j_mol,
            aging.gas_constant_j_mol_k,
            z,
            1.0 - 1.0 / z,
            capacity_ah,
            pack.parallel,
            pack.open_circuit_voltage_v,
        )

    def value(self, state: VehicleState, leader: LeaderPreview) -> TemperatureValue:
        """Price the temperatures at a tick.

        Args:
            state: measured state; the first one, or one before it, begins a trip.
        """
        start = self.start
        if start is None or state.time_s < start.time_s:
            self.start = start = state
            self.foreseen_1_s = self._foresee(state, leader)
        elapsed_s = state.time_s - start.time_s
        lost = max(_loss(state) - _loss(start), 0.0)
        temperature_k = 0.5 * (state.cell_1_temperature_k + state.cell_n_temperature_k)
        return self._priced(state.time_s, temperature_k, _loss(state), elapsed_s, lost)

    def _priced(self, *aged: float) -> TemperatureValue:
        """Return the prices, worked out in C.

        Args:
            aged: time of the trip, mean temperature and capacity loss of both cells now, time since the first
                state and capacity lost since.
        """
        self._write(*aged, self.foreseen_1_s)
        self._library.iptm_value_temperatures(self._numbers, self._aged, self._found)
        return TemperatureValue(*self._found)

    def _foresee(self, state: VehicleState, leader: LeaderPreview) -> float:
        """Return the mean aging rate of a vehicle that moves like the leader on a flat road, uncooled.

        Instants at which the leader drives harder than the pack of this vehicle allows are left out.
        """
        count = math.ceil(self._horizon_s / FORECAST_STEP_S) + 1
        times: FloatArray = np.array([state.time_s + i * FORECAST_STEP_S for i in range(count)])
        _, speeds = leader.at(times)
        with np.errstate(invalid="ignore"):
            rates = power_thermal_rates(
                0.5 * (speeds[:-1] + speeds[1:]),
                np.diff(speeds) / FORECAST_STEP_S,
                np.zeros(times.size - 1),
                np.zeros(times.size - 1),
                CellPair(
                    state.cell_1_temperature_k,
                    state.cell_n_temperature_k,
                    state.cell_1_capacity_loss,
                    state.cell_n_capacity_loss,
                ),
                self._parameters,
                reduce_channel(self._parameters.cooling, self._parameters.pack),
            )
        both = rates.cell_1_capacity_loss_rate_1_s + rates.cell_n_capacity_loss_rate_1_s
        known = np.isfinite(both)
        return float(np.mean(both[known])) if known.any() else 0.0


def _loss(state: VehicleState) -> float:
    return state.cell_1_capacity_loss + state.cell_n_capacity_loss
