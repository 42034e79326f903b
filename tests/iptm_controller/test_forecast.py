"""What the leader is expected to do, and how well it is known."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.iptm_controller.scenes import make_leader, make_preview

from iptm_controller import leader_motion
from iptm_controller.forecast import HISTORY_S, LeaderForecaster, PreviewQuality
from iptm_controller.leader_motion import (
    ACCELERATION_DECAY_S,
    PredictedLeaderMotion,
    extrapolated_motion,
    measured_acceleration_m_s2,
)
from iptm_core.routes.cycles import CYCLE_NAMES, load_cycle
from iptm_core.routes.leader import LeaderMotion
from iptm_core.state import FloatArray, LeaderPreview, LeaderState

HORIZON_S = 28.0
MAX_AGE_S = 10.0
NONE_YET = LeaderPreview(-math.inf, np.empty(0), np.empty(0), np.empty(0))


@pytest.fixture
def forecaster() -> LeaderForecaster:
    return LeaderForecaster(HORIZON_S, MAX_AGE_S)


@pytest.fixture
def leader() -> LeaderState:
    return make_leader(gap_m=40.0, speed_m_s=15.0, time_s=100.0)


def moved(preview: LeaderPreview, seconds: float) -> LeaderPreview:
    """The same prediction, made earlier or later."""
    return replace(
        preview, generated_at_s=preview.generated_at_s + seconds, times_s=preview.times_s + seconds
    )


def expect_constant_speed(motion: PredictedLeaderMotion, leader: LeaderState) -> None:
    times = leader.time_s + np.array([0.0, 1.0, 28.0])
    positions, speeds = motion.at(times)
    assert speeds.tolist() == [leader.speed_m_s] * 3
    np.testing.assert_allclose(
        positions, leader.position_m + leader.speed_m_s * (times - leader.time_s)
    )


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


def test_bounds_say_how_far_a_preview_is_known(
    forecaster: LeaderForecaster, leader: LeaderState
) -> None:
    known = make_preview(leader, acceleration_m_s2=-0.2)
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


def test_small_bounds_are_none(forecaster: LeaderForecaster, leader: LeaderState) -> None:
    preview = make_preview(leader)
    preview = replace(preview, bounds_m=np.linspace(0.0, 1.5, preview.times_s.size))
    forecast = forecaster.forecast(leader, preview)
    assert (forecast.quality, forecast.known_s) == (PreviewQuality.FULL, 60.0)


def test_a_preview_that_is_not_known_at_all_is_an_expectation(
    forecaster: LeaderForecaster, leader: LeaderState
) -> None:
    preview = make_preview(leader)
    forecast = forecaster.forecast(leader, replace(preview, bounds_m=np.full(61, 2.0)))
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
        assert forecaster.trust.is_full
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


def test_no_preview_yet(forecaster: LeaderForecaster, leader: LeaderState) -> None:
    forecast = forecaster.forecast(leader, NONE_YET)
    assert forecast.quality is PreviewQuality.MISSING
    assert forecast.reason
    assert math.isnan(forecast.age_s)
    expect_constant_speed(forecast.motion, leader)
    assert forecast.known_s == 0.0


@given(offset_m=st.floats(-500.0, 500.0), age_s=st.floats(0.0, 2.4))
def test_prediction_starts_where_the_leader_is_seen(offset_m: float, age_s: float) -> None:
    """Neither delay nor an error of position moves the leader that the range sensor measures."""
    leader = make_leader()
    preview = make_preview(leader, acceleration_m_s2=-0.6)
    preview = replace(moved(preview, -age_s), positions_m=preview.positions_m + offset_m)
    forecast = LeaderForecaster(HORIZON_S, MAX_AGE_S).forecast(leader, preview)
    assert forecast.quality is PreviewQuality.FULL
    now = np.array([leader.time_s])
    assert forecast.motion.at(now)[0][0] == leader.position_m
    # From there on it moves as predicted.
    ahead = preview.times_s[preview.times_s > leader.time_s]
    positions, speeds = forecast.motion.at(ahead)
    later = preview.times_s > leader.time_s
    np.testing.assert_allclose(np.diff(positions), np.diff(preview.positions_m[later]), atol=1e-8)
    np.testing.assert_allclose(speeds, preview.speeds_m_s[later])


def test_unforetold_the_acceleration_dies_away(forecaster: LeaderForecaster) -> None:
    """From 14 to 15 m/s within a second: v(t) = 15 + 4 (1 - exp(-t / 4)), and its integral."""
    forecaster.forecast(make_leader(25.5, 14.0, 99.0), NONE_YET)
    motion = forecaster.forecast(make_leader(40.0, 15.0, 100.0), NONE_YET).motion
    elapsed = np.array([0.0, 1.0, 4.0, 12.0])
    positions, speeds = motion.at(100.0 + elapsed)
    gone = 1.0 - np.exp(-elapsed / 4.0)
    np.testing.assert_allclose(speeds, 15.0 + 4.0 * gone, atol=1e-9)
    np.testing.assert_allclose(positions, 1040.0 + 19.0 * elapsed - 16.0 * gone, atol=1e-9)
    # The change of speed that an acceleration brings about is bounded: 4 s of it.
    assert motion.at(np.array([200.0]))[1][0] == pytest.approx(19.0, abs=0.03)


def test_a_braking_leader_stops_and_stays() -> None:
    """From 4 m/s at -2 m/s^2 it stands after 4 ln 2 s and never backs up."""
    leader = make_leader(40.0, 4.0)
    motion = extrapolated_motion(leader, -2.0)
    stop_s = 4.0 * math.log(2.0)
    positions, speeds = motion.at(leader.time_s + np.linspace(0.0, 40.0, 401))
    assert np.all(np.diff(positions) > -1e-9)
    assert speeds.min() >= 0.0
    assert speeds[math.ceil(10.0 * stop_s) :].max() < 1e-12
    # s(t) = -4 t + 32 (1 - exp(-t / 4)), at the stop 16 - 16 ln 2.
    assert positions[-1] - leader.position_m == pytest.approx(16.0 - 16.0 * math.log(2.0))
    standing = make_leader(40.0, 0.0)
    positions, speeds = extrapolated_motion(standing, -2.0).at(standing.time_s + np.arange(9.0))
    assert set(positions) == {standing.position_m}
    assert set(speeds) == {0.0}


def leaders(*rows: tuple[float, float, float]) -> list[LeaderState]:
    return [LeaderState(*row) for row in rows]


@pytest.mark.parametrize(
    ("measured", "acceleration"),
    [
        (leaders((0.0, 0.0, 9.0)), 0.0),
        (leaders((0.0, 0.0, 9.0), (1.0, 10.0, 11.0)), 2.0),
        # Only the last second counts.
        (leaders((0.0, 0.0, 9.0), (1.0, 10.0, 11.0), (2.0, 20.5, 10.0)), -1.0),
        # A tick was lost.
        (leaders((0.0, 0.0, 9.0), (1.0, 10.0, 11.0), (3.0, 30.0, 9.0)), -1.0),
        # Another vehicle: slower by more than brakes can do, or not where its speeds have brought it.
        (leaders((0.0, 0.0, 20.0), (1.0, 14.5, 9.0)), 0.0),
        (leaders((0.0, 30.0, 12.0), (1.0, 20.0, 10.0)), 0.0),
    ],
)
def test_acceleration_by_hand(measured: list[LeaderState], acceleration: float) -> None:
    assert measured_acceleration_m_s2(measured) == pytest.approx(acceleration)


def test_fast_ticks_average_the_noise_of_the_speed() -> None:
    """Ten speeds per second, each off by up to 0.2 m/s: two neighbours would give up to 4 m/s^2."""
    random = np.random.default_rng(3)
    worst = 0.0
    for _ in range(200):
        times = 0.1 * np.arange(31)
        speeds = 15.0 - times + random.uniform(-0.2, 0.2, times.size)
        rows = zip(times, 15.0 * times - 0.5 * times**2, speeds, strict=True)
        found = measured_acceleration_m_s2([LeaderState(*map(float, row)) for row in rows])
        worst = max(worst, abs(found + 1.0))
    assert worst < 0.5


def test_a_tick_that_is_measured_twice_counts_once(forecaster: LeaderForecaster) -> None:
    forecaster.forecast(make_leader(25.5, 14.0, 99.0), NONE_YET)
    once = forecaster.forecast(make_leader(40.0, 15.0, 100.0), NONE_YET).motion
    twice = forecaster.forecast(make_leader(40.0, 15.0, 100.0), NONE_YET).motion
    for name in ("times_s", "positions_m", "speeds_m_s"):
        np.testing.assert_array_equal(getattr(once, name), getattr(twice, name))


def test_history_is_measured_and_forgotten(forecaster: LeaderForecaster) -> None:
    """The mean speed over the last seconds comes from what was seen, not from the prediction."""
    for tick in range(8):
        leader = make_leader(gap_m=40.0 + tick**2, speed_m_s=2.0 * tick, time_s=100.0 + tick)
        forecast = forecaster.forecast(leader, NONE_YET)
    past = forecast.motion.times_s[forecast.motion.times_s < 107.0]
    assert past.tolist() == [104.0, 105.0, 106.0]
    assert past[0] == 107.0 - HISTORY_S
    positions, speeds = forecast.motion.at(np.array([105.0, 105.5]))
    assert positions[0] == 1040.0 + 25.0
    assert speeds.tolist() == [10.0, 11.0]


def test_going_back_in_time_starts_a_new_history(forecaster: LeaderForecaster) -> None:
    forecaster.forecast(make_leader(time_s=100.0), NONE_YET)
    forecaster.forecast(make_leader(time_s=101.0), NONE_YET)
    leader = make_leader(time_s=0.0)
    forecast = forecaster.forecast(leader, NONE_YET)
    assert forecast.motion.times_s[0] == 0.0
    expect_constant_speed(forecast.motion, leader)


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


def squared_errors_m2(leader: LeaderMotion, decay_s: float) -> tuple[FloatArray, FloatArray]:
    """Of positions 3, 5 and 8 s ahead, from every second on: extrapolated, and at a constant speed."""
    ahead_s = np.array([3.0, 5.0, 8.0])
    extrapolated, constant = [], []
    with mock.patch.object(leader_motion, "ACCELERATION_DECAY_S", decay_s):
        for time_s in np.arange(1.0, leader.times_s[-1] - ahead_s[-1]):
            measured = [leader.state_at(time_s - 1.0), leader.state_at(time_s)]
            motion = extrapolated_motion(measured[1], measured_acceleration_m_s2(measured))
            driven_m = leader.positions_at(time_s + ahead_s)
            extrapolated.append((motion.at(time_s + ahead_s)[0] - driven_m) ** 2)
            steady_m = measured[1].position_m + measured[1].speed_m_s * ahead_s
            constant.append((steady_m - driven_m) ** 2)
    return np.array(extrapolated), np.array(constant)


def test_the_decay_is_that_of_the_published_cycles() -> None:
    leaders = [LeaderMotion.from_cycle(load_cycle(name), 40.0) for name in CYCLE_NAMES]
    for leader in leaders:
        extrapolated, constant = squared_errors_m2(leader, ACCELERATION_DECAY_S)
        assert np.all(extrapolated.mean(axis=0) < constant.mean(axis=0))

    def of_all(decay_s: float) -> float:
        return sum(float(squared_errors_m2(leader, decay_s)[0].sum()) for leader in leaders)

    best = of_all(ACCELERATION_DECAY_S)
    assert best < of_all(0.5 * ACCELERATION_DECAY_S)
    assert best < of_all(2.0 * ACCELERATION_DECAY_S)


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
    "nan_generated": (lambda p: replace(p, generated_at_s=math.nan), "generated at nan s"),
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
