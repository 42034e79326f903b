"""Figures of the cars behind in simulated traffic, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from studies.fleet.run import against, rows_of

from iptm_traffic.fleet import FleetCar, FleetResult

STRETCH_M = 200.0


def car(name: str, speed_m_s: float, *, equipped: bool = False) -> FleetCar:
    times = np.arange(31.0)
    speeds = np.full(31, speed_m_s)
    return FleetCar(name, equipped, times, speeds, speed_m_s * times, 5.0 if equipped else math.inf)


def test_time_on_the_stretch_and_who_is_behind_by_hand() -> None:
    cars = [car("first", 10.0), car("own", 10.0, equipped=True), car("next", 8.0), car("last", 5.0)]
    rows = list(rows_of(cars, STRETCH_M))
    assert [row["is_behind"] for row in rows] == [False, False, True, True]
    assert [row["time_s"] for row in rows[:3]] == pytest.approx([20.0, 20.0, 25.0])
    assert math.isnan(rows[3]["time_s"])  # 150 m
    assert rows[0]["energy_j"] == rows[1]["energy_j"] > 0.0


def test_traffic_is_compared_car_by_car_and_flow_by_the_way_of_all() -> None:
    """200 + 200 + 150 m against 200 + 240, of which 200 count, + 120 m."""
    own = [car("own", 10.0, equipped=True), car("next", 10.0), car("late", 5.0)]
    base = [car("own", 8.0, equipped=True), car("next", 8.0), car("late", 4.0)]
    found = against(
        [FleetResult(tuple(own), (), 0.0)], [FleetResult(tuple(base), ("met",), 0.0)], STRETCH_M
    )
    assert found["equipped"] == found["behind"] == 1
    assert found["all"] == 2
    assert found["behind_time_s"] == pytest.approx(-5.0)
    assert found["flow"] == pytest.approx(100.0 * 550.0 / 520.0)
    assert (found["collisions"], found["base_collisions"]) == (0, 1)
    assert found["smallest_gap_m"] == 5.0
