"""Measured trips as cycles, and savings by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from studies.measured_cycles import FASTEST_M_S, trip_cycles, write_drive
from studies.real_cars.run import as_driven, totals
from studies.savings import road_taken, saved
from tests.iptm_core.made_runs import PARAMETERS, make_run

from iptm_core.errors import MeasurementError
from iptm_core.metrics import RunMetrics, compute_metrics
from iptm_core.routes import build_route

I3 = "bmw_i3"


def made(power_w: float, loss: float = 1e-6, end_k: float = 303.15) -> RunMetrics:
    """Return a run of 100 m with a traction power from the battery and a loss of the first cell."""
    run = make_run(
        3,
        position_m=np.array([0.0, 50.0, 100.0]),
        traction_power_w=np.full(3, power_w),
        battery_power_w=np.full(3, power_w),
        auxiliary_power_w=np.full(3, 200.0),
        cell_1_capacity_loss=1e-3 + np.array([0.0, 0.5 * loss, loss]),
        cell_n_capacity_loss=np.full(3, 1e-3),
        cell_1_temperature_k=np.array([303.15, 303.15, end_k]),
        cell_n_temperature_k=np.array([303.15, 303.15, end_k]),
    )
    return compute_metrics(run, PARAMETERS)


@pytest.fixture(scope="module")
def trips(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return trip_cycles(tmp_path_factory.mktemp("trips"))


def test_measured_trips_are_cycles_with_their_elevation(trips: list[str]) -> None:
    assert len(set(trips)) == 10
    for trip in trips:
        route = build_route(trip, initial_gap_m=15.0)
        assert 300.0 <= route.duration_s <= 350.0
        assert route.leader.speeds_m_s.max() <= FASTEST_M_S
        assert route.leader.speeds_m_s[[0, -1]] == pytest.approx(0.0, abs=0.2)
        assert 0.001 < np.abs(route.slope.slopes_rad).max() < 0.05


def test_drives_end_at_rest(tmp_path: Path) -> None:
    """From 3 m/s with 1 m/s^2 in 3 s, then 5 s of standing, on the last slope."""
    path = write_drive(tmp_path / "a.csv", 1.0, np.array([0.0, 3.0]), np.array([0.0, 0.02]))
    assert path.read_text(encoding="utf-8").splitlines() == [
        "time_s,speed_m_s,slope_rad",
        "0.000,0.0000,0.000000",
        "1.000,3.0000,0.020000",
        "4.000,0.0000,0.020000",
        "9.000,0.0000,0.020000",
    ]


def test_too_few_trips_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match="allowed: at least 99"):
        trip_cycles(tmp_path, count=99)


def test_savings_by_hand() -> None:
    """Two trips: 2 x 9 kW against 2 x 10 kW and 12 kW for 2 s, losses 3e-6 against 4e-6."""
    own = [made(9e3, 1e-6), made(9e3, 2e-6)]
    others = [made(10e3, 1e-6), made(12e3, 3e-6)]
    found = as_driven(own, others)
    at_one_end = saved(own, others, PARAMETERS)
    assert found["aging"] == pytest.approx(25.0)
    assert at_one_end["ageing"] == pytest.approx(25.0)
    assert found["traction"] == pytest.approx(100.0 * (1.0 - 18.0 / 22.0))
    assert found["consumption"] == pytest.approx(found["traction"])
    assert at_one_end["energy"] == pytest.approx(found["consumption"])
    assert found["cooling"] == pytest.approx(0.0)
    assert totals(own)["consumption"] == pytest.approx(36e3 / 3.6e6 / 0.002)


def test_a_warmer_end_costs_and_a_cold_one_is_not_corrected() -> None:
    reference = [made(10e3, 2e-6)]
    warmer = [made(10e3, end_k=304.15)]
    assert saved(warmer, reference, PARAMETERS)["ageing"] < 50.0
    assert as_driven(warmer, reference)["aging"] == pytest.approx(50.0)
    cold = saved([made(10e3, end_k=290.0)], reference, PARAMETERS)
    assert math.isnan(cold["ageing"])
    assert math.isnan(cold["energy"])


def test_the_road_that_a_vehicle_takes_by_hand() -> None:
    """20 m at 10 m/s for three of four rows, 8 m at 4 m/s in the last: headways of 2 s."""
    run = make_run(4, speed_m_s=np.array([10.0, 10.0, 10.0, 4.0]), position_m=np.zeros(4))
    run = replace(run, leader_position_m=np.array([20.0, 20.0, 20.0, 8.0]))
    assert road_taken([run]) == {
        "gap_m": pytest.approx(17.0),
        "mean_headway_s": pytest.approx(2.0),
        "headway_s": pytest.approx(2.0),
        "vehicles_h": pytest.approx(3600.0 * 8.5 / 21.5),
    }
    assert road_taken([run], begin=3)["gap_m"] == pytest.approx(8.0)
