"""Limits kept and broken in hand-made runs, and for how long they were broken."""

from __future__ import annotations

import numpy as np
import pytest
from tests.iptm_core.made_runs import PARAMETERS, make_run

from iptm_core.metrics.constraints import (
    Concern,
    ConstraintCheck,
    IneffectiveCooling,
    Streak,
    check_constraints,
)
from iptm_core.metrics.figures import figure_values
from iptm_core.metrics.run_metrics import compute_metrics
from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory


def _check(run: Trajectory, key: str) -> ConstraintCheck:
    return next(check for check in check_constraints(run, PARAMETERS) if check.key == key)


def test_calm_run_keeps_every_limit() -> None:
    for check in check_constraints(make_run(), PARAMETERS):
        assert (check.violations, check.worst_excess, check.worst_time_s) == (0, 0.0, None), check


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
    times_s = make_run(**columns).time_s
    assert (check.first_time_s, check.worst_time_s) == (times_s[2], times_s[3])
    assert f"2 ticks, first at {times_s[2]:g} s, worst by" in check.text


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


ROWS = 200


@pytest.fixture
def limits(parameters: ModelParameters) -> dict[str, float]:
    return vars(parameters.limits)


def longest(run: Trajectory, parameters: ModelParameters, concern: Concern) -> float:
    return figure_values(compute_metrics(run, parameters))[f"longest_{concern.value}"]


def within(first: int, last: int, inside: float, outside: float) -> np.ndarray:
    """A column that has another value from one row to another, both included."""
    column = np.full(ROWS, outside)
    column[first : last + 1] = inside
    return column


def test_a_calm_run_is_no_concern(parameters: ModelParameters) -> None:
    assert set(compute_metrics(make_run(ROWS), parameters).longest_s.values()) == {0.0}


def test_the_longest_of_several_streaks_counts(parameters: ModelParameters) -> None:
    gap = within(10, 30, 2.0, 15.0)
    gap[50:58] = 1.0
    run = make_run(ROWS, leader_position_m=gap)
    assert longest(run, parameters, Concern.SHORT_GAP) == 20.0
    assert longest(run, parameters, Concern.LONG_GAP) == 0.0
    far = make_run(ROWS, leader_position_m=within(3, 8, 500.0, 15.0))
    assert longest(far, parameters, Concern.LONG_GAP) == 5.0


def test_a_fast_ego_and_a_hot_cell(parameters: ModelParameters, limits: dict[str, float]) -> None:
    fast = within(5, 17, limits["max_speed_m_s"] + 0.1, 1.0)
    assert longest(make_run(ROWS, speed_m_s=fast), parameters, Concern.SPEED) == 12.0
    hot = within(20, 90, limits["max_temperature_k"] + 0.5, 303.15)
    for cell in ("cell_1_temperature_k", "cell_n_temperature_k"):
        assert longest(make_run(ROWS, **{cell: hot}), parameters, Concern.HOT_CELL) == 70.0


def test_a_cold_cell_is_no_violation(parameters: ModelParameters) -> None:
    cold = make_run(ROWS, cell_1_temperature_k=np.full(ROWS, 263.15))
    assert longest(cold, parameters, Concern.HOT_CELL) == 0.0


def test_cooling_without_effect(parameters: ModelParameters, limits: dict[str, float]) -> None:
    power = within(20, 119, limits["max_compressor_power_w"], 0.0)
    hot = np.full(ROWS, limits["max_temperature_k"] + 3.0)
    run = make_run(ROWS, compressor_power_w=power, cell_n_temperature_k=hot)
    assert longest(run, parameters, Concern.COOLING) == 99.0
    # A tenth of a kelvin in 40 s is an effect, and the time counts from each on.
    falling = hot - 0.1 / 40.0 * np.arange(ROWS) - 1e-9
    run = make_run(ROWS, compressor_power_w=power, cell_n_temperature_k=falling)
    assert longest(run, parameters, Concern.COOLING) == pytest.approx(40.0, abs=1.0)
    # Neither within limits nor at half power is the compressor a concern.
    run = make_run(ROWS, compressor_power_w=power)
    assert longest(run, parameters, Concern.COOLING) == 0.0
    run = make_run(ROWS, compressor_power_w=0.5 * power, cell_n_temperature_k=hot)
    assert longest(run, parameters, Concern.COOLING) == 0.0


def test_a_streak_starts_again_with_a_new_trip() -> None:
    streak = Streak()
    lasted = [streak.update(time_s, holds=True) for time_s in (100.0, 103.0, 0.0, 4.0)]
    assert lasted == [0.0, 3.0, 0.0, 4.0]
    assert streak.update(5.0, holds=False) == 0.0
    assert streak.update(6.0, holds=True) == 0.0


def test_a_fall_from_the_highest_temperature_is_an_effect() -> None:
    """What was gained before a fall does not hide it."""
    futile = IneffectiveCooling()
    temperatures = [315.0, 316.0, 315.95, 315.89, 315.88]
    lasted = [
        futile.update(float(second), temperature_k, at_limit=True)
        for second, temperature_k in enumerate(temperatures)
    ]
    assert lasted == [0.0, 1.0, 2.0, 0.0, 1.0]
