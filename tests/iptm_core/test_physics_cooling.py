"""The chiller map, and the coolant channel: the printed sum, its reduction, and the closed loop."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import available_parameter_sets, load_parameters
from iptm_core.parameters.model import CoolingParameters, ModelParameters, PackParameters
from iptm_core.physics.cell import cell_heat_w
from iptm_core.physics.chiller import (
    ChillerLine,
    air_mass_flow_kg_s,
    chiller_line,
    compressor_gate,
    largest_useful_power_w,
)
from iptm_core.physics.thermal_loop import (
    Channel,
    CoolantLoop,
    FullChannel,
    exchange_ratio,
    mean_cell_heat_w,
    reduce_channel,
    solve_coolant_loop,
)
from iptm_core.state import FloatArray

CALIBRATED = load_parameters().values
PUBLISHED = load_parameters("published_chiller").values


def line(values: ModelParameters, power_w: float, speed_m_s: float = 10.0) -> ChillerLine:
    return chiller_line(power_w, speed_m_s, values.chiller, values.cooling, values.environment)


def test_the_air_flow_takes_its_speed_in_km_h() -> None:
    # 10 m/s = 36 km/h: 0.07065 + 0.001683 * 36 = 0.131238 kg/s
    assert air_mass_flow_kg_s(10.0, CALIBRATED.chiller) == pytest.approx(0.131238, rel=1e-12)
    assert air_mass_flow_kg_s(0.0, CALIBRATED.chiller) == 0.07065
    # the public model of the same system has 0.00606 per m/s
    slope = air_mass_flow_kg_s(1.0, CALIBRATED.chiller) - 0.07065
    assert slope == pytest.approx(0.00606, rel=5e-4)


def test_the_gate_by_hand() -> None:
    gate = {power: compressor_gate(power, CALIBRATED.chiller) for power in (0.0, 500.0, 1000.0)}
    assert gate[0.0] == 0.0
    assert gate[500.0] == pytest.approx(1.0 - math.exp(-1.0), rel=1e-14)
    assert gate[1000.0] == pytest.approx(1.0 - math.exp(-4.0), rel=1e-14)
    assert compressor_gate(4500.0, CALIBRATED.chiller) == pytest.approx(1.0, abs=1e-15)


def test_the_calibrated_map_by_hand() -> None:
    """1000 W, 10 m/s, 35 degC air and 30 degC coolant, term by term."""
    cooling = (
        2.2 * 1000.0
        - 1.6e-4 * 1e6
        + 4.1710995 * 35.0 * 0.131238
        - 1396.3143182
        + (-1579.2336767 + 11348.8506087 * 0.144) * 30.0
    )
    gated = (1.0 - math.exp(-4.0)) * cooling
    assert line(CALIBRATED, 1000.0).cooling_rate_w(303.15) == pytest.approx(gated, rel=1e-10)
    assert gated == pytest.approx(2270.0, rel=1e-2)


@given(
    power=st.floats(100.0, 4400.0),
    speed=st.floats(0.0, 37.0),
    outlet=st.floats(298.15, 313.15),
)
def test_more_power_more_air_and_warmer_coolant_cool_more(
    power: float, speed: float, outlet: float
) -> None:
    """Holds for the calibrated set over the whole operating range."""
    here = line(CALIBRATED, power, speed).cooling_rate_w(outlet)
    assert line(CALIBRATED, power + 50.0, speed).cooling_rate_w(outlet) > here
    assert line(CALIBRATED, power, speed + 0.5).cooling_rate_w(outlet) > here
    assert line(CALIBRATED, power, speed).cooling_rate_w(outlet + 0.5) > here


def test_beyond_the_vertex_of_the_published_map_more_power_is_of_no_use() -> None:
    """xi_1 + 2 xi_2 P = 0 near 3023 W; the fit would cool less beyond."""
    peak = 1.860278870 / (2.0 * 0.000307654)
    assert peak == pytest.approx(3023.3, abs=0.1)
    assert largest_useful_power_w(PUBLISHED.chiller, PUBLISHED.limits) == pytest.approx(peak)
    assert largest_useful_power_w(CALIBRATED.chiller, CALIBRATED.limits) == 4500.0
    at_peak, beyond = (line(PUBLISHED, p).cooling_rate_w(303.15) for p in (peak, peak + 500.0))
    assert beyond == pytest.approx(at_peak, rel=1e-9)


@pytest.mark.parametrize("name", available_parameter_sets())
def test_more_power_never_cools_less_and_never_heats(name: str) -> None:
    """Over the whole range of the compressor, from 26 degC to 39.5 degC of air."""
    power = np.linspace(0.0, 4500.0, 901)
    for ambient_c in (26.0, 39.5):
        ambient = {"environment.ambient_temperature_k": ambient_c + 273.15}
        values = load_parameters(name, ambient).values
        for speed_m_s, outlet_k in product((0.0, 15.0, 37.5), (263.15, 298.15, 333.15)):
            rate = line(values, power, speed_m_s).cooling_rate_w(outlet_k)
            assert rate[0] == 0.0
            assert np.diff(rate).min() >= -1e-9


VALUES = load_parameters().values
COOLING, PACK = VALUES.cooling, VALUES.pack
TEMPERATURES = st.floats(288.15, 318.15)


def printed_sum(inlet: float, cells: list[float], ratio: float, index: int) -> float:
    """T_c,i of the paper: (1-r)^(i-1) T_in + sum_{j=2}^{i} r (1-r)^(i-j) T_bc,j-1."""
    total = (1.0 - ratio) ** (index - 1) * inlet
    for j in range(2, index + 1):
        total += ratio * (1.0 - ratio) ** (index - j) * cells[j - 2]
    return total


def spread(first: float, last: float, count: int) -> list[float]:
    return [first + (last - first) * k / (count - 1) for k in range(count)]


def channel_of(cells: int, ratio: float) -> tuple[Channel, CoolingParameters, PackParameters]:
    pack = replace(PACK, cells_per_channel=cells)
    cooling = replace(COOLING, convective_coefficient_w_k=ratio * 3330.0 * 0.144 / 16.0)
    return reduce_channel(cooling, pack), cooling, pack


def test_the_exchange_ratio_is_a_ratio_of_heat_capacity_rates() -> None:
    # C_f = 3330 * 0.144 / 16 = 29.97 W/K; r = 0.4901 / 29.97
    assert exchange_ratio(COOLING, PACK) == pytest.approx(0.4901 / 29.97, rel=1e-12)
    assert exchange_ratio(COOLING, PACK) == pytest.approx(0.016353, abs=5e-7)


@given(
    count=st.integers(2, 500),
    ratio=st.floats(1e-4, 0.95),
    inlet=TEMPERATURES,
    cell_1=TEMPERATURES,
    cell_n=TEMPERATURES,
)
def test_the_reduction_holds_for_every_number_of_cells(
    count: int, ratio: float, inlet: float, cell_1: float, cell_n: float
) -> None:
    channel, cooling, pack = channel_of(count, ratio)
    cells, exchanged = spread(cell_1, cell_n, count), exchange_ratio(cooling, pack)
    for weights, index in ((channel.last_cell, count), (channel.outlet, count + 1)):
        expected = printed_sum(inlet, cells, exchanged, index)
        assert weights.temperature_k(inlet, cell_1, cell_n) == pytest.approx(expected, rel=1e-12)
        assert weights.inlet + weights.cell_1 + weights.cell_n == pytest.approx(1.0, abs=1e-12)
        assert min(weights.inlet, weights.cell_1, weights.cell_n) >= 0.0


CHANNEL = FullChannel.of(COOLING, PACK)


def line_at(power_w: float) -> ChillerLine:
    return chiller_line(power_w, 20.0, VALUES.chiller, COOLING, VALUES.environment)


def closed(channel: FullChannel, cells: FloatArray, power_w: float) -> CoolantLoop:
    equivalent = channel.equivalent_cell_k(cells)
    return solve_coolant_loop(equivalent, equivalent, line_at(power_w), channel.outlet, COOLING)


@given(
    inlet=TEMPERATURES,
    cells=st.lists(TEMPERATURES, min_size=2, max_size=40),
    ratio=st.floats(1e-4, 0.95),
)
def test_the_coolant_is_the_printed_sum(inlet: float, cells: list[float], ratio: float) -> None:
    found = FullChannel(len(cells), ratio).coolant_k(inlet, cells)
    for i in range(1, len(cells) + 2):
        assert found[i - 1] == pytest.approx(printed_sum(inlet, cells, ratio, i), rel=1e-12)


@given(first=TEMPERATURES, last=TEMPERATURES, power=st.floats(0.0, 2500.0))
def test_a_linear_profile_gives_the_two_cell_reduction(
    first: float, last: float, power: float
) -> None:
    reduced = reduce_channel(COOLING, PACK)
    expected = solve_coolant_loop(first, last, line_at(power), reduced.outlet, COOLING)
    cells = np.linspace(first, last, CHANNEL.cells)
    loop = closed(CHANNEL, cells, power)
    for name in ("inlet_k", "outlet_k", "cooling_rate_w"):
        assert getattr(loop, name) == pytest.approx(getattr(expected, name), rel=1e-9, abs=1e-6)
    last_coolant = CHANNEL.coolant_k(loop.inlet_k, cells)[-2]
    assert last_coolant == pytest.approx(
        reduced.last_cell.temperature_k(expected.inlet_k, first, last), rel=1e-10
    )


@given(
    cells=st.lists(TEMPERATURES, min_size=2, max_size=300).map(np.array),
    power=st.floats(0.0, 2500.0),
)
def test_the_chiller_takes_what_the_cells_give(cells: FloatArray, power: float) -> None:
    channel = replace(CHANNEL, cells=cells.size)
    loop = closed(channel, cells, power)
    coolant = np.array(channel.coolant_k(loop.inlet_k, cells))
    assert coolant[-1] == pytest.approx(loop.outlet_k, rel=1e-11)
    given_w = PACK.modules * COOLING.convective_coefficient_w_k * np.sum(cells - coolant[:-1])
    assert given_w == pytest.approx(loop.cooling_rate_w, rel=1e-8, abs=1e-6)


@given(currents=st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=10).map(np.array))
def test_heat_under_a_changing_current_is_the_mean_of_the_heat(currents: FloatArray) -> None:
    expected = np.mean([cell_heat_w(current, 0.05, 305.0, VALUES.cell) for current in currents])
    mean, square = float(np.mean(currents)), float(np.mean(currents**2))
    assert mean_cell_heat_w(mean, square, 0.05, 305.0, VALUES.cell) == pytest.approx(
        expected, rel=1e-9, abs=1e-9
    )
