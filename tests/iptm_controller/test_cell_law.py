"""The cost under the law of a cell."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_state

from iptm_controller.pack_model import (
    CELLS,
    COST_SCALE,
    CellLawValuation,
    cyclic_parameters,
    energy_price_1_j,
)
from iptm_controller.strategy import DEFAULT_STRATEGY, STRATEGIES
from iptm_controller.temperature_value import TemperatureValue
from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.law import AgingLaw, Load, Mechanism
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging
from iptm_core.physics.cell import capacity_loss_rate_1_s
from iptm_core.physics.thermal_loop import cooling_supply, most_efficient_cooling
from iptm_core.state import LeaderPreview, VehicleState

STRATEGY = STRATEGIES[DEFAULT_STRATEGY].scaled(COST_SCALE)
STEADY = LeaderPreview(np.array([0.0]), np.array([0.0]), np.array([25.0]))
HOT = AgingSettings(parking_air_k=308.75, year_air_k=297.6, year_air_swing_k=11.2)
AMBIENT_K = 298.15
TRIP_S = 1800.0


def valued(
    law: str, state: VehicleState, use: AgingSettings = HOT, trip_s: float = TRIP_S
) -> tuple[TemperatureValue, float]:
    """Return the value at a state and the price of a kelvin in capacity."""
    price_1_j = energy_price_1_j(use, PARAMETERS)
    aging = ParkedAging(LAWS[law], use, AMBIENT_K)
    valuation = CellLawValuation(aging, STRATEGY, price_1_j, PARAMETERS, 28.0, trip_s)
    value = valuation.value(state, STEADY)
    cost = value.cell_1_marginal_cost_1_k + value.cell_n_marginal_cost_1_k
    return value, cost / (CELLS * STRATEGY.aging_weight)


def warm(kelvin: float, time_s: float = 0.0) -> VehicleState:
    return make_state(
        time_s=time_s, cell_1_temperature_k=kelvin, cell_n_temperature_k=kelvin, state_of_charge=0.8
    )


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("celsius", [10.0, 25.0, 36.0, 40.0])
def test_the_cyclic_numbers_of_the_problem_are_those_of_the_law(name: str, celsius: float) -> None:
    """Eq. (12) with them against the law at the end of service, for a day's cycle, within 1 %.

    The law of NMC622 has several activation energies: within 10 % over 4 K from the pack parked at 38.6 degC.
    """
    aging = ParkedAging(LAWS[name], HOT, AMBIENT_K)
    kelvin, c_rate = celsius + 273.15, 0.7
    tolerance = 0.01
    if name == "nmc622":
        kelvin, tolerance = aging.parked_k + (-4.0 if celsius < 30.0 else 4.0), 0.1
    model = PARAMETERS
    found = capacity_loss_rate_1_s(
        c_rate * model.cell.nominal_capacity_ah,
        kelvin,
        2e-3,
        cyclic_parameters(aging, model),
        model.cell,
    )
    load = Load(
        kelvin,
        c_rate,
        HOT.parked_charge,
        HOT.daily_discharge,
        2.0 * HOT.daily_discharge / 24.0,
        HOT.charging_c_rate_1_h,
    )
    expected = sum(
        weight * part.damage_rate_1_s(load)
        for part, weight in zip(LAWS[name].mechanisms, aging.weights, strict=True)
        if part.mechanism is Mechanism.CYCLIC
    )
    assert found == pytest.approx(float(expected), rel=tolerance)


@pytest.mark.parametrize("name", LAWS)
def test_the_parabola_has_the_slope_of_the_calendar_loss(name: str) -> None:
    """J2 of both cells against the loss of both, over the kelvin that a horizon changes: within 1 %."""
    value, _ = valued(name, warm(308.15))
    weight, reference_k = value.temperature_weight_1_k2_s, value.reference_temperature_k
    aging = ParkedAging(LAWS[name], HOT, AMBIENT_K)
    for step_k in (-1.0, 1.0):
        parabola = weight * ((308.15 + step_k - reference_k) ** 2 - (308.15 - reference_k) ** 2)
        lost = aging.calendar_1_s(308.15 + step_k, 0.8)[0] - aging.calendar_1_s(308.15, 0.8)[0]
        assert parabola == pytest.approx(STRATEGY.aging_weight * lost, rel=0.01)


def test_energy_costs_its_share_of_a_battery_by_hand() -> None:
    """0.25 EUR for electricity, and a pack of which 20 % have the price of all its kilowatt-hours."""
    pack, cell = PARAMETERS.pack, PARAMETERS.cell
    kwh = pack.open_circuit_voltage_v * cell.nominal_capacity_ah * pack.parallel / 1000.0
    expected = 0.25 / (130.0 * kwh / 0.2)
    assert 3.6e6 * energy_price_1_j(AgingSettings(), PARAMETERS) == pytest.approx(expected)


def test_the_energy_of_the_compressor_has_the_unit_of_the_cost() -> None:
    """A joule costs as much as the capacity of the same price, lost by both cells."""
    value, _ = valued("nca", warm(308.15))
    weight = STRATEGY.aging_weight
    expected = CELLS * weight * energy_price_1_j(HOT, PARAMETERS)
    assert value.thermal_energy_price_1_j == pytest.approx(expected)


def test_a_law_without_cyclic_loss_leaves_that_of_the_paper() -> None:
    law = AgingLaw("rest", LAWS["nca"].mechanisms[:1])
    aging = ParkedAging(law, HOT, AMBIENT_K)
    assert cyclic_parameters(aging, PARAMETERS) == PARAMETERS.aging


def test_a_kelvin_costs_what_it_ages_where_no_cooling_pays() -> None:
    use = replace(HOT, electricity_eur_kwh=100.0)
    _, price = valued("nca", warm(308.15), use)
    aging = ParkedAging(LAWS["nca"], use, AMBIENT_K)
    assert price == pytest.approx(float(aging.kelvin_price_1_k(np.array([308.15]))[0]), rel=1e-4)


def test_cells_that_age_less_when_warm_are_not_heated_by_driving() -> None:
    """Of NMC622 in the frost a kelvin more saves capacity: it has no value for the controller."""
    frost = replace(HOT, parking_air_k=265.0, year_air_k=279.0)
    aging = ParkedAging(LAWS["nmc622"], frost, AMBIENT_K)
    assert float(aging.kelvin_price_1_k(np.array([275.0]))[0]) < 0.0
    assert valued("nmc622", warm(275.0), frost)[1] == 0.0


def test_a_kelvin_costs_no_more_than_its_removal_during_the_trip() -> None:
    """Much time and a hot pack: the marginal power that suffices until the lower limit, by hand."""
    state = warm(308.15)
    _, price = valued("nca", state, replace(HOT, electricity_eur_kwh=0.1))
    limit_k = PARAMETERS.limits.min_temperature_k
    rates_w, margins = cooling_supply(0.5 * (308.15 + limit_k), PARAMETERS)
    pack = PARAMETERS.pack
    heat_j_k = pack.cells_in_series * pack.parallel * PARAMETERS.cell.heat_capacity_j_k
    needed_w = heat_j_k * (308.15 - limit_k) / (TRIP_S - 28.0)
    margin = float(margins[np.searchsorted(rates_w, needed_w)])
    price_1_j = energy_price_1_j(replace(HOT, electricity_eur_kwh=0.1), PARAMETERS)
    assert price == pytest.approx(heat_j_k * price_1_j * margin, rel=1e-6)


def test_the_price_of_a_kelvin_rises_towards_the_destination() -> None:
    """The paper's value falls to zero there; the hours after the trip are still to come."""
    prices = [valued("nca", warm(308.15, time_s))[1] for time_s in (0.0, 900.0, 1700.0, 1800.0)]
    assert prices == sorted(prices)
    assert prices[-1] > 1.5 * prices[0]


@pytest.mark.parametrize("name", LAWS)
def test_a_horizon_may_take_the_price_of_a_kelvin_as_constant(name: str) -> None:
    """Cooling as hard as the chiller can for 28 s: the price at the start is within 7 % of the mean one."""
    aging = ParkedAging(LAWS[name], HOT, AMBIENT_K)
    pack = PARAMETERS.pack
    heat_j_k = pack.cells_in_series * pack.parallel * PARAMETERS.cell.heat_capacity_j_k
    cooled_k = 28.0 * float(cooling_supply(308.15, PARAMETERS)[0][-1]) / heat_j_k
    assert 0.5 < cooled_k < 2.0
    prices = aging.kelvin_price_1_k(308.15 - np.linspace(0.0, cooled_k, 20))
    assert prices[0] == pytest.approx(float(np.mean(prices)), rel=0.07)


def test_supply_begins_at_the_best_efficiency() -> None:
    rates_w, margins = cooling_supply(303.15, PARAMETERS)
    power_w, performance = most_efficient_cooling(303.15, PARAMETERS)
    assert rates_w[0] == pytest.approx(power_w * performance)
    assert margins[0] == pytest.approx(1.0 / performance)
    assert np.all(np.diff(rates_w) > 0.0)
    assert np.all(np.diff(margins) >= 0.0)
    assert cooling_supply(150.0, PARAMETERS)[0].size == 0


def test_without_a_known_end_cooling_waits_for_the_best_efficiency() -> None:
    _, price = valued("nca", warm(308.15), trip_s=math.inf)
    margins = cooling_supply(0.5 * (308.15 + PARAMETERS.limits.min_temperature_k), PARAMETERS)[1]
    pack = PARAMETERS.pack
    heat_j_k = pack.cells_in_series * pack.parallel * PARAMETERS.cell.heat_capacity_j_k
    assert price == pytest.approx(heat_j_k * energy_price_1_j(HOT, PARAMETERS) * margins[0])
