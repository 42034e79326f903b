"""What the leader is expected to do, and how well it is known."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.iptm_controller.scenes import (
    MAX_AGE_S,
    expect_constant_speed,
    make_forecaster,
    make_leader,
    make_preview,
)
from tests.reference.leader_forecast import extrapolated_motion

from iptm_controller.forecast import LeaderForecaster, PreviewQuality
from iptm_core.state import FloatArray, LeaderPreview, LeaderState


@pytest.fixture
def leader() -> LeaderState:
    return make_leader(gap_m=40.0, speed_m_s=15.0, time_s=100.0)


def moved(preview: LeaderPreview, seconds: float) -> LeaderPreview:
    """The same prediction, made earlier or later."""
    return replace(preview, times_s=preview.times_s + seconds)


def test_full_preview_is_followed_exactly(
    forecaster: LeaderForecaster, leader: LeaderState
) -> None:
    preview = make_preview(leader, acceleration_m_s2=-1.0)
    forecast = forecaster.forecast(leader, preview)
    assert forecast.quality is PreviewQuality.FULL
    assert forecast.reason == ""
    assert forecast.age_s == 0.0
    positions, speeds = forecast.motion.at(preview.times_s)
    np.testing.assert_allclose(positions, preview.positions_m, atol=1e-9)
    np.testing.assert_allclose(speeds, preview.speeds_m_s, atol=1e-12)
    assert forecast.known_s == 60.0
    assert forecast.limiting is forecast.motion


@pytest.mark.parametrize(("field", "error"), [("speeds_m_s", -0.03), ("positions_m", -0.01)])
def test_noise_of_an_estimator_at_standstill_is_no_motion_backwards(
    forecaster: LeaderForecaster, field: str, error: float
) -> None:
    standing = make_leader(gap_m=40.0, speed_m_s=0.0, time_s=100.0)
    preview = make_preview(standing)
    noisy = getattr(preview, field).copy()
    noisy[7] += error
    forecast = forecaster.forecast(standing, replace(preview, **{field: noisy}))
    assert forecast.quality is PreviewQuality.FULL
    positions, speeds = forecast.motion.at(preview.times_s)
    assert positions.tolist() == preview.positions_m.tolist()
    assert speeds.tolist() == preview.speeds_m_s.tolist()


def test_short_preview_goes_on_at_its_last_speed(
    forecaster: LeaderForecaster, leader: LeaderState
) -> None:
    preview = make_preview(leader, acceleration_m_s2=-1.0, length_s=5.0)
    forecast = forecaster.forecast(leader, preview)
    assert forecast.quality is PreviewQuality.SHORT
    assert forecast.reason == "preview covers 5.0 s of a 28 s horizon"
    positions, speeds = forecast.motion.at(np.array([105.0, 110.0]))
    assert speeds.tolist() == [10.0, 10.0]
    assert positions[1] - positions[0] == pytest.approx(50.0)


def test_bounds_limit_how_far_a_preview_is_known(
    forecaster: LeaderForecaster, leader: LeaderState
) -> None:
    known = make_preview(leader, acceleration_m_s2=0.8)
    # 0.1 m/s^2 t^2: 0.9 m after 3 s, 1.6 m after 4 s.
    bounded = replace(known, bounds_m=0.1 * (known.times_s - leader.time_s) ** 2)
    forecast = forecaster.forecast(leader, bounded)
    assert forecast.quality is PreviewQuality.SHORT
    assert forecast.reason == "preview is known for 3.0 s of a 28 s horizon"
    assert forecast.known_s == 3.0
    # The expected motion is followed to its end.
    positions, speeds = forecast.motion.at(known.times_s)
    np.testing.assert_allclose(positions, known.positions_m, atol=1e-9)
    np.testing.assert_allclose(speeds, known.speeds_m_s, atol=1e-12)
    # The gap is kept to what the bounds leave of it, as far as it is known.
    nearer_m, slower_m_s = forecast.limiting.at(known.times_s)
    behind_m, rates_m_s = positions - nearer_m, speeds - slower_m_s
    np.testing.assert_allclose(behind_m[:5], [0.0, 0.1, 0.4, 0.9, 0.0], atol=1e-9)
    np.testing.assert_allclose(rates_m_s[:5], [0.0, 0.2, 0.4, 0.6, 0.0], atol=1e-9)
    assert not behind_m[4:].any()


@pytest.mark.parametrize(
    ("acceleration_m_s2", "bound_m", "limit_m"),
    [
        # Measured at constant speed. 0.325 m after 1 s are not allowed for without a preview either.
        (-1.0, 0.3, -0.5),
        (0.2, 0.3, 0.0),
        (2.0, 0.3, 0.7),
        (-1.0, 0.5, -0.675),
        (0.2, 0.5, -0.175),
        (2.0, 0.5, 0.5),
    ],
)
def test_bounds_of_a_leader_measured_now_ask_for_no_more_distance_than_without_a_preview(
    forecaster: LeaderForecaster,
    leader: LeaderState,
    acceleration_m_s2: float,
    bound_m: float,
    limit_m: float,
) -> None:
    preview = make_preview(leader, acceleration_m_s2=acceleration_m_s2)
    wide = replace(preview, bounds_m=bound_m * (preview.times_s - leader.time_s))
    limiting = forecaster.forecast(leader, wide).limiting
    assert limiting.at(np.array([101.0]))[0] - 1055.0 == pytest.approx(limit_m)


def test_a_preview_that_is_not_known_at_all_is_an_expectation(
    forecaster: LeaderForecaster, leader: LeaderState
) -> None:
    preview = make_preview(leader, acceleration_m_s2=4.0, length_s=5.0)
    forecast = forecaster.forecast(leader, replace(preview, bounds_m=np.full(6, 2.0)))
    assert (forecast.quality, forecast.known_s) == (PreviewQuality.SHORT, 0.0)
    growing = replace(preview, bounds_m=2.0 * (preview.times_s - leader.time_s))
    forecast = forecaster.forecast(leader, growing)
    behind_m = forecast.motion.at(preview.times_s)[0] - forecast.limiting.at(preview.times_s)[0]
    assert behind_m[:3].tolist() == pytest.approx([0.0, 2.0, 0.0])


@pytest.mark.parametrize(
    ("bounds_m", "reason"),
    [
        (np.zeros(60), "60 bounds; allowed: 0 or 61"),
        (np.full(61, -0.1), "bound is -0.1 to -0.1 m"),
        (np.full(61, math.nan), "bound is nan"),
        (np.full(61, math.inf), "bound is inf"),
    ],
)
def test_broken_bounds_make_a_preview_invalid(
    forecaster: LeaderForecaster, leader: LeaderState, bounds_m: FloatArray, reason: str
) -> None:
    forecast = forecaster.forecast(leader, replace(make_preview(leader), bounds_m=bounds_m))
    assert forecast.quality is PreviewQuality.INVALID
    assert reason in forecast.reason


def test_what_is_expected_and_not_asserted_costs_no_trust(
    forecaster: LeaderForecaster, leader: LeaderState
) -> None:
    """A leader that brakes from 15 m/s behind previews that expect a constant speed."""
    for second in range(8):
        speed_m_s = 15.0 - 1.5 * second
        now = replace(leader, time_s=100.0 + second, speed_m_s=speed_m_s)
        preview = make_preview(now)
        bounds = np.where(preview.times_s > now.time_s, 2.0, 0.0)
        forecast = forecaster.forecast(now, replace(preview, bounds_m=bounds))
        assert math.isinf(forecaster.memory[2].horizon_s)
        assert forecast.quality is PreviewQuality.SHORT


@pytest.mark.parametrize(
    ("age_s", "quality"),
    [(0.0, 0), (3.0, 0), (MAX_AGE_S, 0), (MAX_AGE_S + 0.1, 2), (59.0, 2), (200.0, 2)],
)
def test_old_previews_are_used_up_to_the_permitted_age(
    forecaster: LeaderForecaster, leader: LeaderState, age_s: float, quality: int
) -> None:
    forecast = forecaster.forecast(leader, moved(make_preview(leader), -age_s))
    assert forecast.quality == quality
    assert forecast.age_s == pytest.approx(age_s)
    if quality == PreviewQuality.STALE:
        assert forecast.reason == f"preview is {age_s:.1f} s old; allowed: up to 10 s"
        expect_constant_speed(forecast.motion, leader)


def test_a_preview_that_has_ended_is_stale_however_young(
    forecaster: LeaderForecaster, leader: LeaderState
) -> None:
    preview = moved(make_preview(leader, length_s=2.0), -3.0)
    forecast = forecaster.forecast(leader, preview)
    assert forecast.quality is PreviewQuality.STALE
    assert forecast.reason == "preview ended 1.0 s ago"
    expect_constant_speed(forecast.motion, leader)


@given(offset_m=st.floats(-500.0, 500.0), age_s=st.floats(0.0, 2.4))
def test_prediction_starts_where_the_leader_is_seen(offset_m: float, age_s: float) -> None:
    """Neither delay nor an error of position moves the leader that the range sensor measures."""
    leader = make_leader()
    preview = make_preview(leader, acceleration_m_s2=-0.6)
    preview = replace(moved(preview, -age_s), positions_m=preview.positions_m + offset_m)
    forecast = make_forecaster().forecast(leader, preview)
    assert forecast.quality is PreviewQuality.FULL
    now = np.array([leader.time_s])
    assert forecast.motion.at(now)[0][0] == leader.position_m
    # From there on it moves as predicted.
    ahead = preview.times_s[preview.times_s > leader.time_s]
    positions, speeds = forecast.motion.at(ahead)
    later = preview.times_s > leader.time_s
    np.testing.assert_allclose(np.diff(positions), np.diff(preview.positions_m[later]), atol=1e-8)
    np.testing.assert_allclose(speeds, preview.speeds_m_s[later])


@pytest.mark.parametrize("error_m_s", [-2.0, 2.0])
def test_preview_off_the_measured_speed_is_not_trusted(
    forecaster: LeaderForecaster, leader: LeaderState, error_m_s: float
) -> None:
    preview = make_preview(leader)
    preview = replace(preview, speeds_m_s=preview.speeds_m_s + error_m_s)
    forecast = forecaster.forecast(leader, preview)
    assert forecast.quality is PreviewQuality.DOUBTED
    assert forecast.known_s == 0.0


def test_small_negative_speeds_of_a_preview_are_a_vehicle_at_rest(
    forecaster: LeaderForecaster,
) -> None:
    standing = make_leader(gap_m=40.0, speed_m_s=0.0)
    preview = spoil(make_preview(standing), "speeds_m_s", 3, -1e-9)
    forecast = forecaster.forecast(standing, spoil(preview, "positions_m", 5, 1039.9))
    assert forecast.quality is PreviewQuality.FULL
    ahead_s = standing.time_s + np.arange(20.0)
    positions, speeds = forecast.motion.at(ahead_s)
    assert speeds.min() >= 0.0
    assert (np.diff(positions) >= 0.0).all()


def test_untrusted_preview_is_nowhere_ahead_of_the_measured_motion(
    forecaster: LeaderForecaster,
) -> None:
    """A lead vehicle that brakes with 2 m/s^2 while every preview claims that it keeps its speed."""
    for tick in range(6):
        time_s, speed = 100.0 + tick, 20.0 - 2.0 * tick
        position = 1040.0 + 20.0 * tick - float(tick * tick)
        leader = LeaderState(time_s, position, speed)
        forecast = forecaster.forecast(leader, make_preview(leader))
    assert forecast.known_s == 0.0
    ahead_s = leader.time_s + np.array([1.0, 2.0, 3.0])
    positions, _ = forecast.motion.at(ahead_s)
    measured = extrapolated_motion(leader, -2.0).at(ahead_s)[0]
    np.testing.assert_allclose(positions, measured, atol=0.05)


def spoil(preview: LeaderPreview, name: str, index: int, value: float) -> LeaderPreview:
    values = getattr(preview, name).copy()
    values[index] = value
    return replace(preview, **{name: values})


def leap(preview: LeaderPreview, index: int, distance_m: float) -> LeaderPreview:
    positions = preview.positions_m.copy()
    positions[index:] += distance_m
    return replace(preview, positions_m=positions)


MALFORMED: dict[str, tuple[Callable[[LeaderPreview], LeaderPreview], str]] = {
    "nan_time": (lambda p: spoil(p, "times_s", 3, math.nan), "time is nan at node 3"),
    "inf_position": (lambda p: spoil(p, "positions_m", 5, math.inf), "position is inf at node 5"),
    "nan_speed": (lambda p: spoil(p, "speeds_m_s", 0, math.nan), "speed is nan at node 0"),
    "same_time": (lambda p: spoil(p, "times_s", 4, 103.0), "do not increase after node 3"),
    "time_back": (lambda p: spoil(p, "times_s", 4, 90.0), "do not increase after node 3"),
    "backwards": (lambda p: spoil(p, "positions_m", 7, 0.0), "backwards after node 6"),
    "leap": (lambda p: leap(p, 9, 1e5), "positions leap after node 8; allowed: 100 m/s"),
    "negative_speed": (lambda p: spoil(p, "speeds_m_s", 2, -0.6), "allowed: -0.5 to 100 m/s"),
    "too_fast": (lambda p: spoil(p, "speeds_m_s", 2, 101.0), "allowed: -0.5 to 100 m/s"),
    "short_speeds": (lambda p: replace(p, speeds_m_s=p.speeds_m_s[:-1]), "equal numbers"),
    "no_positions": (lambda p: replace(p, positions_m=np.empty(0)), "equal numbers"),
    "future": (lambda p: moved(p, 5.0), "generated 5.000 s in the future"),
}


@pytest.mark.parametrize("kind", sorted(MALFORMED))
def test_malformed_previews_are_named_and_not_used(
    forecaster: LeaderForecaster, leader: LeaderState, kind: str
) -> None:
    change, complaint = MALFORMED[kind]
    forecast = forecaster.forecast(leader, change(make_preview(leader)))
    assert forecast.quality is PreviewQuality.INVALID
    assert complaint in forecast.reason
    expect_constant_speed(forecast.motion, leader)


def test_recovers_at_once(forecaster: LeaderForecaster) -> None:
    for tick, change in enumerate(change for change, _ in MALFORMED.values()):
        leader = make_leader(time_s=100.0 + 2 * tick)
        forecaster.forecast(leader, change(make_preview(leader)))
        leader = make_leader(time_s=101.0 + 2 * tick)
        forecast = forecaster.forecast(leader, make_preview(leader))
        assert forecast.quality is PreviewQuality.FULL
