"""The cost to go until arrival, such as at a fast charger."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from studies.life.fast_charge import ChargingStopSettings, arrival_cost_eur, fast_charge
from tests.iptm_controller.scenes import make_scene, make_state

from iptm_controller.arrival import LARGEST_PRICE_RATIO, ArrivalCost, ArrivalValuation
from iptm_controller.controller import MpcController
from iptm_controller.options import ControllerOptions
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.strategy import STRATEGIES
from iptm_controller.temperature_value import NO_VALUE, mixing_weights
from iptm_core.errors import ParameterError
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters

STOP = ChargingStopSettings(charging_minute_kwh=0.25)
HEAT_J_K = 350e3
ARRIVAL_S, HORIZON_S = 3600.0, 28.0
EFFICIENCY = load_parameters().values.pack.battery_efficiency


def car(air_c: float, **more: float) -> ModelParameters:
    kelvin = air_c + 273.15
    return load_parameters(
        overrides={
            "cell.heat_capacity_j_k": HEAT_J_K / 3648,
            "limits.max_heater_power_w": 5000.0,
            "environment.ambient_temperature_k": kelvin,
            "environment.initial_cell_temperature_k": kelvin,
            **more,
        }
    ).values


def cost(model: ModelParameters) -> ArrivalCost:
    parsed = ArrivalCost.parse(arrival_cost_eur(STOP, model))
    assert parsed is not None
    return parsed


def valuation(model: ModelParameters) -> ArrivalValuation:
    return ArrivalValuation(cost(model), 0.25, model, 0.4, 0.6, HORIZON_S, ARRIVAL_S)


def test_at_the_charger_a_kelvin_has_the_value_of_the_minutes_saved() -> None:
    model = car(15.0)
    model = replace(model, limits=replace(model.limits, max_heater_power_w=20e3))
    around = fast_charge(np.array([291.15, 292.15]), STOP, model).minutes
    saved_j_k = float(around[0] - around[1]) * STOP.charging_minute_kwh * 3.6e6
    price = valuation(model).price_1_k(ARRIVAL_S, 291.65)
    assert 0.0 < saved_j_k < LARGEST_PRICE_RATIO * HEAT_J_K / EFFICIENCY  # the cap plays no part
    assert price == pytest.approx(-saved_j_k, rel=0.05)


def test_with_time_to_spare_a_kelvin_costs_what_the_heater_takes_for_it() -> None:
    """Without air exchange nothing is lost on the way: 1 K is HEAT_J_K, now or later."""
    price = valuation(car(5.0)).price_1_k(600.0, 278.65)
    assert price == pytest.approx(-HEAT_J_K / EFFICIENCY, rel=0.03)


def test_heat_lost_to_the_air_before_arrival_has_no_value() -> None:
    """A kelvin decays with the time constant of the air exchange."""
    lossy = valuation(car(5.0, **{"cooling.air_exchange_w_k": 100.0}))
    early, late = (lossy.price_1_k(time_s, 278.65) for time_s in (300.0, 1500.0))
    assert early / late == pytest.approx(math.exp(-1200.0 * 100.0 / HEAT_J_K), rel=0.05)
    assert 0.0 > early > late > -HEAT_J_K / EFFICIENCY


def test_the_price_is_capped_where_the_heater_runs_anyway() -> None:
    price = valuation(car(-10.0)).price_1_k(ARRIVAL_S - 60.0, 263.15)
    assert price == pytest.approx(-LARGEST_PRICE_RATIO * HEAT_J_K / EFFICIENCY)


def test_no_kelvin_is_cooled_away_before_fast_charging() -> None:
    value = valuation(car(35.0))
    prices = [
        value.price_1_k(time_s, t) for time_s in (0.0, 1800.0, 3600.0) for t in range(288, 313)
    ]
    assert max(prices) <= 1e-6 * HEAT_J_K


def test_ageing_on_the_way_counts_for_the_time_that_is_left() -> None:
    """A watt for each kelvin above 10 degC: half an hour before arrival a kelvin costs 1800 J more."""
    model = car(5.0)
    flat = ArrivalCost((-20.0, 60.0), (0.0, 0.0))
    value = ArrivalValuation(
        flat, 0.25, model, 0.4, 0.6, HORIZON_S, ARRIVAL_S, lambda kelvin: kelvin - 283.15
    )
    price = value.price_1_k(ARRIVAL_S - HORIZON_S - 1800.0, 300.0)
    assert price == pytest.approx(1800.0, rel=0.1)
    assert value.price_1_k(ARRIVAL_S, 300.0) == 0.0


def test_both_cells_share_the_price() -> None:
    value = valuation(car(5.0))
    state = make_state(time_s=ARRIVAL_S, cell_1_temperature_k=280.0, cell_n_temperature_k=282.0)
    added = value.added_to(
        replace(NO_VALUE, cell_1_marginal_cost_1_k=1.0, cell_n_marginal_cost_1_k=2.0), state
    )
    total = added.cell_1_marginal_cost_1_k + added.cell_n_marginal_cost_1_k - 3.0
    share_1, share_n, _ = mixing_weights(car(5.0))
    mean_k = 280.0 * share_1 + 282.0 * share_n
    assert total == pytest.approx(value.price_1_k(ARRIVAL_S, mean_k))
    assert added.thermal_energy_price_1_j == 0.6


@pytest.mark.parametrize(
    ("prices_1_j", "trip_s", "message"),
    [((0.0, 0.0), 1800.0, "neither energy nor ageing"), ((0.4, 0.6), math.inf, "no known end")],
)
def test_a_charger_needs_a_price_of_energy_and_a_time_of_arrival(
    prices_1_j: tuple[float, float], trip_s: float, message: str
) -> None:
    with pytest.raises(ParameterError, match=message):
        ArrivalValuation(cost(car(15.0)), 0.25, car(15.0), *prices_1_j, HORIZON_S, trip_s)


@pytest.mark.parametrize(
    ("left_s", "air_c", "heats"), [(300.0, 5.0, True), (5000.0, 5.0, False), (300.0, 30.0, False)]
)
@pytest.mark.parametrize("strategy", ["aging_cost_to_go", "energy_aging"])
def test_the_controller_heats_when_it_is_time(
    strategy: str, left_s: float, air_c: float, heats: bool
) -> None:
    state = make_state(cell_1_temperature_k=air_c + 273.15, cell_n_temperature_k=air_c + 273.15)
    model = car(air_c, **{"cooling.air_exchange_w_k": 100.0})
    options = ControllerOptions(
        STRATEGIES[strategy],
        solver=SolverOptions(),
        trip_duration_s=state.time_s + left_s,
        arrival=cost(model),
    )
    controller = MpcController(model, options)
    decision = controller.decide(replace(make_scene(), state=state))
    assert decision.result is not None
    power_w = decision.command.compressor_power_w
    assert power_w == pytest.approx(-200.0, abs=0.1) if heats else power_w > -20.0
