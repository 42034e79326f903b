"""The pack between ticks: how fast its cells warm up, the heat that cooling takes, the price of ageing.

Rates are built once as expressions of the physics: a Python call per equation would be a fifth of a tick.

The problem stays as it is compiled for the paper's law; the law of a cell enters by its numbers:

- cyclic loss: eq. (12) with z = 1 and B = 0 is ``k |I| exp(-E / T)``, with k and E of the law;
- calendar loss: J2, a parabola in both temperatures, with slope and curvature of the law at the present ones;
- energy of the compressor: a price that it has in the problem, of what it costs in capacity;
- the hours after the trip: the prices of the cells at the end of the horizon, see `ParkedAging`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np

from iptm_controller.options import ControllerOptions
from iptm_controller.strategy import Strategy
from iptm_controller.temperature_value import (
    NoValuation,
    TemperatureValuation,
    TemperatureValue,
    mixing_weights,
)
from iptm_controller.tick_library import tick_library
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging, capacity_price_eur
from iptm_core.parameters.model import AgingParameters, ModelParameters
from iptm_core.physics.cell import (
    cell_heat_w,
    cell_resistance_ohm,
    cell_temperature_rate_k_s,
    heat_from_air_w,
)
from iptm_core.physics.model_numbers import (
    NUMBERS,
    SplitFunctions,
    SymbolicModel,
    numbers_of,
    shape_of,
    split_off,
)
from iptm_core.physics.ops import BufferedFunction, Scalar, doubles, named_function, where
from iptm_core.physics.power_thermal import (
    CellPair,
    Smoothing,
    electric_traction_power_w,
    rates_at_traction_power,
)
from iptm_core.physics.powertrain import (
    cell_current_a,
    extended_pack_current_a,
    pack_resistance_ohm,
)
from iptm_core.physics.thermal_loop import cooling_supply
from iptm_core.state import FloatArray, LeaderPreview, VehicleState
from iptm_core.units import J_PER_KWH, SECONDS_PER_HOUR

_MARGIN = 0.05
_PACK = ("speed_m_s", "compressor_power_w", "cell_1_capacity_loss", "cell_n_capacity_loss")
_RATES = ("cell_1_k_s", "cell_n_k_s")


class PackModel:
    """Evaluates the model of a parameter set."""

    def __init__(self, parameters: ModelParameters) -> None:
        shape = shape_of(parameters)
        split = _build(shape)
        numbers = split.prepare(numbers_of(parameters, shape))
        rates, cooling = split.functions
        self._rates, self._write = _with_one_argument(rates, numbers)
        self._cooling, self._write_cooling = _with_one_argument(cooling, numbers)

    def rates_k_s(
        self,
        state: VehicleState,
        cells_k: tuple[float, float],
        slope_rad: float | None,
        battery_power_w: float = math.nan,
        coolant_inlet_k: float = math.nan,
    ) -> tuple[float, float]:
        """Return how fast the temperatures of both cells change.

        Args:
            state: motion, compressor power and capacity losses.
            cells_k: temperatures of the cells.
            slope_rad: slope of the road; None for an impossible road, which takes no traction.
            battery_power_w: measured at the terminals; NaN takes the one of the motion.
            coolant_inlet_k: measured; NaN takes the one of the coolant loop.
        """
        self._write(
            *_pack(state, cells_k),
            state.acceleration_m_s2,
            slope_rad or 0.0,
            slope_rad is not None,
            math.isfinite(battery_power_w),
            battery_power_w,
            math.isfinite(coolant_inlet_k),
            coolant_inlet_k,
        )
        self._rates()
        found = self._rates.results
        return found[_RATES[0]].item(), found[_RATES[1]].item()

    def cooling_w(self, state: VehicleState, cells_k: tuple[float, float]) -> float:
        """Return the heat that the coolant loses on its way round, negative where it is heated."""
        self._write_cooling(*_pack(state, cells_k))
        self._cooling()
        return self._cooling.results["cooling_w"].item()


def _with_one_argument(
    function: ca.Function, numbers: FloatArray
) -> tuple[BufferedFunction, Callable[..., None]]:
    """Return a function of a model with these numbers, and what writes its arguments in their order."""
    names = [name for name in function.name_in() if name != NUMBERS]
    array, write = doubles(len(names))
    given: FloatArray = np.frombuffer(array)
    places = {name: given[place : place + 1] for place, name in enumerate(names)}
    return BufferedFunction(function, {**places, NUMBERS: numbers}), write


def _pack(state: VehicleState, cells_k: tuple[float, float]) -> tuple[float, ...]:
    """Return the numbers of `_PACK` and the temperatures of the cells."""
    losses = state.cell_1_capacity_loss, state.cell_n_capacity_loss
    return max(state.speed_m_s, 0.0), state.compressor_power_w, *losses, *cells_k


@lru_cache(maxsize=16)
def _build(shape: ModelParameters) -> SplitFunctions:
    """Return the functions to the rates of the cells, and to the heat that the coolant loses."""
    model = SymbolicModel.of(shape)
    parameters, channel = model.parameters, model.channel
    cell, pack = parameters.cell, parameters.pack
    given = {name: ca.SX.sym(name) for name in (*_PACK, "cell_1_k", "cell_n_k")}
    motion = {name: ca.SX.sym(name) for name in ("acceleration_m_s2", "slope_rad", "has_road")}
    measured = {name: ca.SX.sym(name) for name in ("has_power", "power", "has_inlet", "inlet")}
    speed, cells_k = given["speed_m_s"], (given["cell_1_k"], given["cell_n_k"])
    losses = given["cell_1_capacity_loss"], given["cell_n_capacity_loss"]

    def rates_at(traction_w: Scalar) -> Scalar:
        return rates_at_traction_power(
            traction_w,
            speed,
            given["compressor_power_w"],
            CellPair(*cells_k, *losses),
            parameters,
            channel,
            Smoothing(deliverable_margin=_MARGIN),
        )

    traction = electric_traction_power_w(
        speed, motion["acceleration_m_s2"], motion["slope_rad"], parameters
    )
    rates = rates_at(where(motion["has_road"], traction, 0.0))
    ohms = [
        cell_resistance_ohm(kelvin, loss, cell)
        for kelvin, loss in zip(cells_k, losses, strict=True)
    ]
    ohm = pack_resistance_ohm(0.5 * (ohms[0] + ohms[1]), pack)
    at_terminals = measured["power"], ohm, 0.5 * (cells_k[0] + cells_k[1]), cell, pack
    by_power = cell_current_a(extended_pack_current_a(*at_terminals, _MARGIN), pack)
    current = where(measured["has_power"], by_power, rates.cell_current_a)
    inlet_k = where(measured["has_inlet"], measured["inlet"], rates.coolant.inlet_k)
    coolants_k = inlet_k, channel.last_cell.temperature_k(inlet_k, *cells_k)
    found = {}
    for name, kelvin, ohm, coolant_k in zip(_RATES, cells_k, ohms, coolants_k, strict=True):
        heat_w = cell_heat_w(current, ohm, kelvin, cell) + heat_from_air_w(kelvin, parameters)
        found[name] = cell_temperature_rate_k_s(heat_w, kelvin, coolant_k, cell, parameters.cooling)
    cooling = {"cooling_w": rates_at(0.0).coolant.cooling_rate_w}
    numbers = {NUMBERS: model.numbers}
    return split_off(
        [
            named_function("pack_rates", given | motion | measured | numbers, found),
            named_function("pack_cooling", given | numbers, cooling),
        ]
    )


CELLS = 2.0
"""The cost counts the loss of the first and of the last cell."""
COST_SCALE = 0.02
"""Scale of the cost that makes it of order one: a kelvin costs two orders of magnitude more than under the
paper's law. No optimum moves."""
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
    return use.electricity_eur_kwh / J_PER_KWH / capacity_price_eur(use, model)


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
        self._coldest_below_limit_k = strategy.coldest_below_limit_k
        # In one currency it is part of what the battery gives.
        thermal_1_j = 0.0 if strategy.in_currency else CELLS * self._weight * energy_price_1_j
        self._thermal_energy_price_1_j = thermal_1_j
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
            thermal_energy_price_1_j=self._thermal_energy_price_1_j,
        )

    def _price_1_k(self, state: VehicleState, kelvin: float) -> float:
        """Return the price of a kelvin at which what is removed and what a kelvin costs agree."""
        # Below 0 warm cells age less; the energy of driving has no price, so that it must not heat for it.
        uncooled = max(float(np.interp(kelvin, _TABLE_K, self._prices_1_k)), 0.0)
        spread_k = min(kelvin - state.cell_1_temperature_k, self._coldest_below_limit_k)
        coolest_k = state.cell_1_temperature_k + max(spread_k, 0.0)
        lowest_k = kelvin - max(coolest_k - self._model.limits.min_temperature_k, 0.0)
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
) -> tuple[Strategy, float, TemperatureValuation | CellLawValuation | NoValuation]:
    """Return the strategy as the problem weighs it, the price of a joule in it, and what prices temperatures.

    Args:
        aging: law of the cell, None for the paper's.
    """
    times_s = options.horizon.duration_s, options.trip_duration_s
    weighs_aging, price_1_j = strategy.aging_weight > 0.0, 0.0
    if weighs_aging and (aging or (options.arrival and not strategy.energy_weight_1_j)):
        strategy = strategy.scaled(COST_SCALE)
        price_1_j = energy_price_1_j(options.aging, model)
    if strategy.in_currency:
        per_share = CELLS * strategy.aging_weight
        use = options.aging
        headway = use.headway_eur_m2_h / SECONDS_PER_HOUR / capacity_price_eur(use, model)
        strategy = replace(
            strategy,
            spent_energy_weight_1_j=per_share * price_1_j,
            headway_price_1_m2_s=per_share * headway,
        )
    if aging is not None and weighs_aging:
        # Where there is an arrival, the hours after the trip are in its cost.
        to_go = strategy.cost_to_go and options.arrival is None
        priced = replace(strategy, cost_to_go=to_go)
        return strategy, price_1_j, CellLawValuation(aging, priced, price_1_j, model, *times_s)
    if strategy.cost_to_go:
        by_law_of_paper = TemperatureValuation(
            tick_library(), model, strategy.aging_weight, *times_s, strategy.coldest_below_limit_k
        )
        return strategy, price_1_j, by_law_of_paper
    return strategy, price_1_j, NoValuation()
