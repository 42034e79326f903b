"""The coolant loop with chiller, heater and radiator: by hand, as a fixed point, and as a balance of heat."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.iptm_core.made_runs import make_run

from iptm_core.metrics.run_metrics import compute_metrics
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.chiller import ChillerLine, chiller_line
from iptm_core.physics.power_thermal import CellPair, power_thermal_rates
from iptm_core.physics.thermal_loop import (
    ChannelWeights,
    CoolantLoop,
    FullChannel,
    reduce_channel,
    solve_coolant_loop,
    thermal_actuation,
)

SETS = {name: load_parameters(name).values for name in ("paper_calibrated", "published_chiller")}
FLOW_W_K = 0.144 * 3330.0
TEMPERATURES = st.floats(293.15, 318.15)


def solve(
    values: ModelParameters, cell_1: float, cell_n: float, power: float, speed: float
) -> CoolantLoop:
    line = chiller_line(power, speed, values.chiller, values.cooling, values.environment)
    outlet = reduce_channel(values.cooling, values.pack).outlet
    return solve_coolant_loop(cell_1, cell_n, line, outlet, values.cooling)


@pytest.mark.parametrize("name", SETS)
@given(
    cell_1=TEMPERATURES,
    cell_n=TEMPERATURES,
    power=st.floats(0.0, 4500.0),
    speed=st.floats(0.0, 37.5),
)
def test_the_chiller_takes_what_the_cells_give(
    name: str, cell_1: float, cell_n: float, power: float, speed: float
) -> None:
    """Q_co = m_c C_p (T_out - T_in) = N_m sum h (T_bc,i - T_c,i): nothing is lost on the way."""
    values = SETS[name]
    loop = solve(values, cell_1, cell_n, power, speed)
    line = chiller_line(power, speed, values.chiller, values.cooling, values.environment)
    assert loop.cooling_rate_w == pytest.approx(line.cooling_rate_w(loop.outlet_k), abs=1e-7)
    assert loop.cooling_rate_w == pytest.approx(FLOW_W_K * (loop.outlet_k - loop.inlet_k), abs=1e-7)
    cells = np.linspace(cell_1, cell_n, 228)
    profile = FullChannel.of(values.cooling, values.pack).coolant_k(loop.inlet_k, cells)
    given_off = 16 * 0.4901 * float(np.sum(cells - np.array(profile[:-1])))
    assert loop.cooling_rate_w == pytest.approx(given_off, abs=1e-6)


def test_by_hand_with_round_numbers() -> None:
    """w = (0.2, 0.3, 0.5), cells at 30 and 40 degC, chiller of 47.952 W/K: a tenth of the flow.

    T_out = 0.2 T_in + 9 + 20 and T_in = 0.9 T_out give T_out = 29 / 0.82 degC.
    """
    cooling = SETS["paper_calibrated"].cooling
    loop = solve_coolant_loop(
        303.15, 313.15, ChillerLine(0.0, 47.952, 1.0), ChannelWeights(0.2, 0.3, 0.5), cooling
    )
    outlet_c = 29.0 / 0.82
    assert loop.outlet_k == pytest.approx(273.15 + outlet_c, rel=1e-13)
    assert loop.inlet_k == pytest.approx(273.15 + 0.9 * outlet_c, rel=1e-13)
    assert loop.cooling_rate_w == pytest.approx(47.952 * outlet_c, rel=1e-12)


PAPER = load_parameters().values


def with_all(
    heater_w: float = 5000.0, radiator_w_k: float = 150.0, **cooling: float
) -> ModelParameters:
    return replace(
        PAPER,
        limits=replace(PAPER.limits, max_heater_power_w=heater_w),
        cooling=replace(PAPER.cooling, radiator_w_k=radiator_w_k, **cooling),
    )


def loop_at(
    values: ModelParameters,
    power_w: float,
    cells_k: tuple[float, float],
    air_k: float,
) -> CoolantLoop:
    values = replace(values, environment=replace(values.environment, ambient_temperature_k=air_k))
    actuation = thermal_actuation(power_w, values)
    line = chiller_line(
        actuation.compressor_w, 10.0, values.chiller, values.cooling, values.environment
    )
    outlet = reduce_channel(values.cooling, values.pack).outlet
    return solve_coolant_loop(*cells_k, line, outlet, values.cooling, actuation=actuation)


def test_heater_by_hand() -> None:
    """4 kW at a coefficient of 2.5 warm the coolant, 479.52 W/K, by 20.85 K, and the cells take it all."""
    values = with_all(heater_performance=2.5)
    loop = loop_at(values, -4000.0, (280.0, 280.0), 280.0)
    assert loop.cooling_rate_w == -10000.0
    assert loop.inlet_k - loop.outlet_k == pytest.approx(10000.0 / FLOW_W_K, rel=1e-12)
    rates = [
        power_thermal_rates(
            0.0, 0.0, 0.0, power_w, CellPair(280.0, 280.0, 1e-3, 1e-3), values,
            reduce_channel(values.cooling, values.pack),
        )
        for power_w in (-4000.0, 0.0)
    ]  # fmt: skip
    drawn_w = rates[0].battery_power_w - rates[1].battery_power_w
    assert drawn_w == pytest.approx(4000.0 / values.pack.battery_efficiency, rel=1e-12)


def test_radiator_by_hand() -> None:
    """100 W of fan at P_r = 100 W open 1 - 1/e of 150 W/K between the outlet and the air."""
    values = with_all(radiator_w_k=150.0)
    values = replace(values, chiller=replace(values.chiller, gate_power_w=1e9))  # off at 100 W
    loop = loop_at(values, 100.0, (313.15, 313.15), 293.15)
    radiated_w = 150.0 * (1.0 - math.exp(-1.0)) * (loop.outlet_k - 293.15)
    assert loop.cooling_rate_w == pytest.approx(radiated_w, rel=1e-9)
    assert loop.outlet_k - loop.inlet_k == pytest.approx(radiated_w / FLOW_W_K, rel=1e-9)


def test_without_a_gate_the_chiller_takes_what_the_map_says_by_hand() -> None:
    """Eq. (14) as printed, at 36 km/h and 35 degC: (xi_3 + xi_5 m_c) T_c,out + xi_4 T_a m_a + xi_6."""
    values = with_all()
    chiller = replace(values.chiller, gate_power_w=0.0)
    loop = loop_at(replace(values, chiller=chiller), 0.0, (313.15, 313.15), 308.15)
    slope_w_k = chiller.xi_3_w_k + chiller.xi_5_j_kg_k * values.cooling.coolant_mass_flow_kg_s
    air_w = chiller.xi_4_j_kg_k * 35.0 * (0.07065 + 0.001683 * 36.0)
    map_w = slope_w_k * (loop.outlet_k - 273.15) + air_w + chiller.xi_6_w
    assert loop.cooling_rate_w == pytest.approx(map_w, rel=1e-9)
    assert loop.cooling_rate_w > 500.0
    assert loop_at(values, 0.0, (313.15, 313.15), 308.15).cooling_rate_w == 0.0


@given(
    power_w=st.floats(-5000.0, 4500.0),
    cells_k=st.tuples(st.floats(263.0, 320.0), st.floats(263.0, 320.0)),
    air_k=st.floats(253.15, 320.0),
)
def test_the_closed_form_is_the_fixed_point(
    power_w: float, cells_k: tuple[float, float], air_k: float
) -> None:
    """Around heater, radiator, chiller and channel again and again until nothing moves."""
    values = with_all()
    values = replace(values, environment=replace(values.environment, ambient_temperature_k=air_k))
    actuation = thermal_actuation(power_w, values)
    line = chiller_line(
        actuation.compressor_w, 10.0, values.chiller, values.cooling, values.environment
    )
    weights = reduce_channel(values.cooling, values.pack).outlet
    outlet = 300.0
    for _ in range(100):
        taken_w = (
            line.cooling_rate_w(outlet)
            + actuation.radiator_w_k * max(outlet - air_k, 0.0)
            - actuation.heating_w
        )
        # Half a step: the chiller alone may take more than the coolant brings.
        outlet = 0.5 * (outlet + weights.temperature_k(outlet - taken_w / FLOW_W_K, *cells_k))
    loop = loop_at(values, power_w, cells_k, air_k)
    assert loop.outlet_k == pytest.approx(outlet, abs=1e-6)
    assert loop.cooling_rate_w == pytest.approx(taken_w, abs=1e-3)


@given(power_w=st.floats(0.0, 4500.0), cell_k=st.floats(293.15, 318.15))
def test_without_heater_and_radiator_the_loop_is_that_of_the_paper(
    power_w: float, cell_k: float
) -> None:
    actuation = thermal_actuation(power_w, PAPER)
    assert (actuation.drawn_w, actuation.compressor_w) == (power_w, power_w)
    line = chiller_line(power_w, 10.0, PAPER.chiller, PAPER.cooling, PAPER.environment)
    outlet = reduce_channel(PAPER.cooling, PAPER.pack).outlet
    given_all = solve_coolant_loop(cell_k, cell_k, line, outlet, PAPER.cooling, actuation=actuation)
    assert given_all == solve_coolant_loop(cell_k, cell_k, line, outlet, PAPER.cooling)


@pytest.mark.parametrize("power_w", [-3000.0, -200.0, -20.0, 0.0, 20.0, 200.0, 3000.0])
def test_the_smoothed_actuator_errs_by_half_its_width_at_most(power_w: float) -> None:
    values, width_w = with_all(), 20.0
    exact, smooth = (thermal_actuation(power_w, values, width) for width in (0.0, width_w))
    bound_w = min(0.5 * width_w, 0.25 * width_w**2 / max(abs(power_w), 1e-9)) * (1.0 + 1e-9)
    assert 0.0 <= smooth.compressor_w - exact.compressor_w <= bound_w
    assert 0.0 <= smooth.heating_w - exact.heating_w <= bound_w
    assert exact.drawn_w == abs(power_w)


def test_the_actuator_reaches_down_to_the_heater() -> None:
    assert PAPER.limits.lowest_thermal_power_w == PAPER.limits.min_compressor_power_w
    assert with_all(heater_w=6000.0).limits.lowest_thermal_power_w == -6000.0


def test_the_energy_of_a_heater_counts_and_its_heat_is_no_cooling() -> None:
    """Two seconds of 3 kW of heat, one of 1 kW of compressor that takes 2 kW: 7 kJ, a coefficient of 2."""
    powers = {"compressor_power_w": np.array([0.0, -3000.0, -3000.0, 1000.0])}
    heat = {"chiller_heat_w": np.array([0.0, -3000.0, -3000.0, 2000.0])}
    found = compute_metrics(make_run(**powers, **heat), PAPER)
    assert (found.cooling_energy_j, found.mean_cop) == (7000.0, 2.0)
