"""The driver models of UN R157: their metrics by hand, and what they and the monitor do in single cases."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from studies.collisions.r157 import (
    CAREFUL,
    CUT_IN,
    CUT_OUT,
    FUZZY,
    Case,
    OwnCar,
    critical,
    driver_gap_m,
    grid,
    proactive,
    summary,
)


def test_the_metrics_of_the_fuzzy_driver() -> None:
    # Safe: 20 * 0.75 + 400 / 8 - 100 / 14 + 2 = 59.857 m; unsafe: 15 + 400 / 12 - 7.143 = 41.190 m; less 2 m.
    assert proactive(61.9, 20.0, 10.0) == 0.0
    assert proactive(43.0, 20.0, 10.0) == 1.0
    assert proactive(2.0 + 0.5 * (59.857 + 41.190), 20.0, 10.0) == pytest.approx(0.5, abs=1e-4)
    # Closing at 10 m/s: 7.5 + 100 / 8 = 20 m is safe, 7.5 + 100 / 12 = 15.833 m is not.
    assert critical(20.1, 20.0, 10.0, 0.0) == 0.0
    assert critical(15.8, 20.0, 10.0, 0.0) == 1.0
    assert critical(0.5 * (20.0 + 15.8333), 20.0, 10.0, 0.0) == pytest.approx(0.5, abs=1e-4)
    assert critical(1.0, 10.0, 10.0, 0.0) == 0.0


def test_the_grids_have_their_published_sizes() -> None:
    kinds = [case.kind for case in grid(1)]
    # Without the cut-ins that do not move sideways: 17 of 18 sideways speeds.
    assert kinds.count(CUT_IN) == 14_040 * 17 // 18 + 15 * 59 * 17
    assert kinds.count(CUT_OUT) == 13 * 30 * 15


def test_a_vehicle_that_cuts_in_far_ahead_is_no_danger_and_one_at_the_bumper_is() -> None:
    car = OwnCar()
    far, near = (Case(CUT_IN, 20.0, 15.0, gap_m, 1.0) for gap_m in (50.0, 9.0))
    for gap_m in (car.gap_m(far), driver_gap_m(far, CAREFUL), driver_gap_m(far, FUZZY)):
        assert gap_m > 0.0
    assert driver_gap_m(near, CAREFUL) == 0.0
    assert car.gap_m(near, np.inf) > 0.0, "seen from the beginning, it is avoided"


def test_a_standing_vehicle_behind_one_that_leaves_the_lane() -> None:
    case = Case(CUT_OUT, 100.0 / 3.6, 0.0, 52.0, 1.1)
    assert OwnCar().gap_m(case) > 0.0
    assert driver_gap_m(case, CAREFUL) > 0.0


def test_a_driver_who_passes_before_the_other_is_in_the_way_is_counted_apart() -> None:
    """130 km/h, 31 m behind a vehicle of 40 km/h that comes over with 1 m/s: 9 m past it after 1.6 s."""
    case = Case(CUT_IN, 130.0 / 3.6, 40.0 / 3.6, 31.0, 1.0)
    gaps = {f"{model}_m": driver_gap_m(case, model) for model in (CAREFUL, FUZZY)}
    own_m = OwnCar().gap_m(case)
    assert np.isinf(gaps["careful_m"])
    assert own_m == 0.0
    (row,) = summary(
        pd.DataFrame([{**vars(case), **gaps, "own_m": own_m, "granted_m": 0.0}])
    ).itertuples()
    assert (row.missed, row.passed, row.unexplained) == (1, 1, 0)
