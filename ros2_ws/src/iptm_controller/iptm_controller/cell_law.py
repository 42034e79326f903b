"""The cost under the ageing law of a cell: numbers of the compiled problem, and the price of a kelvin.

The problem stays as it is compiled for the paper's law; the law of a cell enters by its numbers:

- cyclic loss: eq. (12) with z = 1 and B = 0 is ``k |I| exp(-E / T)``, with k and E of the law;
- calendar loss: J2, a parabola in both temperatures, with slope and curvature of the law at the present ones;
- energy of the compressor: a price that it has in the problem, of what it costs in capacity;
- the hours after the trip: the prices of the cells at the end of the horizon, see `ParkedAging`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from iptm_controller.options import ControllerOptions
from iptm_controller.strategy import Strategy
from iptm_controller.temperature_value import (
    TemperatureValuation,
    TemperatureValue,
    mixing_weights,
)
from iptm_core.aging_laws.parking import END_OF_LIFE_LOSS, AgingSettings, ParkedAging
from iptm_core.parameters.model import AgingParameters, ModelParameters
from iptm_core.physics.thermal_loop import cooling_supply
from iptm_core.state import FloatArray, LeaderPreview, VehicleState
from iptm_core.units import J_PER_KWH

CELLS = 2.0
"""The cost counts the loss of the first and of the last cell."""
COST_SCALE = 0.02
"""Scale of the cost that makes it of order one: a kelvin costs two orders of magnitude more than under the
paper's law. No optimum moves."""
_WH_PER_KWH = 1000.0
_TABLE_K: FloatArray = np.linspace(233.0, 353.0, 241, dtype=np.float64)
_LEAST_CURVATURE_1_K = 1e-3
"""Of the calendar loss over its slope, where a law is straight or bends the other way."""


def cyclic_parameters(aging: ParkedAging, model: ModelParameters) -> AgingParameters:
    """Return the cyclic loss of a law as coefficients of eq. (12).

    Exact for laws that are linear in the current and of one activation energy, for others close to the
    temperature of the parked pack. A law without cyclic loss
    leaves the weights of the paper, or nothing would weigh how the car is driven.
    """
    fit_k = aging.parked_k
    rate_1_s, slope_1_s_k = aging.cyclic_1_s(fit_k)
    if rate_1_s <= 0.0:
        return model.aging
    energy_k = fit_k**2 * slope_1_s_k / rate_1_s
    at_1_ah_1_h = rate_1_s * 3600.0 / model.cell.nominal_capacity_ah
    return replace(
        model.aging,
        pre_exponential_factor=at_1_ah_1_h * math.exp(energy_k / fit_k),
        activation_energy_j_mol=energy_k * model.aging.gas_constant_j_mol_k,
        compensation_factor_j_mol=0.0,
        throughput_exponent=1.0,
    )


def energy_price_1_j(use: AgingSettings, model: ModelParameters) -> float:
    """Return the capacity, as a share of the pack's, that costs as much as a joule of electricity."""
    pack = model.pack
    pack_wh = pack.open_circuit_voltage_v * model.cell.nominal_capacity_ah * pack.parallel
    battery_eur = use.battery_eur_kwh * pack_wh / _WH_PER_KWH
    return use.electricity_eur_kwh / J_PER_KWH * END_OF_LIFE_LOSS / battery_eur


class CellLawValuation:
    """Prices the temperatures at every tick by the law of a cell.

    The price of a kelvin is that at which the trip ends at a temperature where a kelvin costs as much: what
    cooling at that price removes until then is taken into account, and cooling beyond the lower temperature
    limit has no value. So the pack is cooled over the whole trip at the most efficient powers, and not
    at all where the marginal cost of a kelvin is below the cost of its cooling.
    """

    def __init__(
        self,
        aging: ParkedAging,
        strategy: Strategy,
        energy_price_1_j: float,
        model: ModelParameters,
        horizon_s: float,
        trip_duration_s: float = math.inf,
    ) -> None:
        """Keep what does not change.

        Args:
            energy_price_1_j: capacity that costs as much as a joule.
        """
        self._aging = aging
        self._prices_1_k = aging.kelvin_price_1_k(_TABLE_K)
        self._weight = strategy.aging_weight
        self._has_cost_to_go = strategy.cost_to_go
        self._ends_s = trip_duration_s - horizon_s
        self._share_1, self._share_n, _ = mixing_weights(model)
        self._model = model
        self._heat_capacity_j_k = model.pack_heat_capacity_j_k
        self._energy_price_1_j = energy_price_1_j

    def value(self, state: VehicleState, leader: LeaderPreview) -> TemperatureValue:
        """Price the temperatures at a tick."""
        del leader
        kelvin = 0.5 * (state.cell_1_temperature_k + state.cell_n_temperature_k)
        rate, slope, curvature = self._aging.calendar_1_s(kelvin, state.state_of_charge)
        curvature = max(curvature, _LEAST_CURVATURE_1_K * abs(slope))
        price = self._price_1_k(state, kelvin) if self._has_cost_to_go else 0.0
        cost = CELLS * self._weight * price
        return TemperatureValue(
            self._share_1 * cost,
            self._share_n * cost,
            aging_rate_1_s=CELLS * rate,
            aging_sensitivity_1_k=slope / rate if rate > 0.0 else 0.0,
            temperature_decay_time_s=price / slope if slope > 0.0 else 0.0,
            temperature_weight_1_k2_s=0.5 * self._weight * curvature,
            reference_temperature_k=kelvin - slope / curvature if curvature > 0.0 else kelvin,
            thermal_energy_price_1_j=CELLS * self._weight * self._energy_price_1_j,
        )

    def _price_1_k(self, state: VehicleState, kelvin: float) -> float:
        """Return the price of a kelvin at which what is removed and what a kelvin costs agree."""
        # Below 0 warm cells age less; the energy of driving has no price, so that it must not heat for it.
        uncooled = max(float(np.interp(kelvin, _TABLE_K, self._prices_1_k)), 0.0)
        lowest_k = kelvin - max(
            state.cell_1_temperature_k - self._model.limits.min_temperature_k, 0.0
        )
        rates_w, margins = cooling_supply(0.5 * (kelvin + lowest_k), self._model)
        supply = self._heat_capacity_j_k * self._energy_price_1_j * margins
        if not supply.size or uncooled <= supply[0]:
            return uncooled
        left_s = max(self._ends_s - state.time_s, 0.0)
        end_k = np.maximum(kelvin - rates_w * left_s / self._heat_capacity_j_k, lowest_k)
        demand = np.where(end_k > lowest_k, np.interp(end_k, _TABLE_K, self._prices_1_k), 0.0)
        enough = np.flatnonzero(demand <= supply)
        return float(supply[enough[0]]) if enough.size else float(demand[-1])


def valuation_of(
    strategy: Strategy,
    options: ControllerOptions,
    aging: ParkedAging | None,
    model: ModelParameters,
) -> tuple[Strategy, float, TemperatureValuation | CellLawValuation | None]:
    """Return the strategy as the problem weighs it, the price of a joule in it, and what prices temperatures.

    Args:
        aging: law of the cell, None for the paper's.
    """
    times_s = options.horizon.duration_s, options.trip_duration_s
    weighs_aging, price_1_j = strategy.aging_weight > 0.0, 0.0
    if weighs_aging and (aging or (options.charges and not strategy.energy_weight_1_j)):
        strategy = strategy.scaled(COST_SCALE)
        price_1_j = energy_price_1_j(options.aging, model)
    if aging is not None and weighs_aging:
        return strategy, price_1_j, CellLawValuation(aging, strategy, price_1_j, model, *times_s)
    if strategy.cost_to_go:
        by_law_of_paper = TemperatureValuation(model, strategy.aging_weight, *times_s)
        return strategy, price_1_j, by_law_of_paper
    return strategy, price_1_j, None
