"""A leader that is expected to return to its usual speed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.iptm_controller.scenes import NONE_YET, make_leader

from iptm_controller.forecast import LeaderForecaster
from iptm_controller.lead_check import measured_acceleration_m_s2
from iptm_controller.usual_speed import (
    BRAKING_DECAY_S,
    MEMORY_S,
    UsualSpeed,
    returning_motion,
)
from iptm_core.routes.cycles import CYCLE_NAMES, LeaderMotion, load_cycle
from iptm_core.state import LeaderState

RETURN_S = 12.0


def usual_of(speeds_m_s: list[float], step_s: float = 1.0) -> UsualSpeed:
    usual = UsualSpeed()
    for number, speed_m_s in enumerate(speeds_m_s):
        usual = usual.with_measured(LeaderState(number * step_s, 0.0, speed_m_s))
    return usual


def test_usual_speed_is_the_mean_until_it_forgets() -> None:
    assert usual_of([4.0, 8.0]).speed_m_s == pytest.approx(6.0)
    assert usual_of([7.0]).speed_m_s == 7.0
    long_ago = usual_of([10.0] * 3001 + [20.0] * round(MEMORY_S))
    assert long_ago.speed_m_s == pytest.approx(20.0 - 10.0 * math.exp(-1.0), rel=1e-3)
    assert usual_of([5.0, 5.0]).with_measured(LeaderState(-1.0, 0.0, 9.0)).speed_m_s == 9.0


def test_fast_leader_returns_and_a_slow_one_keeps_its_speed() -> None:
    leader = make_leader(speed_m_s=20.0)
    ahead_s = leader.time_s + np.array([0.0, RETURN_S])
    positions_m, speeds_m_s = returning_motion(leader, 0.0, 10.0, RETURN_S).at(ahead_s)
    assert speeds_m_s == pytest.approx([20.0, 10.0 + 10.0 / math.e], rel=1e-3)
    driven_m = RETURN_S * (10.0 + 10.0 * (1.0 - 1.0 / math.e))
    assert positions_m - leader.position_m == pytest.approx([0.0, driven_m], rel=1e-3)
    assert returning_motion(leader, 0.0, 30.0, RETURN_S).speeds_m_s == pytest.approx(20.0)


def test_leader_that_brakes_stands_and_never_drives_backwards() -> None:
    leader = make_leader(speed_m_s=5.0)
    motion = returning_motion(leader, -3.0, 0.0, RETURN_S)
    stop_s = -BRAKING_DECAY_S * math.log1p(-5.0 / (3.0 * BRAKING_DECAY_S))
    assert motion.at(leader.time_s + np.array([stop_s + 0.6]))[1] == pytest.approx(0.0)
    assert motion.speeds_m_s.min() >= 0.0
    assert np.all(np.diff(motion.positions_m) >= 0.0)


def test_leaders_of_the_published_cycles_are_seldom_behind_what_is_expected() -> None:
    """It is a cautious forecast: of vehicles in motion about three in four get farther."""
    ahead_s = np.array([3.0, 5.0, 10.0])
    farther = []
    for name in CYCLE_NAMES:
        cycle = LeaderMotion.from_cycle(load_cycle(name), 40.0)
        usual = UsualSpeed()
        for time_s in np.arange(1.0, cycle.times_s[-1] - ahead_s[-1]):
            before, now = cycle.state_at(time_s - 1.0), cycle.state_at(time_s)
            usual = usual.with_measured(now)
            acceleration_m_s2 = measured_acceleration_m_s2([before, now])
            expected = returning_motion(now, acceleration_m_s2, usual.speed_m_s, RETURN_S)
            if now.speed_m_s > 1.0:
                then_s = time_s + ahead_s
                farther.append(cycle.positions_at(then_s) > expected.at(then_s)[0])
    shares = np.mean(farther, axis=0)
    assert shares == pytest.approx(0.75, abs=0.07)


def test_only_a_desired_headway_expects_the_return() -> None:
    forecasts = []
    for return_s in (0.0, RETURN_S):
        forecaster = LeaderForecaster(28.0, 10.0, return_s=return_s)
        for time_s, speed_m_s in ((0.0, 10.0), (1.0, 10.0), (2.0, 10.0), (3.0, 20.0)):
            forecast = forecaster.forecast(
                make_leader(time_s=time_s, speed_m_s=speed_m_s), NONE_YET
            )
        forecasts.append(forecast.motion.speeds_m_s[-1])
    assert forecasts[1] < forecasts[0]
