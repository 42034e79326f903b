"""Cell resistance under temperature and ageing, both at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import cell_resistance_ohm

Agree = Callable[..., None]
CELL = load_parameters().values.cell


def test_a_new_cell_at_nominal_temperature_has_its_nominal_resistance() -> None:
    assert cell_resistance_ohm(288.15, 0.0, CELL) == 0.060


def test_temperature_by_hand() -> None:
    # 20 K above nominal: 0.060 (1 - 0.008 * 20) = 0.0504 ohm
    assert cell_resistance_ohm(308.15, 0.0, CELL) == pytest.approx(0.0504, rel=1e-12)
    assert cell_resistance_ohm(278.15, 0.0, CELL) == pytest.approx(0.0648, rel=1e-12)


def test_ageing_by_hand() -> None:
    # Q_nom / Q_bc = 1 / 0.8 = 1.25; 1.1 * 1.25^2 = 1.71875
    aged = replace(CELL, resistance_aging_factor=1.1, resistance_aging_exponent=2.0)
    assert cell_resistance_ohm(288.15, 0.2, aged) == pytest.approx(0.060 * 1.71875, rel=1e-12)
    assert cell_resistance_ohm(308.15, 0.2, aged) == pytest.approx(0.0504 * 1.71875, rel=1e-12)


def test_without_an_exponent_ageing_leaves_the_resistance_alone() -> None:
    constant = replace(CELL, resistance_aging_exponent=0.0)
    assert cell_resistance_ohm(300.0, 0.3, constant) == cell_resistance_ohm(300.0, 0.0, constant)


@given(temperature=st.floats(298.15, 313.15), loss=st.floats(0.0, 0.3))
def test_warmer_cells_resist_less_and_older_cells_more(temperature: float, loss: float) -> None:
    here = cell_resistance_ohm(temperature, loss, CELL)
    assert here > 0.0
    assert cell_resistance_ohm(temperature + 1.0, loss, CELL) < here
    assert cell_resistance_ohm(temperature, loss + 0.01, CELL) > here


def test_the_loss_of_one_trip_moves_the_resistance_by_the_same_share() -> None:
    before, after = (cell_resistance_ohm(303.15, loss, CELL) for loss in (0.001, 0.00101))
    assert after / before - 1.0 == pytest.approx(1e-5, rel=2e-3)


def test_all_backends_agree(each_set: ModelParameters, agree_in_all_backends: Agree) -> None:
    random = np.random.default_rng(4)
    agree_in_all_backends(
        lambda temperature, loss: cell_resistance_ohm(temperature, loss, each_set.cell),
        random.uniform(290.0, 320.0, 40),
        random.uniform(0.0, 0.3, 40),
    )
