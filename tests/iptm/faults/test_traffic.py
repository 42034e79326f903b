"""Events on the road: a leader that moves as a car can, and predictions without what has not begun."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from iptm.faults.events import DRIVE_OFF_M_S2
from iptm.faults.fault import Fault
from iptm.faults.kinds import FaultKind
from iptm.faults.signals import Traffic
from iptm_core.state import LeaderPreview, LeaderState

SPEED = 20.0
GAP = 40.0


def own(time_s: float) -> LeaderState:
    return LeaderState(time_s, GAP + SPEED * time_s, SPEED)


def prediction(made_s: float) -> LeaderPreview:
    times = made_s + np.arange(61.0)
    return LeaderPreview(times, GAP + SPEED * times, np.full(61, SPEED))


def drive(traffic: Traffic, seconds: int) -> tuple[list[LeaderState], list[LeaderPreview]]:
    """An ego vehicle that keeps its place 40 m behind the leader of the route."""
    leaders, previews = [], []
    for second in range(seconds):
        leaders.append(traffic.leader(own(second), SPEED * second))
        previews.append(traffic.preview(prediction(second)))
    return leaders, previews


def test_no_event_changes_nothing() -> None:
    leaders, previews = drive(Traffic([Fault(FaultKind.PREVIEW_LOST)]), 5)
    assert leaders == [own(second) for second in range(5)]
    assert np.array_equal(previews[3].positions_m, prediction(3.0).positions_m)


def test_a_hard_stop_is_a_motion_of_a_car() -> None:
    fault = Fault(FaultKind.LEADER_HARD_STOP, start_s=10.0, duration_s=8.0, size=8.0)
    leaders, _ = drive(Traffic([fault]), 60)
    speeds = np.array([leader.speed_m_s for leader in leaders])
    positions = np.array([leader.position_m for leader in leaders])
    assert speeds[10] == SPEED
    assert speeds[11] == SPEED - 8.0
    assert (speeds[13:19] == 0.0).all()
    assert positions[18] - positions[10] == pytest.approx(SPEED**2 / 16.0)
    rise = np.diff(speeds[18:30])
    assert rise.max() == pytest.approx(DRIVE_OFF_M_S2)
    assert (speeds[29:] == SPEED).all()
    # Speed and position are consistent, except in the second of the standstill.
    moved, mean = np.diff(positions), 0.5 * (speeds[1:] + speeds[:-1])
    same = np.abs(moved - mean) < 1e-9
    assert list(np.flatnonzero(~same)) == [12]


def test_a_prediction_contains_the_stop_from_its_beginning_on_and_not_before() -> None:
    fault = Fault(FaultKind.LEADER_HARD_STOP, start_s=10.0, duration_s=8.0, size=8.0)
    leaders, previews = drive(Traffic([fault]), 60)
    assert np.array_equal(previews[9].positions_m, prediction(9.0).positions_m)
    for made in (10, 12, 20, 40):
        predicted = previews[made].positions_m[: 60 - made]
        assert predicted == pytest.approx([leader.position_m for leader in leaders[made:]])
        assert np.all(np.diff(predicted) >= 0.0)


def test_a_late_prediction_is_that_of_its_generation() -> None:
    fault = Fault(FaultKind.LEADER_HARD_STOP, start_s=10.0, duration_s=8.0, size=8.0)
    traffic = Traffic([fault])
    _, previews = drive(traffic, 15)
    again = traffic.preview(prediction(11.0))
    assert np.array_equal(again.positions_m, previews[11].positions_m)
    assert np.array_equal(traffic.preview(prediction(8.0)).speeds_m_s, prediction(8.0).speeds_m_s)


def test_a_cut_in_comes_between_and_goes() -> None:
    fault = Fault(FaultKind.LEADER_CUT_IN, start_s=5.0, duration_s=4.0, size=12.0)
    leaders, previews = drive(Traffic([fault]), 15)
    gaps = [leader.position_m - SPEED * leader.time_s for leader in leaders]
    assert gaps == pytest.approx([GAP] * 5 + [12.0] * 4 + [GAP] * 6)
    assert previews[6].positions_m[0] == pytest.approx(leaders[6].position_m)
    assert previews[9].positions_m[0] == pytest.approx(leaders[9].position_m)


def test_a_cut_in_farther_away_than_the_leader_is_none() -> None:
    leaders, _ = drive(Traffic([Fault(FaultKind.LEADER_CUT_IN, 5.0, 4.0, size=100.0)]), 15)
    assert leaders == [own(second) for second in range(15)]


def test_a_leader_that_is_gone_leaves_the_next_one_to_follow() -> None:
    leaders, previews = drive(Traffic([Fault(FaultKind.LEADER_GONE, 5.0, 4.0, size=300.0)]), 15)
    moved = [leader.position_m - own(leader.time_s).position_m for leader in leaders]
    assert moved == [0.0] * 5 + [300.0] * 10
    assert previews[12].positions_m[0] == pytest.approx(leaders[12].position_m)


def test_an_event_of_no_probability_never_happens() -> None:
    fault = Fault(FaultKind.LEADER_HARD_STOP, 5.0, 5.0, probability=0.0)
    assert Traffic([fault]).is_quiet


def test_what_lies_behind_is_forgotten() -> None:
    """An injector runs for as long as the trip: nothing may grow with its ticks."""
    stops = [Fault(FaultKind.LEADER_HARD_STOP, 10.0 + 50.0 * number, 5.0) for number in range(3)]
    traffic = Traffic(stops)

    def allocated() -> int:
        return sum(block.size for block in tracemalloc.take_snapshot().traces)

    tracemalloc.start()
    try:
        sizes = []
        for second in range(4000):
            traffic.leader(own(second), SPEED * second)
            traffic.preview(prediction(second))
            if second in {1000, 3999}:
                sizes.append(allocated())
    finally:
        tracemalloc.stop()
    assert sizes[1] < sizes[0] + 20_000


def test_a_surprise_brakes_as_a_hard_stop_and_no_preview_announces_it() -> None:
    stop, surprise = (
        drive(Traffic([Fault(kind, start_s=10.0, duration_s=8.0, size=4.0)]), 40)
        for kind in (FaultKind.LEADER_HARD_STOP, FaultKind.LEADER_SURPRISE)
    )
    assert surprise[0] == stop[0]
    for leader, preview in zip(*surprise, strict=True):
        assert preview.positions_m[0] == leader.position_m
        assert preview.speeds_m_s[0] == leader.speed_m_s
        assert (np.diff(preview.speeds_m_s) >= 0.0).all()
        assert preview.speeds_m_s[-1] == SPEED
    assert min(stop[1][11].speeds_m_s) == 0.0
