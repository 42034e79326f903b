"""Limits broken for long and cooling without effect, on runs whose times are known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from tests.iptm_core.made_runs import make_run

from iptm_core.metrics import Concern, compute_metrics, figure_values
from iptm_core.metrics.concerns import IneffectiveCooling, Streak
from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory

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


def test_a_fast_host_and_a_hot_cell(parameters: ModelParameters, limits: dict[str, float]) -> None:
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


def test_a_streak_begins_anew_with_a_new_trip() -> None:
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
