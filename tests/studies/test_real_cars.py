"""Measured trips as cycles, and savings by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies.real_cars.run import as_driven, totals
from studies.savings import road_taken, saved
from tests.iptm_core.made_runs import PARAMETERS, make_run

from iptm_core.metrics.run_metrics import RunMetrics, compute_metrics

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
