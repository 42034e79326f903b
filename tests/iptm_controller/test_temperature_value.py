"""What a kelvin costs at the end of the horizon, against the laws that it is derived from."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, exact_rates, make_state
from tests.reference.temperature_value import ReferenceValuation, mean_c_rate_1_h

from iptm_controller.temperature_value import (
    TemperatureValuation,
    TemperatureValue,
    mixing_weights,
)
from iptm_controller.tick_library import tick_library
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import capacity_loss_rate_1_s
from iptm_core.physics.power_thermal import CellPair, power_thermal_rates
from iptm_core.physics.thermal_loop import most_efficient_cooling, reduce_channel
from iptm_core.state import LeaderPreview

STEADY = LeaderPreview(np.array([0.0]), np.array([0.0]), np.array([25.0]))
WEIGHT = 1e9


def cell_aging_rate_1_s(current_a: float, temperature_k: float, loss: float = 1e-3) -> float:
    rate: float = capacity_loss_rate_1_s(
        current_a, temperature_k, loss, PARAMETERS.aging, PARAMETERS.cell
    )
    return rate


def value_after(
    rate_1_s: float, elapsed_s: float = 1e5, trip_s: float = math.inf, horizon_s: float = 28.0
) -> TemperatureValue:
    """Price the temperatures after a trip with a constant rate, long enough to outweigh the forecast."""
    valuation = TemperatureValuation(tick_library(), PARAMETERS, WEIGHT, horizon_s, trip_s)
    valuation.value(make_state(time_s=0.0), STEADY)
    first = make_state(time_s=0.0)
    return valuation.value(
        make_state(
            time_s=elapsed_s,
            cell_1_capacity_loss=first.cell_1_capacity_loss + rate_1_s * elapsed_s,
            cell_n_capacity_loss=first.cell_n_capacity_loss + rate_1_s * elapsed_s,
        ),
        STEADY,
    )


@pytest.mark.parametrize("current_a", [0.5, 3.0, 8.0])
def test_the_mean_c_rate_is_the_inverse_of_the_aging_law(current_a: float) -> None:
    rate = cell_aging_rate_1_s(current_a, 305.0)
    expected = current_a / PARAMETERS.cell.nominal_capacity_ah
    assert mean_c_rate_1_h(rate, 305.0, 1e-3, PARAMETERS) == pytest.approx(expected, rel=1e-3)


def test_the_sensitivity_is_the_slope_of_the_aging_law() -> None:
    state = make_state()
    rate = cell_aging_rate_1_s(2.0, 0.5 * (state.cell_1_temperature_k + state.cell_n_temperature_k))
    value = value_after(rate, elapsed_s=1e3)
    middle = 0.5 * (state.cell_1_temperature_k + state.cell_n_temperature_k)
    slope = math.log(
        cell_aging_rate_1_s(2.0, middle + 0.5) / cell_aging_rate_1_s(2.0, middle - 0.5)
    )
    assert value.aging_sensitivity_1_k == pytest.approx(slope, rel=0.01)


def test_price_is_rate_times_sensitivity_times_duration() -> None:
    value = value_after(3e-10)
    price = (
        WEIGHT * value.aging_rate_1_s * value.aging_sensitivity_1_k * value.temperature_decay_time_s
    )
    assert value.cell_1_marginal_cost_1_k + value.cell_n_marginal_cost_1_k == pytest.approx(price)
    assert value.aging_rate_1_s == pytest.approx(6e-10, rel=1e-2)
    # About 2.4 % per kelvin, and a payback within the range that simulations gave.
    assert 0.022 < value.aging_sensitivity_1_k < 0.027
    assert 300.0 < value.temperature_decay_time_s < 900.0


def test_cooling_pays_back_after_the_time_that_a_kelvin_lasts() -> None:
    """By hand: heat of a kelvin over COP is energy; ageing by it equals what the kelvin ages until then."""
    rate = 3e-10
    value = value_after(rate)
    performance = most_efficient_cooling(PARAMETERS.limits.min_temperature_k, PARAMETERS)[1]
    pack = PARAMETERS.pack
    cells = pack.cells_in_series * pack.parallel
    energy_j = cells * PARAMETERS.cell.heat_capacity_j_k / performance
    middle = 0.5 * (make_state().cell_1_temperature_k + make_state().cell_n_temperature_k)
    current_a = PARAMETERS.cell.nominal_capacity_ah * mean_c_rate_1_h(
        rate, middle, 1e-3 + rate * 1e5, PARAMETERS
    )
    more_a = 1e-3
    loss = 1e-3 + rate * 1e5
    slope = (
        cell_aging_rate_1_s(current_a + more_a, middle, loss)
        - cell_aging_rate_1_s(current_a, middle, loss)
    ) / more_a
    aged_by_cooling = slope * energy_j / (pack.open_circuit_voltage_v * pack.parallel)
    aged_by_kelvin = rate * value.aging_sensitivity_1_k * value.temperature_decay_time_s
    assert aged_by_kelvin == pytest.approx(aged_by_cooling, rel=0.02)


def test_the_first_tick_uses_only_the_forecast() -> None:
    valuation = TemperatureValuation(tick_library(), PARAMETERS, WEIGHT, 28.0)
    value = valuation.value(make_state(), STEADY)
    rates = exact_rates(make_state(speed_m_s=25.0))
    expected = rates.cell_1_capacity_loss_rate_1_s + rates.cell_n_capacity_loss_rate_1_s
    assert value.aging_rate_1_s == pytest.approx(expected, rel=1e-6)


def test_a_leader_that_the_pack_could_not_follow_has_a_price() -> None:
    """It accelerates at 3.6 m/s^2 all along the horizon, which takes more than a cold pack delivers."""
    times = 100.0 + np.arange(30.0)
    leader = LeaderPreview(times, 1040.0 + 1.8 * (times - 100.0) ** 2, 3.6 * (times - 100.0))
    state = make_state(cell_1_temperature_k=288.15, cell_n_temperature_k=288.15)
    value = TemperatureValuation(tick_library(), PARAMETERS, WEIGHT, 28.0).value(state, leader)
    assert 1e-10 < value.aging_rate_1_s < 1e-6


def test_an_earlier_state_begins_a_new_trip() -> None:
    valuation = TemperatureValuation(tick_library(), PARAMETERS, WEIGHT, 28.0)
    first = valuation.value(make_state(time_s=50.0), STEADY)
    valuation.value(make_state(time_s=500.0, cell_1_capacity_loss=2e-3), STEADY)
    assert valuation.value(make_state(time_s=0.0), STEADY) == first


@pytest.mark.parametrize("name", ["paper_calibrated", "published_chiller", "textbook_cell"])
def test_mixing_keeps_the_weighted_mean(name: str) -> None:
    """The two-cell loop without a chiller: the rates cancel in the mean, and the difference decays."""
    values: ModelParameters = load_parameters(name).values
    first, last, decay_1_s = mixing_weights(values)
    assert first + last == pytest.approx(1.0)
    channel = reduce_channel(values.cooling, values.pack)
    cells = CellPair(300.0, 310.0, 1e-3, 1e-3)
    # No power but that of the auxiliaries, which is drawn by no cell here.
    loop = power_thermal_rates(0.0, 0.0, 0.0, 0.0, cells, values, channel)
    even = power_thermal_rates(
        0.0, 0.0, 0.0, 0.0, CellPair(305.0, 305.0, 1e-3, 1e-3), values, channel
    )
    rate_1 = loop.cell_1_temperature_rate_k_s - even.cell_1_temperature_rate_k_s
    rate_n = loop.cell_n_temperature_rate_k_s - even.cell_n_temperature_rate_k_s
    assert first * rate_1 + last * rate_n == pytest.approx(0.0, abs=2e-5)
    assert rate_1 - rate_n == pytest.approx(decay_1_s * 10.0, rel=1e-3)


def test_prices_in_c_are_those_of_python() -> None:
    rng = np.random.default_rng(4)
    for trip_s in (math.inf, 3000.0):
        given = tick_library(), PARAMETERS, WEIGHT, 28.0, trip_s
        forms = [ReferenceValuation(*given), TemperatureValuation(*given)]
        loss = 1e-3
        for tick in range(400):
            loss += float(rng.uniform(-1e-9, 1e-7))
            state = make_state(
                time_s=10.0 * tick,
                cell_1_temperature_k=float(rng.uniform(270.0, 325.0)),
                cell_1_capacity_loss=loss,
                cell_n_capacity_loss=1.1 * loss,
            )
            in_python, in_c = (form.value(state, STEADY) for form in forms)
            assert in_c == in_python
