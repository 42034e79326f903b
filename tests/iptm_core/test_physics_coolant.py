"""The coolant channel: the printed sum over all cells, and its reduction to two cells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import CoolingParameters, ModelParameters, PackParameters
from iptm_core.physics.coolant import (
    Channel,
    ChannelWeights,
    exchange_ratio,
    reduce_channel,
)

Agree = Callable[..., None]
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


def test_the_weights_of_the_default_channel() -> None:
    channel = reduce_channel(COOLING, PACK)
    last, outlet = channel.last_cell, channel.outlet
    assert (last.inlet, last.cell_1, last.cell_n) == pytest.approx(
        (0.023687, 0.239319, 0.736994), abs=6e-7
    )
    assert (outlet.inlet, outlet.cell_1, outlet.cell_n) == pytest.approx(
        (0.023300, 0.235405, 0.741295), abs=6e-7
    )


def test_the_weights_of_two_and_three_cells_by_hand() -> None:
    # r = 1/4; two cells: T_c,2 = 3/4 T_in + 1/4 T_1; T_out = 9/16 T_in + 3/16 T_1 + 1/4 T_2
    two, _, _ = channel_of(2, 0.25)
    assert (two.last_cell.inlet, two.last_cell.cell_1, two.last_cell.cell_n) == pytest.approx(
        (0.75, 0.25, 0.0), abs=1e-15
    )
    assert (two.outlet.inlet, two.outlet.cell_1, two.outlet.cell_n) == pytest.approx(
        (0.5625, 0.1875, 0.25), abs=1e-15
    )
    # three cells, the middle one half of each: T_c,3 = 9/16 T_in + 3/16 T_1 + 1/4 (T_1 + T_3) / 2
    three, _, _ = channel_of(3, 0.25)
    assert (three.last_cell.inlet, three.last_cell.cell_1, three.last_cell.cell_n) == pytest.approx(
        (0.5625, 0.3125, 0.125), abs=1e-15
    )


@given(inlet=TEMPERATURES, cell_1=TEMPERATURES, cell_n=TEMPERATURES)
def test_the_reduction_is_the_full_sum_over_228_cells(
    inlet: float, cell_1: float, cell_n: float
) -> None:
    channel, ratio = reduce_channel(COOLING, PACK), exchange_ratio(COOLING, PACK)
    cells = spread(cell_1, cell_n, 228)
    assert channel.last_cell.temperature_k(inlet, cell_1, cell_n) == pytest.approx(
        printed_sum(inlet, cells, ratio, 228), rel=1e-13
    )
    assert channel.outlet.temperature_k(inlet, cell_1, cell_n) == pytest.approx(
        printed_sum(inlet, cells, ratio, 229), rel=1e-13
    )


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


@pytest.mark.parametrize("heat_w", [0.05, 0.3, 1.0])
def test_in_steady_state_the_linear_profile_is_exact(heat_w: float) -> None:
    """Cells that heat alike sit heat / h above the coolant, so the coolant warms by equal steps."""
    ratio = exchange_ratio(COOLING, PACK)
    above = heat_w / 0.4901
    coolant, cells = 295.0, []
    for _ in range(228):
        cells.append(coolant + above)
        coolant += ratio * above
    channel = reduce_channel(COOLING, PACK)
    assert channel.outlet.temperature_k(295.0, cells[0], cells[-1]) == pytest.approx(
        coolant, rel=1e-13
    )
    assert channel.last_cell.temperature_k(295.0, cells[0], cells[-1]) == pytest.approx(
        cells[-1] - above, rel=1e-13
    )


def test_a_channel_of_equal_temperature_stays_so() -> None:
    channel = reduce_channel(COOLING, PACK)
    for weights in (channel.last_cell, channel.outlet):
        assert weights.temperature_k(300.0, 300.0, 300.0) == pytest.approx(300.0, rel=1e-14)


def test_all_backends_agree(each_set: ModelParameters, agree_in_all_backends: Agree) -> None:
    random = np.random.default_rng(7)
    columns = random.uniform(288.0, 318.0, (3, 40))
    channel = reduce_channel(each_set.cooling, each_set.pack)
    weights: ChannelWeights
    for weights in (channel.last_cell, channel.outlet):
        agree_in_all_backends(weights.temperature_k, *columns)
