"""Cooling from the printed numbers, against the aging law written out by hand."""

from __future__ import annotations

import math

import pytest

from iptm_core.parameters import load_parameters
from iptm_reproduction.printed_cooling import printed_cooling

KELVIN = 299.15


def test_figures_follow_from_the_printed_tables_by_hand() -> None:
    found = printed_cooling(load_parameters("paper_identified").values, KELVIN)
    gas = 0.824 * 8.314462618
    power_w = 187082.68e3 / 1e4
    c_rate = mean_c_rate_1_h()
    per_kelvin = (15162.0 - 1516.0 * c_rate) / (gas * KELVIN**2)
    differ_k = math.log(1.3718 / 1.2789) / per_kelvin
    assert found.cells_differ_k == pytest.approx(differ_k, rel=1e-3)
    assert found.heat_w == pytest.approx(0.144 * 3330.0 * differ_k, rel=1e-3)
    assert found.compressor_power_w == pytest.approx(8049.01e3 / 1e4 - 200.0)
    assert found.cop == pytest.approx(found.heat_w / found.compressor_power_w)
    # A joule more raises the aging by (1 + b c) / P, a kelvin less lowers it by alpha.
    costs_1_j = (1.0 + 1516.0 * c_rate / (gas * KELVIN)) / power_w
    kelvin_1_j = found.cop / (16 * 228 * 45.0)
    assert found.pays_after_s == pytest.approx(costs_1_j / (per_kelvin * kelvin_1_j), rel=1e-3)
    assert found.cop_to_pay_within(found.pays_after_s) == pytest.approx(found.cop)


def test_braking_gives_back_less_than_the_energy_term_charges() -> None:
    found = printed_cooling(load_parameters("paper_identified").values, KELVIN)
    gas_k = 0.824 * 8.314462618 * 313.15
    c_rate = mean_c_rate_1_h()
    loss_1_ah = 0.824 * 0.0032 ** (1 / 0.824) * 0.001 ** (1 - 1 / 0.824)
    rate_1_ah = loss_1_ah * math.exp((1516.0 * c_rate - 15162.0) / gas_k)
    slope_1_ah = rate_1_ah * (1.0 + 1516.0 * c_rate / gas_k)
    refund = 5e12 * 2.0 * slope_1_ah / 3600.0 / (380.0 * 38.0)
    assert found.braking_refund == pytest.approx(refund, rel=1e-3)
    assert found.braking_refund < 1.0


def mean_c_rate_1_h() -> float:
    """Mean C-rate of the printed reference."""
    return 187082.68e3 / 1e4 / (380.0 * 38.0) / 5.019
