"""Figures of hand-made runs, worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from iptm_core.errors import StateError
from iptm_core.metrics import (
    FIGURES,
    TRIP_FIGURES,
    ConstraintCheck,
    RunMetrics,
    check_constraints,
    cold_compressor_energies_j,
    compute_metrics,
    figure_values,
)
from iptm_core.parameters import load_parameters
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory

PARAMETERS = load_parameters(
    overrides={
        "gap.standstill_gap_m": 5.0,
        "gap.time_headway_s": 1.5,
        "gap.max_gap_m": 120.0,
        "limits.min_acceleration_m_s2": -2.0,
        "limits.max_acceleration_m_s2": 2.0,
        "limits.max_jerk_m_s3": 0.5,
        "limits.max_compressor_power_w": 4500.0,
        "limits.max_compressor_rate_w_s": 200.0,
        "limits.max_speed_m_s": 37.5,
        "limits.min_temperature_k": 298.15,
        "limits.max_temperature_k": 313.15,
    }
).values


def make_run(rows: int = 4, /, **columns: object) -> Trajectory:
    """A calm run at standstill behind a standing leader, with the given columns replaced."""
    calm = dict.fromkeys(TRAJECTORY_COLUMNS, np.zeros(rows))
    calm["time_s"] = np.arange(float(rows))
    calm["leader_position_m"] = np.full(rows, 15.0)
    for name in TRAJECTORY_COLUMNS:
        if name.endswith("temperature_k"):
            calm[name] = np.full(rows, 303.15)
    return Trajectory.from_arrays({**calm, **columns})  # type: ignore[dict-item]


def _metrics(run: Trajectory) -> RunMetrics:
    return compute_metrics(run, PARAMETERS)


def _check(run: Trajectory, key: str) -> ConstraintCheck:
    return next(check for check in check_constraints(run, PARAMETERS) if check.key == key)


def test_energies_sum_interval_means_and_ignore_row_0() -> None:
    run = make_run(
        time_s=[0.0, 1.0, 2.0, 4.0],
        compressor_power_w=[999.0, 100.0, 200.0, 300.0],
        auxiliary_power_w=[999.0, 200.0, 200.0, 200.0],
        traction_power_w=[999.0, 5000.0, -1000.0, 2000.0],
        battery_power_w=[999.0, 6000.0, -500.0, 3000.0],
        chiller_heat_w=[999.0, 250.0, 500.0, 600.0],
    )
    energy = _metrics(run).energy
    assert energy.cooling_j == 100.0 + 200.0 + 2 * 300.0 + 4 * 200.0
    assert energy.traction_j == 5000.0 - 1000.0 + 2 * 2000.0
    assert energy.total_printed_j == energy.cooling_j + energy.traction_j
    assert energy.battery_j == 6000.0 - 500.0 + 2 * 3000.0
    assert energy.mean_cop == pytest.approx((250.0 + 500.0 + 1200.0) / 900.0)


def test_compressor_that_never_ran_has_no_cop() -> None:
    assert _metrics(make_run()).energy.mean_cop is None


@given(
    arrays(np.float64, 6, elements=st.floats(-1e5, 1e5)),
    arrays(np.float64, 5, elements=st.floats(0.1, 10.0)),
    st.integers(1, 4),
)
def test_energy_of_a_run_is_the_sum_of_its_parts(
    power: np.ndarray, steps: np.ndarray, cut: int
) -> None:
    times = np.concatenate([[0.0], np.cumsum(steps)])

    def part(rows: slice) -> float:
        count = len(times[rows])
        run = make_run(count, time_s=times[rows], traction_power_w=power[rows])
        return _metrics(run).energy.traction_j

    whole = part(slice(0, 6))
    assert part(slice(0, cut + 1)) + part(slice(cut, 6)) == pytest.approx(whole, abs=1e-6)


def test_degradation_is_the_increment_of_each_cell() -> None:
    run = make_run(
        cell_1_capacity_loss=[1e-3, 1.001e-3, 1.002e-3, 1.0121e-3],
        cell_n_capacity_loss=[2e-3, 2.001e-3, 2.002e-3, 2.0131e-3],
    )
    loss = _metrics(run).degradation
    assert loss.cell_1 == pytest.approx(1.21e-5, rel=1e-9)
    assert loss.cell_n == pytest.approx(1.31e-5, rel=1e-9)
    assert loss.inconsistency == pytest.approx(1e-6, rel=1e-6)


def test_gap_margin_follows_the_intelligent_driver_model() -> None:
    run = make_run(
        3,
        position_m=[0.0, 10.0, 30.0],
        speed_m_s=[0.0, 10.0, 20.0],
        leader_position_m=[15.0, 40.0, 90.0],
        leader_speed_m_s=[0.0, 15.0, 16.0],
    )
    # s_min = 5 + 1.5 v + v (v - v_PV) / (2 sqrt(2 * 2)): 5, 5 + 15 - 12.5, 5 + 30 + 20.
    gap = _metrics(run).gap
    assert gap.smallest_m == 15.0
    assert gap.largest_m == 60.0
    assert gap.mean_m == pytest.approx(0.5 * ((15 + 30) / 2 + (30 + 60) / 2))
    assert gap.smallest_margin_m == pytest.approx(60.0 - 55.0)
    assert gap.smallest_margin_time_s == 2.0


def test_temperatures_are_averaged_over_time() -> None:
    run = make_run(
        3,
        time_s=[0.0, 1.0, 4.0],
        cell_1_temperature_k=[300.0, 302.0, 304.0],
        cell_n_temperature_k=[301.0, 305.0, 305.0],
    )
    heat = _metrics(run).temperature
    assert (heat.cell_1_k.minimum, heat.cell_1_k.maximum) == (300.0, 304.0)
    assert heat.cell_1_k.mean == pytest.approx((301.0 * 1 + 303.0 * 3) / 4)
    assert (heat.spread_k.minimum, heat.spread_k.maximum) == (1.0, 3.0)
    assert heat.spread_k.mean == pytest.approx((2.0 * 1 + 2.0 * 3) / 4)
    assert heat.coolant_outlet_k.mean == pytest.approx(303.15)


def test_the_compressor_in_the_cold_is_counted_from_what_both_cells_were_before() -> None:
    run = make_run(
        time_s=np.array([0.0, 1.0, 3.0, 4.0]),
        compressor_power_w=np.array([900.0, 100.0, 200.0, 400.0]),
        cell_1_temperature_k=np.array([290.0, 290.0, 290.0, 290.0]),
        cell_n_temperature_k=np.array([290.0, 298.0, 299.0, 299.0]),
    )
    assert cold_compressor_energies_j(run, PARAMETERS).tolist() == [0.0, 100.0, 400.0, 0.0]


def test_calm_run_keeps_every_limit() -> None:
    for check in check_constraints(make_run(), PARAMETERS):
        assert (check.violations, check.worst_excess, check.worst_time_s) == (0, 0.0, None), check


def test_hard_limits_come_first_and_keys_are_unique() -> None:
    checks = check_constraints(make_run(), PARAMETERS)
    assert [check.key for check in checks] == [
        "acceleration",
        "acceleration_step",
        "compressor_power",
        "compressor_power_step",
        "collision",
        "speed",
        "smallest_gap",
        "largest_gap",
        "cell_1_temperature",
        "cell_n_temperature",
        "coolant_outlet_temperature",
    ]
    assert [check.hard for check in checks] == [True] * 5 + [False] * 6


# key, columns that break it in rows 2 and 3 (worst in row 3), worst excess
BROKEN: list[tuple[str, dict[str, list[float]], float]] = [
    ("acceleration", {"acceleration_m_s2": [0, 0, 2.1, 2.5]}, 0.5),
    ("acceleration", {"acceleration_m_s2": [0, 0, -2.1, -2.5]}, 0.5),
    ("acceleration_step", {"acceleration_m_s2": [0, 0.5, -0.1, 0.8]}, 0.4),
    ("acceleration_step", {"time_s": [0, 2, 3, 3.5], "acceleration_m_s2": [0, 1, 1.6, 2]}, 0.15),
    ("compressor_power", {"compressor_power_w": [0, 0, 4501, 4600]}, 100.0),
    ("compressor_power", {"compressor_power_w": [0, 0, -1, -2]}, 2.0),
    ("compressor_power_step", {"compressor_power_w": [0, 200, -10, 300]}, 110.0),
    ("collision", {"leader_position_m": [15, 0, -0.5, -1]}, 1.0),
    ("speed", {"speed_m_s": [0, 37.5, 38, 38.5]}, 1.0),
    ("speed", {"speed_m_s": [0, 0, -0.5, -1]}, 1.0),
    ("smallest_gap", {"leader_position_m": [15, 5, 4, 3]}, 2.0),
    ("largest_gap", {"leader_position_m": [15, 120, 121, 125]}, 5.0),
    ("cell_1_temperature", {"cell_1_temperature_k": [300, 313.15, 313.65, 315.15]}, 2.0),
    ("cell_n_temperature", {"cell_n_temperature_k": [300, 298.15, 297.65, 297.15]}, 1.0),
    ("coolant_outlet_temperature", {"coolant_outlet_temperature_k": [300, 300, 314, 318.15]}, 5.0),
]


@pytest.mark.parametrize(("key", "columns", "worst"), BROKEN)
def test_broken_limits_are_counted_with_the_worst_excess(
    key: str, columns: dict[str, list[float]], worst: float
) -> None:
    check = _check(make_run(**columns), key)
    assert check.violations == 2
    assert check.worst_excess == pytest.approx(worst)
    assert check.worst_time_s == make_run(**columns).time_s[3]


# key, column, values exactly at the limit, direction that breaks it in the last row
AT_LIMIT: list[tuple[str, str, list[float], float]] = [
    ("acceleration", "acceleration_m_s2", [2, 2, 2, 2], 1),
    ("acceleration_step", "acceleration_m_s2", [0, 0, 0, -0.5], -1),
    ("compressor_power", "compressor_power_w", [0, 0, 0, 0], -1),
    ("compressor_power_step", "compressor_power_w", [0, 0, 0, 200], 1),
    ("speed", "speed_m_s", [0, 0, 0, 37.5], 1),
    ("smallest_gap", "leader_position_m", [5, 5, 5, 5], -1),
    ("largest_gap", "leader_position_m", [120, 120, 120, 120], 1),
    ("cell_1_temperature", "cell_1_temperature_k", [300, 300, 300, 313.15], 1),
    ("cell_n_temperature", "cell_n_temperature_k", [300, 300, 300, 298.15], -1),
    ("coolant_outlet_temperature", "coolant_outlet_temperature_k", [300, 300, 300, 313.15], 1),
]


@pytest.mark.parametrize(("key", "column", "values", "direction"), AT_LIMIT)
def test_excess_within_the_tolerance_is_shown_but_not_counted(
    key: str, column: str, values: list[float], direction: float
) -> None:
    tolerance = _check(make_run(), key).tolerance
    for factor, violations in [(0.0, 0), (0.9, 0), (1.1, 1)]:
        last = values[-1] + direction * factor * tolerance
        check = _check(make_run(**{column: [*values[:-1], last]}), key)
        assert check.violations == violations
        assert check.worst_excess == pytest.approx(factor * tolerance, abs=1e-6 * tolerance)


def test_touching_is_no_collision() -> None:
    assert _check(make_run(leader_position_m=[1, 1, 1, 0]), "collision").violations == 0


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


@pytest.fixture
def paper_column() -> Callable[[float, float, float, float], RunMetrics]:
    """Build figures that print like a column of the paper's results table."""

    def build(cooling: float, traction: float, cell_1: float, cell_n: float) -> RunMetrics:
        run = make_run(
            2,
            auxiliary_power_w=[0.0, 1e3 * cooling],
            traction_power_w=[0.0, 1e3 * traction],
            battery_power_w=[0.0, 1.1e3 * (cooling + traction)],
            cell_1_capacity_loss=[0.0, 1e-5 * cell_1],
            cell_n_capacity_loss=[0.0, 1e-5 * cell_n],
        )
        return compute_metrics(run, PARAMETERS)

    return build


def test_rows_reproduce_the_printed_table(
    paper_column: Callable[[float, float, float, float], RunMetrics],
) -> None:
    reference = paper_column(8049.01, 179033.67, 1.2789, 1.3718)
    proposed = paper_column(6492.42, 166888.65, 1.1156, 1.1803)
    values, base = figure_values(proposed), figure_values(reference)
    by_hand = {
        "cooling_energy": 6492.42,
        "traction_energy": 166888.65,
        "total_energy_printed": 173381.07,
        "battery_energy": 1.1 * 173381.07,
        "cell_1_degradation": 1.1156,
        "cell_n_degradation": 1.1803,
        "total_degradation": 2.2959,
        "inconsistency": 6.47,
    }
    assert {key: values[key] for key in by_hand} == pytest.approx(by_hand)
    units = [FIGURES[key].unit for key in ("cooling_energy", "cell_1_degradation", "inconsistency")]
    assert units == ["kJ", "10⁻⁵", "10⁻⁷"]
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
    assert set(TRIP_FIGURES) - set(values) == {"mean_cop"}
    assert values["cell_1_temperature_mean"] == pytest.approx(30.0)


def test_figures_are_printed_with_their_unit() -> None:
    degradation, cop = FIGURES["cell_1_degradation"], FIGURES["mean_cop"]
    assert degradation.with_unit(1.23456) == "1.2346·10⁻⁵"
    assert FIGURES["cooling_energy"].with_unit(12345.678) == "12 345.68 kJ"
    assert cop.with_unit(2.5) == "2.50"
    assert cop.text(None) == cop.precise_text(math.nan) == "–"
    assert degradation.precise_text(0.0062207) == "0.0062207"
    assert FIGURES["battery_energy"].precise_text(123456.7) == "123457"


def test_gap_violations_count_collisions_and_short_gaps() -> None:
    gaps = np.array([90.0, -0.5, 90.0, 1.0])
    metrics = compute_metrics(make_run(leader_position_m=gaps), PARAMETERS)
    assert metrics.gap_violations == 3, "one row breaks both limits"
    assert metrics.hard_violations == 1


def test_limits_come_from_the_parameters() -> None:
    run = make_run(leader_position_m=np.full(4, 90.0))
    tight = replace(PARAMETERS, gap=replace(PARAMETERS.gap, max_gap_m=80.0))
    assert compute_metrics(run, PARAMETERS).soft_violations == 0
    assert compute_metrics(run, tight).soft_violations == 4


def test_a_halt_breaks_no_limit_of_jerk() -> None:
    """At standstill the deceleration is gone at once; a moving vehicle cannot do that."""
    braking = [0.0, -0.4, -0.8, 0.0]
    halt = make_run(speed_m_s=[1.2, 1.0, 0.4, 0.0], acceleration_m_s2=braking)
    assert _check(halt, "acceleration_step").violations == 0
    rolling = make_run(speed_m_s=[1.2, 1.0, 0.4, 0.4], acceleration_m_s2=braking)
    assert _check(rolling, "acceleration_step").violations == 1


def test_the_top_speed_breaks_no_limit_of_jerk() -> None:
    """Where the drive holds the top speed the acceleration is gone at once; below it cannot be."""
    top = PARAMETERS.limits.max_speed_m_s
    speeding = [0.8, 0.8, 0.8, 0.0]
    held = make_run(speed_m_s=[top - 2.0, top - 1.2, top - 0.4, top], acceleration_m_s2=speeding)
    assert _check(held, "acceleration_step").violations == 0
    below = make_run(
        speed_m_s=[top - 3.0, top - 2.2, top - 1.4, top - 1], acceleration_m_s2=speeding
    )
    assert _check(below, "acceleration_step").violations == 1
