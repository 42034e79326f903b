"""Every cell of a coolant channel: the printed sum, the closed loop, and the two-cell reduction."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.physics.cell import cell_heat_w
from iptm_core.physics.chiller import ChillerLine, chiller_line
from iptm_core.physics.coolant import FullChannel, mean_cell_heat_w, reduce_channel
from iptm_core.physics.thermal_loop import CoolantLoop, solve_coolant_loop
from iptm_core.state import FloatArray

VALUES = load_parameters().values
COOLING, PACK = VALUES.cooling, VALUES.pack
CHANNEL = FullChannel.of(COOLING, PACK)
TEMPERATURES = st.floats(273.15, 323.15)


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
        printed = (1.0 - ratio) ** (i - 1) * inlet
        for j in range(2, i + 1):
            printed += ratio * (1.0 - ratio) ** (i - j) * cells[j - 2]
        assert found[i - 1] == pytest.approx(printed, rel=1e-12)


def test_three_cells_by_hand() -> None:
    # r = 1/2 behind 300 K: 300, then (300 + 310) / 2 = 305, (305 + 305) / 2 = 305, (305 + 325) / 2 = 315
    assert FullChannel(3, 0.5).coolant_k(300.0, [310.0, 305.0, 325.0]) == [
        300.0,
        305.0,
        305.0,
        315.0,
    ]


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


def test_symbols_and_arrays_agree() -> None:
    cells = np.linspace(300.0, 305.0, CHANNEL.cells) + np.sin(np.arange(CHANNEL.cells))
    symbol = ca.SX.sym("cells", CHANNEL.cells)
    function = ca.Function("f", [symbol], [ca.vertcat(*CHANNEL.coolant_k(295.0, symbol))])
    assert np.array(function(cells)).ravel() == pytest.approx(
        CHANNEL.coolant_k(295.0, cells), rel=1e-14
    )


@given(currents=st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=10).map(np.array))
def test_heat_under_a_changing_current_is_the_mean_of_the_heat(currents: FloatArray) -> None:
    expected = np.mean([cell_heat_w(current, 0.05, 305.0, VALUES.cell) for current in currents])
    mean, square = float(np.mean(currents)), float(np.mean(currents**2))
    assert mean_cell_heat_w(mean, square, 0.05, 305.0, VALUES.cell) == pytest.approx(
        expected, rel=1e-9, abs=1e-9
    )
