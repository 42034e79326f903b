"""The leader's measured acceleration, and the motion that follows from it without a preview."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.iptm_controller.scenes import NONE_YET, expect_constant_speed, make_leader
from tests.reference.leader_forecast import extrapolated_motion, measured_acceleration_m_s2

from iptm_controller.forecast import HISTORY_S, LeaderForecaster
from iptm_controller.lead_check import ACCELERATION_DECAY_S
from iptm_core.routes.cycles import CYCLE_NAMES, LeaderMotion, load_cycle
from iptm_core.state import FloatArray, LeaderState


def test_without_a_preview_the_acceleration_decays(forecaster: LeaderForecaster) -> None:
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
        (leaders((0.9, 0.0, 5.0), (1.5, 6.0, 10.0), (2.0, 11.0, 10.0)), 0.0),
        # A tick was lost.
        (leaders((0.0, 0.0, 9.0), (1.0, 10.0, 11.0), (3.0, 30.0, 9.0)), -1.0),
        # Another vehicle: slower by more than brakes can do, or not where its speeds have brought it.
        (leaders((0.0, 0.0, 20.0), (1.0, 14.5, 9.0)), 0.0),
        (leaders((0.0, 30.0, 12.0), (1.0, 20.0, 10.0)), 0.0),
        # Speeds of 9 to 11 m/s explain 9 to 11 m, and a metre is the error of the range.
        (leaders((0.0, 0.0, 9.0), (1.0, 11.9, 11.0)), 2.0),
        (leaders((0.0, 0.0, 9.0), (1.0, 12.1, 11.0)), 0.0),
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


def squared_errors_m2(leader: LeaderMotion, decay_s: float) -> tuple[FloatArray, FloatArray]:
    """Of positions 3, 5 and 8 s ahead, from every second on: extrapolated, and at a constant speed."""
    ahead_s = np.array([3.0, 5.0, 8.0])
    extrapolated, constant = [], []
    for time_s in np.arange(1.0, leader.times_s[-1] - ahead_s[-1]):
        measured = [leader.state_at(time_s - 1.0), leader.state_at(time_s)]
        motion = extrapolated_motion(measured[1], measured_acceleration_m_s2(measured), decay_s)
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
