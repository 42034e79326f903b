"""A cell: its resistance, its heat, its temperature and the loss of its capacity."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.physics.cell import (
    capacity_loss_rate_1_s,
    cell_heat_w,
    cell_resistance_ohm,
    cell_temperature_rate_k_s,
)
from iptm_core.physics.electrical import pack_current_a, pack_resistance_ohm

VALUES = load_parameters().values
CELL, COOLING, PACK, AGING = VALUES.cell, VALUES.cooling, VALUES.pack, VALUES.aging
GAS = 8.314462618
TEMPERATURES = st.floats(298.15, 313.15)
CURRENTS = st.floats(0.01, 15.0)


def test_temperature_by_hand() -> None:
    # 20 K above nominal: 0.060 (1 - 0.008 * 20) = 0.0504 ohm
    assert cell_resistance_ohm(308.15, 0.0, CELL) == pytest.approx(0.0504, rel=1e-12)
    assert cell_resistance_ohm(278.15, 0.0, CELL) == pytest.approx(0.0648, rel=1e-12)


def test_ageing_by_hand() -> None:
    # Q_nom / Q_bc = 1 / 0.8 = 1.25; 1.1 * 1.25^2 = 1.71875
    aged = replace(CELL, resistance_aging_factor=1.1, resistance_aging_exponent=2.0)
    assert cell_resistance_ohm(288.15, 0.2, aged) == pytest.approx(0.060 * 1.71875, rel=1e-12)
    assert cell_resistance_ohm(308.15, 0.2, aged) == pytest.approx(0.0504 * 1.71875, rel=1e-12)


def test_heat_by_hand() -> None:
    # 3^2 * 0.05 + 3 * 300 * 4e-4 = 0.45 + 0.36 W; charging 0.45 - 0.36 W
    assert cell_heat_w(3.0, 0.05, 300.0, CELL) == pytest.approx(0.81, rel=1e-12)
    assert cell_heat_w(-3.0, 0.05, 300.0, CELL) == pytest.approx(0.09, rel=1e-12)
    assert cell_heat_w(0.0, 0.05, 300.0, CELL) == 0.0


def test_rate_by_hand() -> None:
    # (0.81 + 0.4901 (298 - 300)) / 45 = (0.81 - 0.9802) / 45
    assert cell_temperature_rate_k_s(0.81, 300.0, 298.0, CELL, COOLING) == pytest.approx(
        -0.1702 / 45.0, rel=1e-11
    )
    assert cell_temperature_rate_k_s(0.0, 300.0, 300.0, CELL, COOLING) == 0.0
    # without coolant contact in temperature, 45 W warm a cell by 1 K/s
    assert cell_temperature_rate_k_s(45.0, 300.0, 300.0, CELL, COOLING) == 1.0


@given(
    current=st.floats(-5.0, 10.0),
    resistance=st.floats(0.02, 0.08),
    temperature=st.floats(298.15, 313.15),
)
def test_the_heat_of_all_cells_is_what_the_pack_loses(
    current: float, resistance: float, temperature: float
) -> None:
    """96 x 38 cell heats close the pack's balance E I = P_b + heat."""
    heat = 96 * 38 * cell_heat_w(current, resistance, temperature, CELL)
    pack_current = 38 * current
    terminal = 380.0 * pack_current - heat
    found = pack_current_a(terminal, pack_resistance_ohm(resistance, PACK), temperature, CELL, PACK)
    assert found == pytest.approx(pack_current, rel=1e-12, abs=1e-10)


def rate(current: float, temperature: float, loss: float, width: float = 0.0) -> float:
    value: float = capacity_loss_rate_1_s(
        current, temperature, loss, AGING, CELL, current_smoothing_a=width
    )
    return value


def closed_form_loss(throughput_ah: float, temperature: float, c_rate: float) -> float:
    """Eq. (11) with the printed numbers."""
    exponent = (-15162.0 + 1516.0 * c_rate) / (GAS * temperature)
    return float(0.0032 * math.exp(exponent) * throughput_ah**0.824)


def throughput_ah(loss: float, temperature: float, c_rate: float) -> float:
    """The throughput at which eq. (11) reaches a loss."""
    return float((loss / closed_form_loss(1.0, temperature, c_rate)) ** (1.0 / 0.824))


def test_the_rate_by_hand() -> None:
    """Eq. (12) with 5.019 A (1C), 300 K and the initial loss of 0.001, factor by factor."""
    z = 0.824
    expected = (
        (5.019 / 3600.0)
        * z
        * 0.0032 ** (1.0 / z)
        * math.exp((-15162.0 + 1516.0) / (z * GAS * 300.0))
        * 0.001 ** (1.0 - 1.0 / z)
    )
    assert rate(5.019, 300.0, 0.001) == pytest.approx(expected, rel=1e-12)
    assert rate(-5.019, 300.0, 0.001) == rate(5.019, 300.0, 0.001)
    assert rate(0.0, 300.0, 0.001) == 0.0


@given(current=CURRENTS, temperature=TEMPERATURES, loss=st.floats(1e-4, 0.2))
def test_the_rate_is_the_slope_of_the_closed_form(
    current: float, temperature: float, loss: float
) -> None:
    """d Q / d A_h = z Q / A_h at the throughput that led to this loss."""
    c_rate = current / 5.019
    throughput = throughput_ah(loss, temperature, c_rate)
    slope_1_ah = 0.824 * loss / throughput
    assert rate(current, temperature, loss) == pytest.approx(
        slope_1_ah * current / 3600.0, rel=1e-10
    )


@given(current=st.floats(-15.0, 15.0), temperature=TEMPERATURES, loss=st.floats(1e-4, 0.3))
def test_ageing_never_reverses_and_slows_with_age(
    current: float, temperature: float, loss: float
) -> None:
    here = rate(current, temperature, loss)
    assert here >= 0.0
    assert rate(current, temperature, 1.01 * loss) <= here
    assert rate(current, temperature + 1.0, loss) >= here


@given(current=st.floats(-15.0, 15.0), temperature=TEMPERATURES, width=st.floats(0.001, 0.1))
def test_the_smoothed_rate_errs_by_a_known_amount(
    current: float, temperature: float, width: float
) -> None:
    """The magnitude is at most the width too high, so the rate is at most this current's slope off.

    With w = width: rate(|I| + e) - rate(|I|) for 0 <= e <= min(w, w^2 / (2 |I|)).
    """
    excess = width if current == 0.0 else min(width, width**2 / (2.0 * abs(current)))
    exact = rate(current, temperature, 0.001)
    error = rate(current, temperature, 0.001, width) - exact
    bound = rate(abs(current) + excess, temperature, 0.001) - exact
    assert -1e-12 * exact <= error <= bound + 1e-12 * (exact + bound)
