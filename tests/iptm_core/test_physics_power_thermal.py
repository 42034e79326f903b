"""All effects together: balances that close, limits, and what smoothing does to the whole model."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import PowerLimitError
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.power_thermal import (
    EXACT,
    CellPair,
    PowerThermalRates,
    Smoothing,
    electric_traction_power_w,
    power_thermal_rates,
)
from iptm_core.physics.thermal_loop import reduce_channel

Agree = Callable[..., None]
VALUES = load_parameters().values
IN_USE = Smoothing(
    force_n=150.0, power_w=500.0, c_rate_1_h=0.05 / 5.019, speed_m_s=0.3, deliverable_margin=0.02
)
CELLS_IN_PACK = 96 * 38
OPERATION = {
    "speed": st.floats(0.0, 37.5),
    "acceleration": st.floats(-2.0, 2.0),
    "slope": st.floats(-0.06, 0.06),
    "power": st.floats(0.0, 4500.0),
    "cell_1": st.floats(298.15, 313.15),
    "cell_n": st.floats(298.15, 313.15),
}


def evaluate(
    speed: Any,
    acceleration: Any,
    slope: Any,
    power: Any,
    cell_1: Any,
    cell_n: Any,
    values: ModelParameters = VALUES,
    smoothing: Smoothing = EXACT,
) -> PowerThermalRates:
    return power_thermal_rates(
        speed,
        acceleration,
        slope,
        power,
        CellPair(cell_1, cell_n, 0.001, 0.0011),
        values,
        reduce_channel(values.cooling, values.pack),
        smoothing,
    )


def operating_grid() -> list[np.ndarray[Any, np.dtype[np.float64]]]:
    """Speeds from 1 m/s on, all accelerations and slopes, fine around the sign change of the force."""
    axes = np.meshgrid(
        np.linspace(1.0, 37.5, 25),
        np.unique(np.concatenate([np.linspace(-2.0, 2.0, 21), np.linspace(-0.7, 0.5, 121)])),
        np.linspace(-0.06, 0.06, 7),
        [0.0, 2000.0],
    )
    return [axis.ravel() for axis in axes]


def test_motion_to_power_by_hand() -> None:
    """20 m/s, level, 0.5 m/s^2: 347.1672 + 731.752 N at the wheels."""
    force = 347.1672 + 1432.0 * 1.022 * 0.5
    torque = force * 0.28 / (2.80 * 3.789 * 0.9)
    expected = 37.89 * 20.0 * torque + 0.873 * torque**2
    assert electric_traction_power_w(20.0, 0.5, 0.0, VALUES) == pytest.approx(expected, rel=1e-12)
    rates = evaluate(20.0, 0.5, 0.0, 800.0, 303.15, 305.15)
    assert rates.traction_power_w == pytest.approx(expected, rel=1e-12)
    assert rates.battery_power_w == pytest.approx(expected + 1000.0, rel=1e-12)


def test_a_held_vehicle_draws_no_traction_power_on_any_slope() -> None:
    for slope in (-0.06, 0.0, 0.06):
        assert electric_traction_power_w(0.0, 0.0, slope, VALUES) == 0.0
        assert electric_traction_power_w(0.0, -1.0, slope, VALUES) == 0.0
        assert electric_traction_power_w(0.0, 0.0, slope, VALUES, IN_USE) == 0.0
    # without the hold a 6 % slope would cost about 0.8 kW of copper loss
    rolling = electric_traction_power_w(1e-9, 0.0, 0.06, VALUES)
    assert rolling == pytest.approx(800.0, rel=0.1)


@given(**OPERATION)
def test_the_packs_energy_balance_closes(
    speed: float, acceleration: float, slope: float, power: float, cell_1: float, cell_n: float
) -> None:
    """E I = P_b + the heat of all cells, driving and regenerating, with the cells' own mean values."""
    try:
        rates = evaluate(speed, acceleration, slope, power, cell_1, cell_n)
    except PowerLimitError:
        pytest.fail("the operating range must lie inside the power of the pack")
    current = rates.cell_current_a
    assert rates.pack_current_a == pytest.approx(38 * current, rel=1e-14)
    ratio = 1.0 - 0.008 * (np.array([cell_1, cell_n]) - 288.15)
    resistance = 0.060 * ratio / (1.0 - np.array([0.001, 0.0011]))
    heat = CELLS_IN_PACK * (
        current**2 * resistance.mean() + current * 0.5 * (cell_1 + cell_n) * 4e-4
    )
    chemical = 380.0 * rates.pack_current_a
    assert rates.battery_power_w + heat == pytest.approx(chemical, rel=1e-12, abs=1e-8)


@given(**OPERATION)
def test_rates_of_both_cells_from_their_own_balances(
    speed: float, acceleration: float, slope: float, power: float, cell_1: float, cell_n: float
) -> None:
    """C_c dT/dt = heat - h (T - T_c): the first cell meets the inlet, the last the reduced channel."""
    rates = evaluate(speed, acceleration, slope, power, cell_1, cell_n)
    current = rates.cell_current_a
    coolant_n = 0.023687 * rates.coolant.inlet_k + 0.239319 * cell_1 + 0.736994 * cell_n
    for temperature, loss, coolant, rate in (
        (cell_1, 0.001, rates.coolant.inlet_k, rates.cell_1_temperature_rate_k_s),
        (cell_n, 0.0011, coolant_n, rates.cell_n_temperature_rate_k_s),
    ):
        resistance = 0.060 * (1.0 - 0.008 * (temperature - 288.15)) / (1.0 - loss)
        heat = current**2 * resistance + current * temperature * 4e-4
        expected = (heat + 0.4901 * (coolant - temperature)) / 45.0
        assert rate == pytest.approx(expected, rel=1e-5, abs=5e-6)  # six digits of the weights


def test_a_parked_warm_pack_is_cooled_by_its_compressor() -> None:
    off, on = (evaluate(0.0, 0.0, 0.0, power, 308.15, 308.15) for power in (0.0, 2000.0))
    assert off.battery_power_w == 200.0
    assert off.coolant.inlet_k == off.coolant.outlet_k == pytest.approx(308.15, rel=1e-14)
    assert on.battery_power_w == 2200.0
    assert on.cell_1_temperature_rate_k_s < on.cell_n_temperature_rate_k_s < 0.0
    assert on.coolant.inlet_k < on.coolant.outlet_k < 308.15


@pytest.mark.parametrize(
    ("width", "moved"),
    [
        ({"force_n": 150.0}, "traction_power_w"),
        ({"speed_m_s": 0.3}, "traction_power_w"),
        ({"power_w": 500.0}, "battery_power_w"),
        ({"c_rate_1_h": 0.05}, "cell_1_capacity_loss_rate_1_s"),
    ],
)
def test_every_width_smooths_its_own_kink(width: dict[str, float], moved: str) -> None:
    """At gentle coasting all kinks are near; what comes before the smoothed one stays exact."""
    chain = ["traction_power_w", "battery_power_w", "cell_1_capacity_loss_rate_1_s"]
    point = (2.0, -0.14, 0.0, 0.0, 303.15, 303.15)
    exact, smooth = evaluate(*point), evaluate(*point, smoothing=Smoothing(**width))
    for name in chain[: chain.index(moved)]:
        assert getattr(smooth, name) == getattr(exact, name)
    assert getattr(smooth, moved) != pytest.approx(getattr(exact, moved), rel=1e-4)


def test_more_than_a_cold_pack_can_deliver_costs_more() -> None:
    """Uphill at full acceleration: the exact model has no answer, that of the optimiser a rising price."""
    accelerations = np.linspace(0.0, 2.0, 41)
    point = (37.0, accelerations, 0.15, 0.0, np.full(41, 253.15), np.full(41, 253.15))
    with np.errstate(invalid="ignore"):
        exact = evaluate(*point).cell_n_capacity_loss_rate_1_s
    assert np.isfinite(exact[0])
    assert np.isnan(exact[-1])
    smooth = evaluate(*point, smoothing=Smoothing(deliverable_margin=0.02))
    for name in ("battery_power_w", "cell_n_capacity_loss_rate_1_s", "cell_n_temperature_rate_k_s"):
        assert np.all(np.diff(getattr(smooth, name)) > 0.0), name
    deliverable = smooth.pack_current_a < 0.85 * 2.0 * smooth.battery_power_w / 380.0
    np.testing.assert_array_equal(
        smooth.cell_n_capacity_loss_rate_1_s[deliverable], exact[deliverable]
    )


def test_what_the_widths_in_use_mean_above_5_m_s() -> None:
    """Traction within 600 W and 0.4 % in the mean, terminals 660 W, ageing 4 % of its mean and 0.6 %."""
    grid = [axis[operating_grid()[0] > 5.0] for axis in operating_grid()]
    cells = (np.full_like(grid[0], 303.15), np.full_like(grid[0], 305.15))
    exact = evaluate(*grid, *cells)
    smooth = evaluate(*grid, *cells, smoothing=IN_USE)

    def error(name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.abs(getattr(smooth, name) - getattr(exact, name))

    traction_error, battery_error = error("traction_power_w"), error("battery_power_w")
    assert np.max(traction_error) < 600.0
    assert np.mean(traction_error) < 0.004 * np.mean(np.abs(exact.traction_power_w))
    assert np.max(battery_error) < 660.0
    driving = exact.traction_power_w > 5000.0
    assert np.max(battery_error[driving] / exact.battery_power_w[driving]) < 0.06
    ageing_error = error("cell_n_capacity_loss_rate_1_s")
    mean_rate = np.mean(exact.cell_n_capacity_loss_rate_1_s)
    assert np.max(ageing_error) < 0.04 * mean_rate
    assert np.mean(ageing_error) < 0.006 * mean_rate
    assert np.max(error("cell_n_temperature_rate_k_s")) < 2e-4


@pytest.mark.parametrize("smoothing", [EXACT, IN_USE], ids=["exact", "smoothed"])
def test_all_backends_agree(
    each_set: ModelParameters, smoothing: Smoothing, agree_in_all_backends: Agree
) -> None:
    random = np.random.default_rng(12)
    columns = [
        np.concatenate([random.uniform(0.0, 37.5, 20), [0.0, 0.0, 0.0]]),
        np.concatenate([random.uniform(-2.0, 2.0, 20), [0.0, -1.0, 0.5]]),
        random.uniform(-0.06, 0.06, 23),
        np.concatenate([random.uniform(0.0, 4500.0, 20), [0.0, 0.0, 0.0]]),
        random.uniform(298.15, 313.15, 23),
        random.uniform(298.15, 313.15, 23),
    ]
    names = [name for name in PowerThermalRates.__dataclass_fields__ if name != "coolant"]
    for name in names:
        agree_in_all_backends(
            lambda *point, name=name: getattr(
                evaluate(*point, values=each_set, smoothing=smoothing), name
            ),
            *columns,
            rtol=1e-11,
        )
