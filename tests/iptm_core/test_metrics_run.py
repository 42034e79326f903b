"""Figures of hand-made runs, worked out by hand, and corrected for how two runs ended."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_core.made_runs import PARAMETERS, make_run

from iptm_core.errors import StateError
from iptm_core.metrics.figures import FIGURES, SAVINGS, TRIP_FIGURES, figure_values
from iptm_core.metrics.run_metrics import RunMetrics, compute_metrics
from iptm_core.metrics.saving import cool_down
from iptm_core.parameters import load_parameters
from iptm_core.trajectory import Trajectory
from iptm_core.units import CELSIUS_ZERO_K


def _metrics(run: Trajectory) -> RunMetrics:
    return compute_metrics(run, PARAMETERS)


def test_energies_sum_interval_means_and_ignore_row_0() -> None:
    run = make_run(
        time_s=[0.0, 1.0, 2.0, 4.0],
        compressor_power_w=[999.0, 100.0, 200.0, 300.0],
        auxiliary_power_w=[999.0, 200.0, 200.0, 200.0],
        traction_power_w=[999.0, 5000.0, -1000.0, 2000.0],
        battery_power_w=[999.0, 6000.0, -500.0, 3000.0],
        chiller_heat_w=[999.0, 250.0, 500.0, 600.0],
    )
    found = _metrics(run)
    assert found.cooling_energy_j == 100.0 + 200.0 + 2 * 300.0 + 4 * 200.0
    assert found.traction_energy_j == 5000.0 - 1000.0 + 2 * 2000.0
    assert found.total_printed_energy_j == found.cooling_energy_j + found.traction_energy_j
    assert found.battery_energy_j == 6000.0 - 500.0 + 2 * 3000.0
    assert found.mean_cop == pytest.approx((250.0 + 500.0 + 1200.0) / 900.0)


def test_compressor_that_never_ran_has_no_cop() -> None:
    assert _metrics(make_run()).mean_cop is None


def test_degradation_is_the_increment_of_each_cell() -> None:
    run = make_run(
        cell_1_capacity_loss=[1e-3, 1.001e-3, 1.002e-3, 1.0121e-3],
        cell_n_capacity_loss=[2e-3, 2.001e-3, 2.002e-3, 2.0131e-3],
    )
    found = _metrics(run)
    assert found.cell_1_degradation == pytest.approx(1.21e-5, rel=1e-9)
    assert found.cell_n_degradation == pytest.approx(1.31e-5, rel=1e-9)
    assert found.inconsistency == pytest.approx(1e-6, rel=1e-6)


def test_gap_margin_follows_the_intelligent_driver_model() -> None:
    run = make_run(
        3,
        position_m=[0.0, 10.0, 30.0],
        speed_m_s=[0.0, 10.0, 20.0],
        leader_position_m=[15.0, 40.0, 90.0],
        leader_speed_m_s=[0.0, 15.0, 16.0],
    )
    # s_min = 5 + 1.5 v + v (v - v_PV) / (2 sqrt(2 * 2)): 5, 5 + 15 - 12.5, 5 + 30 + 20.
    gap = _metrics(run)
    assert (gap.smallest_gap_m, gap.largest_gap_m) == (15.0, 60.0)
    assert gap.mean_gap_m == pytest.approx(0.5 * ((15 + 30) / 2 + (30 + 60) / 2))
    assert gap.smallest_margin_m == pytest.approx(60.0 - 55.0)
    assert gap.smallest_margin_time_s == 2.0


def test_gaps_are_those_of_the_ticks_with_a_leader() -> None:
    """By hand: gaps of 20, 30, unknown, 10, 10 m; the known intervals have means of 25 and 10 m."""
    run = make_run(
        5,
        leader_position_m=[20.0, 30.0, math.nan, 10.0, 10.0],
        smallest_gap_m=[20.0, 20.0, math.nan, 9.0, 10.0],
        compressor_power_w=[0.0, 100.0, 100.0, 100.0, 100.0],
    )
    metrics = _metrics(run)
    assert (metrics.smallest_gap_m, metrics.largest_gap_m) == (10.0, 30.0)
    assert metrics.mean_gap_m == pytest.approx(0.5 * (25.0 + 10.0))
    assert metrics.smallest_margin_m == pytest.approx(5.0)
    assert metrics.smallest_margin_time_s == 3.0
    assert metrics.cooling_energy_j == pytest.approx(400.0)
    checks = {check.key: check for check in metrics.constraints}
    assert checks["smallest_gap"].violations == checks["collision"].violations == 0
    hit = make_run(3, leader_position_m=[20.0, math.nan, 20.0], smallest_gap_m=[20.0, -0.5, 20.0])
    assert {c.key: c for c in _metrics(hit).constraints}["collision"].violations == 1


def test_temperatures_are_averaged_over_time() -> None:
    run = make_run(
        3,
        time_s=[0.0, 1.0, 4.0],
        cell_1_temperature_k=[300.0, 302.0, 304.0],
        cell_n_temperature_k=[301.0, 305.0, 305.0],
    )
    mean_k = (301.0 * 1 + 303.0 * 3) / 4
    assert _metrics(run).cell_1_k == pytest.approx((300.0, mean_k, 304.0))


def test_run_metrics_gather_everything() -> None:
    run = make_run(
        time_s=[10.0, 11.0, 12.0, 13.0],
        position_m=[5.0, 6.0, 8.0, 9.0],
        leader_position_m=[30.0, 30.0, 30.0, 8.0],
        acceleration_m_s2=[0.0, 0.0, 3.0, 3.0],
    )
    metrics = _metrics(run)
    assert (metrics.duration_s, metrics.distance_m) == (3.0, 4.0)
    assert metrics.hard_violations == 2 + 1 + 1, "acceleration, its step, collision"
    assert metrics.soft_violations == 1, "gap below s_min"


def test_single_row_has_no_metrics() -> None:
    with pytest.raises(StateError, match="run of 1 row; allowed: at least 2"):
        compute_metrics(make_run(1), PARAMETERS)


def paper_column(cooling: float, traction: float, cell_1: float, cell_n: float) -> RunMetrics:
    """Figures that print like a column of the paper's results table."""
    run = make_run(
        2,
        auxiliary_power_w=[0.0, 1e3 * cooling],
        traction_power_w=[0.0, 1e3 * traction],
        battery_power_w=[0.0, 1.1e3 * (cooling + traction)],
        cell_1_capacity_loss=[0.0, 1e-5 * cell_1],
        cell_n_capacity_loss=[0.0, 1e-5 * cell_n],
    )
    return _metrics(run)


def test_rows_reproduce_the_printed_table() -> None:
    reference = paper_column(8049.01, 179033.67, 1.2789, 1.3718)
    proposed = paper_column(6492.42, 166888.65, 1.1156, 1.1803)
    values, base = figure_values(proposed), figure_values(reference)
    by_hand = {
        "cooling_energy": 6492.42,
        "traction_energy": 166888.65,
        "total_energy_printed": 173381.07,
        "battery_energy": 1.1 * 173381.07,
        "cell_1_degradation": 11.156,
        "cell_n_degradation": 11.803,
        "total_degradation": 22.959,
        "inconsistency": 0.647,
    }
    assert {key: values[key] for key in by_hand} == pytest.approx(by_hand)
    units = [FIGURES[key].unit for key in ("cooling_energy", "cell_1_degradation", "inconsistency")]
    assert units == ["kJ", "ppm", "ppm"]
    printed = {
        "cooling_energy": -19.34,
        "traction_energy": -6.78,
        "total_energy_printed": -7.32,
        "cell_1_degradation": -12.77,
        "cell_n_degradation": -13.96,
        "inconsistency": -30.36,
    }
    for key, percent in printed.items():
        assert 100.0 * (values[key] / base[key] - 1.0) == pytest.approx(percent, abs=0.006)


def test_a_figure_that_does_not_exist_is_left_out() -> None:
    values = figure_values(compute_metrics(make_run(), PARAMETERS))
    assert "mean_cop" not in values, "the compressor never ran"
    assert "fallbacks" not in values, "no decisions are known"
    assert set(TRIP_FIGURES) - set(values) == {
        "mean_cop",
        "consumption",
        "unbalanced_heat_share",
        "mean_headway",
        "median_headway",
    }, "it stands"
    assert values["cell_1_temperature_mean"] == pytest.approx(30.0)


def test_figures_are_printed_with_three_digits() -> None:
    degradation, cop = FIGURES["cell_1_degradation"], FIGURES["mean_cop"]
    assert cop.precise_text(None) == cop.precise_text(math.nan) == "–"
    assert degradation.precise_text(0.0062207) == "0.00622"
    assert degradation.precise_text(35.0) == "35.0"
    assert FIGURES["smallest_margin"].precise_text(1.2e-6) == "0"
    assert FIGURES["fallbacks"].precise_text(12.0) == "12"
    assert FIGURES["battery_energy"].precise_text(123456.7) == "123457"


def test_every_figure_has_a_sentence_of_its_own() -> None:
    figures = {**SAVINGS, **FIGURES}
    about = [figure.definition for figure in figures.values()]
    assert all(text.endswith(".") and text[0].isupper() for text in about)
    assert len(set(about)) == len(about)
    assert {"aging_saved", "energy_saved"} <= set(SAVINGS)
    losses = [figure for key, figure in FIGURES.items() if key.endswith("degradation")]
    assert {figure.unit for figure in losses} == {"ppm"}
    assert FIGURES["total_degradation"].about.endswith("Less is better.")


def test_gap_violations_count_collisions_and_short_gaps() -> None:
    gaps = np.array([90.0, -0.5, 90.0, 1.0])
    metrics = compute_metrics(make_run(leader_position_m=gaps), PARAMETERS)
    assert metrics.gap_violations == 3, "one row breaks both limits"
    assert metrics.hard_violations == 1


DEFAULTS = load_parameters().values
END = replace(
    compute_metrics(make_run(), DEFAULTS),
    final_temperature_k=CELSIUS_ZERO_K + 34.0,
    final_cell_losses=(1e-3, 1e-3),
    final_charge=math.nan,
)


def test_a_pack_that_is_no_warmer_needs_no_cooling() -> None:
    for target_k in (END.final_temperature_k, END.final_temperature_k + 3.0):
        assert cool_down(END, target_k, DEFAULTS) == (0.0, 0.0)


def test_by_hand() -> None:
    """A chiller that takes three times its power at any temperature, and cells that make no heat."""
    chiller = replace(
        DEFAULTS.chiller,
        xi_1=3.0,
        xi_2_1_w=0.0,
        xi_3_w_k=0.0,
        xi_4_j_kg_k=0.0,
        xi_5_j_kg_k=0.0,
        xi_6_w=0.0,
        gate_power_w=1.0,
    )
    cell = replace(DEFAULTS.cell, nominal_resistance_ohm=1e-5, entropic_coefficient_v_k=0.0)
    simple = replace(DEFAULTS, chiller=chiller, cell=cell)
    energy_j, loss = cool_down(END, END.final_temperature_k - 4.0, simple)
    # The auxiliaries run as long as the compressor, so the largest power is the cheapest: 4.5 kW.
    heat_j = 3648 * 45.0 * 4.0
    duration_s = heat_j / (3.0 * 4500.0)
    assert energy_j == pytest.approx((4500.0 + 200.0) * duration_s, rel=1e-3)
    # Eq. (12) by hand: 4700 W of 380 V over 38 cells, at 32 degC, both cells alike.
    current_a = 4700.0 / 380.0 / 38.0
    c_rate, z, temperature_k = current_a / 5.019, 0.824, CELSIUS_ZERO_K + 32.0
    exponent = (1516.0 * c_rate - 15162.0) / (8.314462618 * temperature_k) / z
    rate_1_s = z * 0.0032 ** (1 / z) / 3600.0 * current_a * np.exp(exponent) * 1e-3 ** (1 - 1 / z)
    assert loss == pytest.approx(2.0 * rate_1_s * duration_s, rel=2e-3)


def test_it_agrees_with_the_same_cooling_in_small_steps() -> None:
    """One step at the middle temperature against a hundred, each with its own best power."""
    target_k = END.final_temperature_k - 6.0
    once = cool_down(END, target_k, DEFAULTS)
    steps = [
        cool_down(replace(END, final_temperature_k=upper_k), upper_k - 0.06, DEFAULTS)
        for upper_k in np.linspace(END.final_temperature_k, target_k, 101)[:-1].tolist()
    ]
    assert once == pytest.approx(np.sum(steps, axis=0), rel=0.01)


def test_a_chiller_that_cannot_cool_has_no_price() -> None:
    broken = replace(DEFAULTS, chiller=replace(DEFAULTS.chiller, xi_6_w=-1e6))
    assert cool_down(END, END.final_temperature_k - 1.0, broken) is None
