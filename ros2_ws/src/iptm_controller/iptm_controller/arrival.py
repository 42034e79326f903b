"""Cost to go of the temperature until arrival, from what it costs there.

A trip may end where the temperature of the pack matters: at a fast charger, or parked for hours. Given is the
cost of each temperature on arrival. The cost of the rest of the trip is the thermal energy still to be drawn,
under the law of a cell the ageing a(T) until then, as the power that costs as much, and that,

    J(T, t_end) = cost on arrival,
    J(T, t) = min over P of [abs(P) / eta_b + a(T)] dt + J(T + dT/dt(P) dt, t + dt),

worked out backwards for the pack as one body with heater, chiller, radiator, air and a steady load. Its
slope at the end of the horizon is the price of a kelvin. A kelvin that can be heated later for what it costs
now has lost nothing until then, and one heated too early goes to the air: when to begin comes out of J.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from iptm_controller.temperature_value import TemperatureValue, mixing_weights
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging, capacity_price_eur
from iptm_core.errors import ParameterError
from iptm_core.frozen import replace
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import cell_heat_w, cell_resistance_ohm, heat_from_air_w
from iptm_core.physics.chiller import chiller_line, largest_useful_power_w
from iptm_core.physics.thermal_loop import reduce_channel, solve_coolant_loop, thermal_actuation
from iptm_core.state import FloatArray, VehicleState
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH
from iptm_core.user_input import number, shown

STEP_S = 60.0
GRID_K = 0.25
BEYOND_K = 15.0
"""The grid reaches so far beyond air, start and upper limit."""
SPEED_M_S = 15.0
LOAD_1_H = 0.2
"""Mean C-rate of the rest of the trip: 15 kW from a pack of 75 kWh. It warms a pack by 1 to 2 K in an hour;
what the load really does is measured at every tick."""
COOLING_SHARES = (0.02, 0.05, 0.1, 0.2, 0.4, 1.0)
HEATING_SHARES = (0.25, 0.5, 0.75, 1.0)
LARGEST_PRICE_RATIO = 1.5
"""Largest price of a kelvin, relative to its heating energy: the heater runs at full power from 1 on, and
a higher price would make wasting energy in the pack pay."""


@dataclass(frozen=True)
class ArrivalCost:
    """What the temperature of the pack costs on arrival: linear between the temperatures, constant outside.

    Raises:
        ParameterError: less than two temperatures, not increasing, or unknown values.
    """

    celsius: tuple[float, ...]
    eur: tuple[float, ...]

    def __post_init__(self) -> None:
        known = all(map(math.isfinite, (*self.celsius, *self.eur)))
        increasing = all(low < high for low, high in pairwise(self.celsius))
        if not known or not increasing or len(self.celsius) != len(self.eur) or len(self.eur) < 2:
            raise ParameterError(
                f"cost on arrival at {shown(self.celsius)} degC is {shown(self.eur)} EUR; allowed: two or "
                "more known values at increasing temperatures"
            )

    @classmethod
    def parse(cls, text: str) -> ArrivalCost | None:
        """Return the cost of a text such as ``20:0.0, 35:0.12``, None of an empty one."""
        if not text.strip():
            return None
        try:
            pairs = [tuple(map(number, pair.split(":"))) for pair in text.split(",")]
            celsius, eur = zip(*pairs, strict=True)
        except ValueError:
            raise ParameterError(
                f"arrival_cost_eur is {shown(text)}; allowed: <degC>:<EUR> joined by commas"
            ) from None
        return cls(celsius, eur)


class ArrivalValuation:
    """Prices the temperature of the pack at every tick of a trip by its cost on arrival."""

    def __init__(
        self,
        cost: ArrivalCost,
        electricity_eur_kwh: float,
        model: ModelParameters,
        energy_weight_1_j: float,
        thermal_energy_price_1_j: float,
        horizon_s: float,
        trip_duration_s: float,
        aging_w: Callable[[FloatArray], FloatArray] | None = None,
    ) -> None:
        """Work out the cost to go.

        Args:
            cost: on arrival.
            electricity_eur_kwh: price of the energy that the pack is cooled and heated with.
            model: of the vehicle.
            energy_weight_1_j: cost of a joule from the pack in J3.
            thermal_energy_price_1_j: cost of a joule of thermal energy on top; not both are 0.
            horizon_s: length of the horizon.
            trip_duration_s: trip time of the arrival, finite.
            aging_w: power that costs as much as the ageing at temperatures, see `aging_power_w`.

        Raises:
            ParameterError: there is nothing to weigh the cost against, or no time of arrival.
        """
        if not energy_weight_1_j and not thermal_energy_price_1_j:
            raise ParameterError(
                "a strategy weighs neither energy nor ageing; allowed: one that does"
            )
        if not math.isfinite(trip_duration_s):
            raise ParameterError("the trip has no known end; allowed: trips with one")
        self._thermal_energy_price_1_j = thermal_energy_price_1_j
        self._weight_1_j = energy_weight_1_j + thermal_energy_price_1_j
        self._ends_s = trip_duration_s - horizon_s
        pack, environment = model.pack, model.environment
        self._shares = mixing_weights(model)[:2]
        capacity_j_k = model.pack_heat_capacity_j_k
        per_heat = 1.0 / (pack.battery_efficiency * model.cooling.heater_performance)
        self._least_j_k = -LARGEST_PRICE_RATIO * capacity_j_k * per_heat
        lowest_k = min(environment.ambient_temperature_k, environment.initial_cell_temperature_k)
        highest_k = model.limits.max_temperature_k + BEYOND_K
        count = math.ceil((highest_k - lowest_k + BEYOND_K) / GRID_K)
        self._grid_k: FloatArray = lowest_k - BEYOND_K + GRID_K * np.arange(count, dtype=np.float64)
        steps = math.ceil(max(self._ends_s, 0.0) / STEP_S)
        kelvin = np.asarray(cost.celsius) + CELSIUS_ZERO_K
        on_arrival_j = np.interp(self._grid_k, kelvin, cost.eur) / electricity_eur_kwh * J_PER_KWH
        aging_j = 0.0 * self._grid_k if aging_w is None else STEP_S * aging_w(self._grid_k)
        energy_j = self._energies_j(on_arrival_j, aging_j, model, steps)
        slopes_j_k: FloatArray = np.gradient(energy_j, GRID_K, axis=1)
        self._slopes_j_k: list[list[float]] = slopes_j_k.tolist()
        self._first_k, self._last_place = float(self._grid_k[0]), self._grid_k.size - 1.0 - 1e-9

    def added_to(self, value: TemperatureValue, state: VehicleState) -> TemperatureValue:
        """Return what a kelvin costs with the arrival, of both cells in the shares of the other costs."""
        # The mean that stays while the coolant mixes them: what is heated is not even yet.
        share_1, share_n = self._shares
        mean_k = share_1 * state.cell_1_temperature_k + share_n * state.cell_n_temperature_k
        price = self.price_1_k(state.time_s, mean_k)
        return replace(
            value,
            cell_1_marginal_cost_1_k=value.cell_1_marginal_cost_1_k + share_1 * price,
            cell_n_marginal_cost_1_k=value.cell_n_marginal_cost_1_k + share_n * price,
            thermal_energy_price_1_j=self._thermal_energy_price_1_j,
        )

    def price_1_k(self, time_s: float, temperature_k: float) -> float:
        """Return the cost of a kelvin more at the end of the horizon, negative where warmth is welcome."""
        last = len(self._slopes_j_k) - 1
        left = min(max((self._ends_s - time_s) / STEP_S, 0.0), last)
        below = int(left)
        above = min(below + 1, last)
        place = min(max((temperature_k - self._first_k) / GRID_K, 0.0), self._last_place)
        node = int(place)
        low, high = (
            slopes[node] + (place - node) * (slopes[node + 1] - slopes[node])
            for slopes in (self._slopes_j_k[below], self._slopes_j_k[above])
        )
        slope_j_k = low + (left - below) * (high - low)
        return self._weight_1_j * max(slope_j_k, self._least_j_k)

    def _energies_j(
        self, on_arrival_j: FloatArray, aging_j: FloatArray, model: ModelParameters, steps: int
    ) -> FloatArray:
        """Return the cost to go in joules, with 0, 1, ... steps left, shape (steps + 1, grid)."""
        kelvin = self._grid_k
        drawn_w, warming_k_s = _actions(kelvin, model)
        left = [on_arrival_j]
        for _ in range(steps):
            after = kelvin + STEP_S * warming_k_s
            costs = STEP_S * drawn_w[:, np.newaxis] + np.interp(after, kelvin, left[-1])
            left.append(costs.min(axis=0) + aging_j)
        return np.array(left)


def aging_power_w(
    aging: ParkedAging, use: AgingSettings, model: ModelParameters, temperature_k: FloatArray
) -> FloatArray:
    """Return the power whose electricity costs as much as the calendar ageing at temperatures, shape (n,)."""
    rest = np.zeros_like(temperature_k)
    loss_1_s = aging.loss_1_s(temperature_k, rest, rest + use.parked_charge)
    return loss_1_s * capacity_price_eur(use, model) / use.electricity_eur_kwh * J_PER_KWH


def _actions(kelvin: FloatArray, model: ModelParameters) -> tuple[FloatArray, FloatArray]:
    """Return what can be done with the pack: power drawn, shape (a,), and warming in K/s, shape (a, n)."""
    limits, cell, pack = model.limits, model.cell, model.pack
    largest_w = largest_useful_power_w(model.chiller, limits)
    powers_w = [0.0, *(share * largest_w for share in COOLING_SHARES)]
    if limits.max_heater_power_w > 0.0:
        powers_w += [-share * limits.max_heater_power_w for share in HEATING_SHARES]
    ohm = cell_resistance_ohm(kelvin, model.aging.initial_capacity_loss, cell)
    own_w = cell_heat_w(LOAD_1_H * cell.nominal_capacity_ah, ohm, kelvin, cell)
    own_w = own_w + heat_from_air_w(kelvin, model)
    outlet = reduce_channel(model.cooling, pack).outlet
    warming = []
    for power_w in powers_w:
        actuation = thermal_actuation(power_w, model)
        line = chiller_line(
            actuation.compressor_w, SPEED_M_S, model.chiller, model.cooling, model.environment
        )
        loop = solve_coolant_loop(kelvin, kelvin, line, outlet, model.cooling, actuation=actuation)
        warming.append((own_w - loop.cooling_rate_w / pack.cells) / cell.heat_capacity_j_k)
    return np.abs(powers_w) / pack.battery_efficiency, np.array(warming)
