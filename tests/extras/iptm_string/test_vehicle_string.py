"""A string of vehicles without ROS: order of the vehicles, and propagation of disturbances."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

from iptm.closed_loop import ClosedLoopRun
from iptm.driving import drive_in_memory
from iptm.trip import Trip
from iptm_controller.controller import MpcController
from iptm_controller.options import ControllerOptions
from iptm_core.decision_record import Rung
from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_plant_sim.plant import Plant
from iptm_string.headless import (
    RATIOS,
    amplification,
    deviations_along,
    drive_string_in_memory,
    run_string,
)

MODEL = load_parameters().values
GAP_M = MODEL.gap.initial_gap_m
LENGTH_M = 5.0
DURATION_S = 60.0
ROUTE = build_route("us06", "large", initial_gap_m=GAP_M, duration_s=DURATION_S)


def driven(vehicles: int) -> list[ClosedLoopRun]:
    plant = Plant(MODEL, ROUTE.slope.slope_at)
    options = ControllerOptions(trip_duration_s=DURATION_S)
    return list(
        run_string(ROUTE, vehicles, plant, lambda: MpcController(MODEL, options), length_m=LENGTH_M)
    )


@pytest.fixture(scope="module")
def string() -> list[ClosedLoopRun]:
    return driven(3)


def test_each_vehicle_follows_the_rear_bumper_of_the_one_before(
    string: list[ClosedLoopRun],
) -> None:
    for place, run in enumerate(string):
        assert run.trajectory.position_m[0] == -place * (GAP_M + LENGTH_M)
        assert run.trajectory.gap_m[0] == pytest.approx(GAP_M)
    for ahead, behind in pairwise(string):
        rear_m = ahead.trajectory.position_m - LENGTH_M
        np.testing.assert_array_equal(behind.trajectory.leader_position_m, rear_m)
        speeds = ahead.trajectory.speed_m_s
        np.testing.assert_array_equal(behind.trajectory.leader_speed_m_s, speeds)


def test_no_gap_falls_below_its_limit_and_nobody_falls_back(string: list[ClosedLoopRun]) -> None:
    for run in string:
        assert gap_margins_m(run.trajectory, MODEL).min() > -1e-3
        assert set(run.decisions.rung) == {Rung.OPTIMAL}
    # A plan at hand: from the first tick on the age of the preview is zero.
    assert set(string[-1].decisions.preview_age_s) == {0.0}


def test_vehicles_of_a_string_may_have_drivers_of_their_own() -> None:
    trip = Trip.of("us06", duration_s=20.0)
    drivers = [trip.changed(strategy="production"), trip]
    found = list(drive_string_in_memory(trip, 2, drivers))
    assert [run.settings["strategy"] for run in found] == ["production", trip.controller.strategy]
    alone = drive_in_memory(drivers[0])
    np.testing.assert_array_equal(found[0].trajectory.speed_m_s, alone.trajectory.speed_m_s)


def test_who_drives_behind_changes_nothing(string: list[ClosedLoopRun]) -> None:
    shorter = driven(2)
    for one, other in zip(shorter, string, strict=False):
        np.testing.assert_array_equal(one.trajectory.position_m, other.trajectory.position_m)
        np.testing.assert_array_equal(
            one.trajectory.compressor_power_w, other.trajectory.compressor_power_w
        )


def test_deviations_are_those_of_the_curves(string: list[ClosedLoopRun]) -> None:
    trajectories = [run.trajectory for run in string]
    found = deviations_along(trajectories, MODEL)
    cycle, last = found.iloc[0], found.iloc[-1]
    assert math.isnan(cycle.gap_m)
    # us06 is sampled once a second.
    accelerations = np.diff(trajectories[0].leader_speed_m_s)
    assert cycle.peak_acceleration_m_s2 == pytest.approx(np.abs(accelerations).max())
    run = trajectories[-1]
    assert last.speed_m_s == pytest.approx(np.std(run.speed_m_s))
    assert last.largest_gap_m == run.gap_m.max()
    assert last.smallest_margin_m == gap_margins_m(run, MODEL).min()


def test_amplification_is_the_ratio_to_the_member_ahead() -> None:
    """There is none to a member that stands still, or has no gap."""
    rows = [(2.0, 0.5, 1.5, math.nan), (1.0, 0.5, 3.0, 8.0), (0.0, 0.0, 1.5, 2.0), (1.0,) * 4]
    ratios = amplification(pd.DataFrame(rows, columns=RATIOS))
    expected = [(math.nan,) * 4, (0.5, 1.0, 2.0, math.nan), (0.0, 0.0, 0.5, 0.25)]
    expected.append((math.nan, math.nan, 1 / 1.5, 0.5))
    np.testing.assert_allclose(ratios, expected)
