"""Two runs corrected for how they ended: by hand, and against the model integrated step by step."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_core.made_runs import make_run

from iptm_core.metrics import compute_metrics
from iptm_core.metrics.equal_end import NO_COOLING, cool_down
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import CELSIUS_ZERO_K

PARAMETERS = load_parameters().values
END = replace(
    compute_metrics(make_run(), PARAMETERS),
    final_temperature_k=CELSIUS_ZERO_K + 34.0,
    final_cell_losses=(1e-3, 1e-3),
    final_charge=math.nan,
)


def test_a_pack_that_is_no_warmer_needs_no_cooling() -> None:
    for target_k in (END.final_temperature_k, END.final_temperature_k + 3.0):
        assert cool_down(END, target_k, PARAMETERS) == NO_COOLING


def test_by_hand() -> None:
    """A chiller that takes three times its power at any temperature, and cells that make no heat."""
    chiller = replace(
        PARAMETERS.chiller,
        xi_1=3.0,
        xi_2_1_w=0.0,
        xi_3_w_k=0.0,
        xi_4_j_kg_k=0.0,
        xi_5_j_kg_k=0.0,
        xi_6_w=0.0,
        gate_power_w=1.0,
    )
    cell = replace(PARAMETERS.cell, nominal_resistance_ohm=1e-5, entropic_coefficient_v_k=0.0)
    simple = replace(PARAMETERS, chiller=chiller, cell=cell)
    found = cool_down(END, END.final_temperature_k - 4.0, simple)
    # The auxiliaries run as long as the compressor, so the largest power is the cheapest: 4.5 kW.
    heat_j = 3648 * 45.0 * 4.0
    duration_s = heat_j / (3.0 * 4500.0)
    assert found.compressor_power_w == pytest.approx(4500.0)
    assert found.duration_s == pytest.approx(duration_s, rel=1e-3)
    assert found.energy_j == pytest.approx((4500.0 + 200.0) * duration_s, rel=1e-3)
    # Eq. (12) by hand: 4700 W of 380 V over 38 cells, at 32 degC, both cells alike.
    current_a = 4700.0 / 380.0 / 38.0
    c_rate, z, temperature_k = current_a / 5.019, 0.824, CELSIUS_ZERO_K + 32.0
    exponent = (1516.0 * c_rate - 15162.0) / (8.314462618 * temperature_k) / z
    rate_1_s = z * 0.0032 ** (1 / z) / 3600.0 * current_a * np.exp(exponent) * 1e-3 ** (1 - 1 / z)
    assert found.capacity_loss == pytest.approx(2.0 * rate_1_s * duration_s, rel=2e-3)


def test_it_agrees_with_the_same_cooling_in_small_steps() -> None:
    """One step at the middle temperature against a hundred, each with its own best power."""
    target_k = END.final_temperature_k - 6.0
    once = cool_down(END, target_k, PARAMETERS)
    steps = [
        cool_down(replace(END, final_temperature_k=upper_k), upper_k - 0.06, PARAMETERS)
        for upper_k in np.linspace(END.final_temperature_k, target_k, 101)[:-1].tolist()
    ]
    assert once.energy_j == pytest.approx(sum(step.energy_j for step in steps if step), rel=0.01)
    loss = sum(step.capacity_loss for step in steps if step)
    assert once.capacity_loss == pytest.approx(loss, rel=0.01)


def test_a_chiller_that_cannot_cool_has_no_price() -> None:
    broken = replace(PARAMETERS, chiller=replace(PARAMETERS.chiller, xi_6_w=-1e6))
    assert cool_down(END, END.final_temperature_k - 1.0, broken) is None
