"""A vehicle as the leader: its states, its plans as predictions, and what is assumed when it falls silent."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_core.settings import PreviewSettings
from iptm_core.state import NS_PER_S
from iptm_v2x_bridge.bridge import V2xBridge
from iptm_v2x_bridge.range_sensor import VehicleAhead

LENGTH_M = 4.5
PLAN_TIMES_S = np.array([10.0, 11.0, 12.0, 13.0, 18.0, 23.0])
# From 10 m/s with 1 m/s^2, front bumper at 100 m at 10 s.
PLAN_SPEEDS = 10.0 + (PLAN_TIMES_S - 10.0)
PLAN_FRONTS_M = 100.0 + 10.0 * (PLAN_TIMES_S - 10.0) + 0.5 * (PLAN_TIMES_S - 10.0) ** 2


@pytest.fixture
def vehicle() -> VehicleAhead:
    predicted = VehicleAhead(LENGTH_M)
    predicted.note_state(10 * NS_PER_S, 100.0, 10.0)
    predicted.note_plan(10 * NS_PER_S, PLAN_TIMES_S, PLAN_FRONTS_M, PLAN_SPEEDS)
    return predicted


def test_the_gap_is_measured_to_the_rear_bumper(vehicle: VehicleAhead) -> None:
    leader = vehicle.leader_at(10 * NS_PER_S)
    assert (leader.time_s, leader.position_m, leader.speed_m_s) == (10.0, 95.5, 10.0)


def test_a_plan_is_the_prediction_of_its_tick_up_to_its_own_end_or_that_of_the_preview(
    vehicle: VehicleAhead,
) -> None:
    answer = V2xBridge(vehicle, PreviewSettings()).answer(10 * NS_PER_S)
    np.testing.assert_array_equal(answer.preview.times_s, PLAN_TIMES_S)
    np.testing.assert_array_equal(answer.preview.positions_m, PLAN_FRONTS_M - LENGTH_M)
    np.testing.assert_array_equal(answer.preview.speeds_m_s, PLAN_SPEEDS)
    assert answer.preview.generated_at_s == 10.0

    short = V2xBridge(vehicle, PreviewSettings(preview_length_s=8.0)).answer(10 * NS_PER_S)
    assert short.preview.times_s.tolist() == [10.0, 11.0, 12.0, 13.0, 18.0]


def test_a_late_plan_is_that_of_an_earlier_tick_and_keeps_its_age(vehicle: VehicleAhead) -> None:
    bridge = V2xBridge(vehicle, PreviewSettings(latency_s=1.0))
    assert bridge.answer(10 * NS_PER_S).preview.times_s.size == 0
    vehicle.note_state(11 * NS_PER_S, 110.5, 11.0)
    vehicle.note_plan(11 * NS_PER_S, *np.empty((3, 0)))
    answer = bridge.answer(11 * NS_PER_S)
    assert answer.preview.generated_at_s == 10.0
    assert answer.preview_age_s == 1.0


def test_a_tick_without_a_plan_leaves_the_last_one_in_force(vehicle: VehicleAhead) -> None:
    bridge = V2xBridge(vehicle, PreviewSettings())
    bridge.answer(10 * NS_PER_S)
    vehicle.note_state(11 * NS_PER_S, 110.5, 11.0)
    vehicle.note_plan(11 * NS_PER_S, *np.empty((3, 0)))
    assert bridge.answer(11 * NS_PER_S).preview.generated_at_s == 10.0


def test_a_plan_at_standstill_never_rolls_backwards() -> None:
    vehicle = VehicleAhead(LENGTH_M)
    vehicle.note_state(0, 100.0, 0.0)
    times = np.array([0.0, 1.0, 2.0])
    vehicle.note_plan(0, times, 100.0 - 1e-9 * times, -1e-9 * times)
    preview = vehicle.predict(times)
    assert np.all(np.diff(preview.positions_m) >= 0.0)
    assert np.all(preview.speeds_m_s >= 0.0)


def test_a_vehicle_that_is_gone_brakes_to_a_halt(vehicle: VehicleAhead) -> None:
    """With 3 m/s^2 from 10 m/s: 8.5 m in the first second, 50/3 m until it stands."""
    leader = vehicle.leader_at(11 * NS_PER_S)
    assert leader.position_m == pytest.approx(95.5 + 8.5)
    assert leader.speed_m_s == pytest.approx(7.0)
    preview = vehicle.predict(np.array([11.0, 12.0, 60.0]))
    assert preview.generated_at_s == 11.0
    assert preview.positions_m[0] == pytest.approx(leader.position_m)
    assert preview.positions_m[-1] == pytest.approx(95.5 + 50.0 / 3.0)
    assert preview.speeds_m_s[-1] == 0.0


def test_only_the_newest_are_kept_where_that_is_asked_for() -> None:
    vehicle = VehicleAhead(LENGTH_M, kept=2)
    assert not vehicle.was_heard
    for tick in range(4):
        vehicle.note_state(tick * NS_PER_S, 10.0 * tick, 10.0)
        vehicle.note_plan(tick * NS_PER_S, *np.empty((3, 0)))
    assert [vehicle.has_state(tick * NS_PER_S) for tick in range(4)] == [False, False, True, True]
    assert [vehicle.has_plan(tick * NS_PER_S) for tick in range(4)] == [False, False, True, True]
