"""Range sensor and radio are compared: the nearer, slower one counts; one that repeats itself does not."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_controller.lead_check import FROZEN, LeadCheck
from iptm_core.braking import RadioSettings, RoadFrictionSettings, SensorAccuracySettings
from iptm_core.parameters import load_parameters
from iptm_core.state import LeaderPreview, LeaderState, VehicleState

LIMITS = load_parameters().values.limits
NONE = LeaderPreview.empty()


def check(accuracy: SensorAccuracySettings | None = None, friction: float = 0.0) -> LeadCheck:
    road = RoadFrictionSettings(road_friction=friction)
    return LeadCheck(accuracy or SensorAccuracySettings(), road, LIMITS)


def ego(time_s: float, position_m: float, speed_m_s: float) -> VehicleState:
    return VehicleState(time_s, position_m, speed_m_s, 0.0, 0.0, 300.0, 300.0, 1e-3, 1e-3)


def preview(time_s: float, position_m: float, speed_m_s: float) -> LeaderPreview:
    elapsed = np.arange(5.0)
    return LeaderPreview(time_s + elapsed, position_m + speed_m_s * elapsed, np.full(5, speed_m_s))


def test_sources_that_agree_leave_the_range_sensor_as_it_is() -> None:
    measured = LeaderState(10.0, 250.0, 18.0)
    for radio in (NONE, preview(10.0, 252.0, 19.0), preview(9.0, 231.0, 24.0)):
        assert check().checked(ego(10.0, 200.0, 20.0), measured, radio, is_free=False) == (
            measured,
            "",
        )


@pytest.mark.parametrize(
    ("radio", "expected"),
    [
        (preview(10.0, 250.0, 9.0), LeaderState(10.0, 250.0, 9.0)),
        (preview(10.0, 235.0, 18.0), LeaderState(10.0, 235.0, 18.0)),
        (preview(10.0, 235.0, 25.0), LeaderState(10.0, 235.0, 18.0)),
        (preview(9.0, 221.0, 9.0), LeaderState(10.0, 230.0, 9.0)),
    ],
)
def test_of_sources_that_contradict_each_other_the_nearer_and_slower_one_counts(
    radio: LeaderPreview, expected: LeaderState
) -> None:
    measured = LeaderState(10.0, 250.0, 18.0)
    counts, reason = check().checked(ego(10.0, 200.0, 20.0), measured, radio, is_free=False)
    assert counts == expected
    assert "the nearer and slower one counts" in reason


@pytest.mark.parametrize(
    "radio",
    [
        preview(10.0, 280.0, 30.0),
        preview(8.4, 250.0, 2.0),
        preview(10.1, 250.0, 2.0),
        preview(10.0, 190.0, 2.0),
        preview(10.0, float("nan"), 2.0),
        LeaderPreview(np.array([10.0]), np.empty(0), np.empty(0)),
    ],
    ids=["farther", "old", "from the future", "behind the ego vehicle", "not a number", "ragged"],
)
def test_a_radio_that_is_farther_old_or_impossible_changes_nothing(radio: LeaderPreview) -> None:
    measured = LeaderState(10.0, 250.0, 18.0)
    counts, reason = check().checked(ego(10.0, 200.0, 20.0), measured, radio, is_free=False)
    assert (counts, reason) == (measured, "")


def test_a_radio_that_repeats_itself_is_not_compared() -> None:
    compared = check()
    for tick in range(6):
        time_s = float(tick)
        state = ego(time_s, 19.0 * time_s, 19.0)
        measured = LeaderState(time_s, 60.337 + 19.0 * time_s, 19.0)
        radio = preview(time_s, 120.113, 7.031)
        counts, _ = compared.checked(state, measured, radio, is_free=False)
    assert counts == measured


def test_messages_that_are_not_authenticated_cost_a_limited_speed() -> None:
    """A phantom 25 m nearer, at 8 m/s less, is followed until the vehicle has lost 5 m/s for it."""
    for is_authenticated in (True, False):
        settings = RadioSettings(authenticated_radio=is_authenticated)
        compared = LeadCheck(
            SensorAccuracySettings(), RoadFrictionSettings(), LIMITS, radio=settings
        )
        counted = []
        for tick, speed_m_s in enumerate((20.0, 20.0, 19.0, 17.5, 16.4, 14.9, 14.9)):
            time_s, at_m = float(tick), 20.0 * tick
            measured = LeaderState(time_s, 60.0 + at_m, 20.0)
            radio = preview(time_s, 35.0 + at_m - 8.0 * tick, 12.0)
            counts, reason = compared.checked(
                ego(time_s, 0.0, speed_m_s), measured, radio, is_free=False
            )
            counted.append(counts == measured)
            assert "by radio" in reason
        assert counted == ([False] * 7 if is_authenticated else [False] * 5 + [True] * 2)


def test_a_speed_that_does_not_move_for_long_opens_the_distance_without_radio() -> None:
    for radio_at, opens in (
        (lambda _: NONE, True),
        (lambda t: preview(t, 60 + 20 * t, 20.0), False),
    ):
        compared = check()
        nearer_m = []
        for tick in range(40):
            time_s = float(tick)
            speed_m_s = 20.01 if tick % 2 else 20.0
            measured = LeaderState(time_s, 60.0 + 20.0 * time_s, speed_m_s)
            counts, _ = compared.checked(
                ego(time_s, 20.0 * time_s, 20.0), measured, radio_at(time_s), is_free=False
            )
            nearer_m.append(measured.position_m - counts.position_m)
        assert nearer_m[:10] == [0.0] * 10
        assert nearer_m[-1] == (10.0 if opens else 0.0)
        assert max(np.diff(nearer_m)) <= 0.5
        moved = LeaderState(40.0, 860.0, 20.5)
        assert compared.checked(ego(40.0, 800.0, 20.0), moved, NONE, is_free=False)[0] == moved


def test_a_steep_descent_asks_for_what_the_monitor_allows_for() -> None:
    values = load_parameters().values
    steep = LeadCheck(
        SensorAccuracySettings(), RoadFrictionSettings(), LIMITS, values.gap, brakes=values.brakes
    )
    leader = LeaderState(0.0, 60.0, 24.0)
    assert steep.cautious(leader, 26.0, 0.0) == leader
    assert steep.cautious(leader, 26.0, 0.1) == leader
    nearer_m = [60.0 - steep.cautious(leader, 26.0, slope).position_m for slope in (-0.1, -0.15)]
    assert 0.0 < nearer_m[0] < nearer_m[1]


def test_a_range_sensor_that_repeats_itself_is_lost_and_the_vehicle_brakes_from_there_on() -> None:
    watched = check()
    speed, position, faults = 20.0, 0.0, []
    for tick in range(6):
        frozen_gap_m = 42.137 if tick >= 2 else 42.137 - 0.7 * (2 - tick)
        measured = LeaderState(float(tick), position + frozen_gap_m, 20.711)
        counts, fault = watched.checked(ego(tick, position, speed), measured, NONE, is_free=False)
        faults.append(fault)
        if tick == 2:
            held = measured
        position, speed = position + speed - 0.2, speed - 0.4
    assert faults == ["", "", "", "", FROZEN, FROZEN], "the third of the same measurement"
    assert counts is None
    lost = watched.lost_leader(5.0)
    # A measurement per second: the next one was missing from 3 s on; 2 s at 9 m/s^2 since.
    assert lost is not None
    assert lost.speed_m_s == pytest.approx(20.711 - 18.0)
    assert lost.position_m == pytest.approx(held.position_m + 20.711 * 3.0 - 18.0)


def test_a_lost_vehicle_is_there_and_one_that_has_left_is_not() -> None:
    watched = check()
    for tick in range(3):
        measured = LeaderState(tick, 40.3 + 19.1 * tick, 19.1)
        watched.checked(ego(tick, 20.0 * tick, 20.0), measured, NONE, is_free=False)
    assert watched.checked(ego(3.0, 60.0, 20.0), None, NONE, is_free=False) == (None, "")
    assert watched.lost_leader(4.0) is not None
    assert watched.checked(ego(4.0, 80.0, 20.0), None, NONE, is_free=True) == (None, "")
    assert watched.lost_leader(4.0) is None


def test_stated_accuracy_and_a_slippery_road_take_the_vehicle_nearer() -> None:
    leader = LeaderState(1.0, 60.0, 20.0)
    assert check().cautious(leader, 20.0) is leader
    assert check().braking_share == 1.0
    stated = check(SensorAccuracySettings(gap_accuracy_m=5.0, lead_speed_accuracy_m_s=1.0))
    # s_min grows by v dv / (2 sqrt(2 * 2)) = 20 / 4 m.
    assert stated.cautious(leader, 20.0).position_m == pytest.approx(60.0 - 5.0 - 5.0)
    wet = check(friction=0.35)
    # 200 (1 / 3.0043 - 1 / 3.4335) - 200 (1 / 7 - 1 / 9) = 8.321 - 6.349 m.
    assert wet.cautious(leader, 20.0).position_m == pytest.approx(60.0 - 1.972, abs=2e-3)
    # 0.1 * 9.81 * 7 / 8 = 0.858 of 2 m/s^2.
    assert check(friction=0.1).braking_share == pytest.approx(0.4292, abs=1e-4)
