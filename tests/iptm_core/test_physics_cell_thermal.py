"""Heat of a cell and the rate of its temperature."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import cell_heat_w, cell_temperature_rate_k_s
from iptm_core.physics.electrical import pack_current_a, pack_resistance_ohm

Agree = Callable[..., None]
VALUES = load_parameters().values
CELL, COOLING, PACK = VALUES.cell, VALUES.cooling, VALUES.pack


def test_heat_by_hand() -> None:
    # 3^2 * 0.05 + 3 * 300 * 4e-4 = 0.45 + 0.36 W; charging 0.45 - 0.36 W
    assert cell_heat_w(3.0, 0.05, 300.0, CELL) == pytest.approx(0.81, rel=1e-12)
    assert cell_heat_w(-3.0, 0.05, 300.0, CELL) == pytest.approx(0.09, rel=1e-12)
    assert cell_heat_w(0.0, 0.05, 300.0, CELL) == 0.0


def test_a_small_charging_current_cools() -> None:
    assert cell_heat_w(-0.5, 0.05, 300.0, CELL) < 0.0


def test_rate_by_hand() -> None:
    # (0.81 + 0.4901 (298 - 300)) / 45 = (0.81 - 0.9802) / 45
    assert cell_temperature_rate_k_s(0.81, 300.0, 298.0, CELL, COOLING) == pytest.approx(
        -0.1702 / 45.0, rel=1e-11
    )
    assert cell_temperature_rate_k_s(0.0, 300.0, 300.0, CELL, COOLING) == 0.0
    # without coolant contact in temperature, 45 W warm a cell by 1 K/s
    assert cell_temperature_rate_k_s(45.0, 300.0, 300.0, CELL, COOLING) == 1.0


def test_the_cell_time_constant_is_92_s() -> None:
    """45 J/K / 0.4901 W/K: one kelvin above the coolant decays by 1/91.8 per second."""
    rate = cell_temperature_rate_k_s(0.0, 301.0, 300.0, CELL, COOLING)
    assert -1.0 / rate == pytest.approx(91.82, abs=0.01)


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


def test_all_backends_agree(each_set: ModelParameters, agree_in_all_backends: Agree) -> None:
    random = np.random.default_rng(6)
    current, resistance = random.uniform(-5.0, 10.0, 40), random.uniform(0.02, 0.08, 40)
    temperature, coolant = random.uniform(298.0, 313.0, 40), random.uniform(288.0, 313.0, 40)
    agree_in_all_backends(
        lambda i, r, t: cell_heat_w(i, r, t, each_set.cell), current, resistance, temperature
    )
    agree_in_all_backends(
        lambda q, t, c: cell_temperature_rate_k_s(q, t, c, each_set.cell, each_set.cooling),
        current,
        temperature,
        coolant,
    )
