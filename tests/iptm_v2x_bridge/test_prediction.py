"""Predicted motion of a leader, and its bounds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iptm_core.errors import RouteError
from iptm_core.road_ahead import SpeedLimits
from iptm_core.routes import build_route
from iptm_core.state import FloatArray
from iptm_v2x_bridge.prediction.expected_motion import History, LearntProfile
from iptm_v2x_bridge.prediction.predictor import (
    LeaderPredictor,
    LeaderTrack,
    Observation,
    PredictorName,
    ReceivedPath,
    monotone_spline,
)
from iptm_v2x_bridge.prediction.regression import Regression, RegressionModel
from iptm_v2x_bridge.prediction.road_rules import BoundedByRules, RoadRules
from iptm_v2x_bridge.settings import path_times_s

AHEAD = np.arange(0.0, 61.0)


def seen(
    speed_m_s: float, acceleration_m_s2: float | None = 0.0, time_s: float = 0.0
) -> Observation:
    return Observation(time_s, 100.0, speed_m_s, acceleration_m_s2)


def steady_path(speed_m_s: float = 20.0) -> tuple[FloatArray, FloatArray]:
    times = 1.5 * np.arange(0.0, 41.0)
    return (times, 100.0 + speed_m_s * times)


PREDICTORS: dict[str, LeaderPredictor] = {
    "received": ReceivedPath(),
    "history": History(),
    "limits": BoundedByRules(History(), RoadRules(SpeedLimits(np.array([0.0]), np.array([30.0])))),
    "learnt": LearntProfile([(20.0 * AHEAD + 100.0, np.full(61, 20.0))]),
}


@pytest.mark.parametrize("name", PREDICTORS)
@settings(deadline=None, max_examples=25)
@given(st.floats(0.0, 60.0), st.floats(-12.0, 12.0))
def test_no_leader_drives_backwards(name: str, speed_m_s: float, acceleration_m_s2: float) -> None:
    track = LeaderTrack((seen(speed_m_s, acceleration_m_s2),), steady_path())
    predicted = PREDICTORS[name].predict(track, AHEAD)
    assert predicted is not None
    assert (np.diff(predicted.positions_m) >= -1e-9).all()
    assert (predicted.speeds_m_s >= 0.0).all()
    assert (np.diff(predicted.bounds_m) >= 0.0).all()
    assert np.isfinite(predicted.positions_m).all()
    assert predicted.positions_m[0] == pytest.approx(100.0, abs=1e-6)


@pytest.mark.parametrize("name", PREDICTORS)
def test_a_steady_leader_predicted_exactly(name: str) -> None:
    predicted = PREDICTORS[name].predict(LeaderTrack((seen(20.0),), steady_path()), AHEAD)
    assert predicted is not None
    np.testing.assert_allclose(predicted.positions_m, 100.0 + 20.0 * predicted.times_s, atol=0.3)


def test_an_acceleration_dies_away() -> None:
    """Numbers by hand: 20 m/s and -2 m/s2 decaying with 4 s end at 12 m/s."""
    predicted = History().predict(LeaderTrack((seen(20.0, -2.0),)), AHEAD)
    assert predicted.speeds_m_s[4] == pytest.approx(20.0 - 8.0 * (1.0 - np.exp(-1.0)))
    assert predicted.speeds_m_s[-1] == pytest.approx(12.0, abs=1e-3)
    assert predicted.positions_m[-1] - 100.0 == pytest.approx(12.0 * 60.0 + 8.0 * 4.0, abs=0.1)


def test_a_braking_leader_halts_and_stays() -> None:
    predicted = History().predict(LeaderTrack((seen(5.0, -3.0),)), AHEAD)
    assert predicted.speeds_m_s[5] == 0.0
    # The integral of 5 - 12 (1 - exp(-t/4)) up to where it reaches zero, 4 ln(12/7) s.
    assert predicted.positions_m[-1] - 100.0 == pytest.approx(20.0 - 28.0 * np.log(12.0 / 7.0))


def test_untold_acceleration_is_read_off_the_last_second() -> None:
    observations = [seen(20.0 - 0.1 * k, None, 0.1 * k - 1.0) for k in range(11)]
    predicted = History().predict(LeaderTrack(observations), AHEAD)
    assert predicted.speeds_m_s[1] == pytest.approx(19.0 - 4.0 * (1.0 - np.exp(-0.25)))


@pytest.mark.parametrize("predictor", [History(), Regression(RegressionModel.load())])
def test_an_old_observation_allows_for_braking_since_then(
    predictor: History | Regression,
) -> None:
    """Braking of 3 m/s2 for the unheard second, beyond what 99 % of the leaders do."""
    times = np.arange(0.0, 4.0)
    fresh = predictor.predict(LeaderTrack((seen(15.0, 1.0),)), times)
    late = predictor.predict(LeaderTrack((seen(15.0, 1.0),), age_s=1.0), times)
    assert late.positions_m == pytest.approx(fresh.positions_m)
    assert late.bounds_m[:2] == pytest.approx(fresh.bounds_m[:2])
    assert (late.bounds_m >= fresh.bounds_m).all()
    expected_m_s = late.speeds_m_s
    braked_m_s = 15.0 - 3.0 + (expected_m_s[2] - expected_m_s[1])
    assert late.cautious().speeds_m_s[2] < braked_m_s + 0.05 < fresh.cautious().speeds_m_s[2]


def test_a_received_path_is_what_the_leader_does() -> None:
    """Stops and starts of a cycle, through forty points."""
    motion = build_route("udds", initial_gap_m=15.0).leader
    for start_s in (0.0, 100.0, 200.0, 340.0):
        nodes = start_s + 1.5 * np.arange(0.0, 41.0)
        last = Observation(start_s, *(float(v[0]) for v in _at(motion, np.array([start_s]))), 0.0)
        track = LeaderTrack((last,), (nodes, motion.positions_at(nodes)))
        predicted = ReceivedPath().predict(track, start_s + AHEAD)
        assert predicted is not None
        positions, speeds = _at(motion, start_s + AHEAD)
        assert np.abs(predicted.positions_m - positions).max() < 0.5
        assert np.sqrt(np.mean((predicted.speeds_m_s - speeds) ** 2)) < 0.25


@pytest.mark.parametrize("cycle", ["us06", "wltc_class3b", "nycc"])
@pytest.mark.parametrize("phase_s", [0.0, 0.5])
def test_bounds_of_a_received_path_hold_between_its_points(cycle: str, phase_s: float) -> None:
    """Every tenth of a second, with the points and the resolution that are sent by default."""
    motion = build_route(cycle, initial_gap_m=15.0).leader
    ahead = np.concatenate([[0.0], path_times_s(40, 60.0)])
    near = np.arange(0.0, 20.0, 0.1)
    kept: list[FloatArray] = []
    slow: list[FloatArray] = []
    for start_s in np.arange(1.0 + phase_s, motion.times_s[-1], 3.0):
        places = np.round(motion.positions_at(start_s + ahead), 2)
        last = Observation(start_s, *(float(v[0]) for v in _at(motion, np.array([start_s]))), 0.0)
        track = LeaderTrack((last,), (start_s + ahead, places))
        predicted = ReceivedPath().predict(track, start_s + near)
        assert predicted is not None
        positions, speeds = _at(motion, start_s + near)
        kept.append(predicted.positions_m - predicted.bounds_m <= positions)
        slow.append((predicted.lowest_speeds_m_s <= speeds + 0.005)[::10])
        assert (predicted.bounds_m < 0.7).all()
    assert np.mean(kept) > 0.999
    assert np.mean(slow) > 0.99


def _at(motion: object, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    return motion.positions_at(times), motion.speeds_at(times)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "places",
    [
        [110.0, 105.0, 120.0],
        [110.0, 300.0, 310.0],
    ],
)
def test_a_path_that_no_car_drives_is_not_followed(places: list[float]) -> None:
    path = (np.arange(4.0), np.array([100.0, *places]))
    assert ReceivedPath().predict(LeaderTrack((seen(10.0),), path), AHEAD) is None


@pytest.mark.parametrize(("behind_m", "followed"), [(0.0, True), (0.8, True), (1.2, False)])
def test_an_older_path_counts_while_the_leader_keeps_to_it(behind_m: float, followed: bool) -> None:
    last = Observation(4.0, 180.0 - behind_m, 20.0, 0.0)
    predicted = ReceivedPath().predict(LeaderTrack((last,), steady_path()), 4.0 + AHEAD)
    assert (predicted is not None) == followed


def test_a_short_path_ends_where_it_ends() -> None:
    path = (np.array([0.0, 2.0, 4.0]), np.array([100.0, 120.0, 140.0]))
    predicted = ReceivedPath().predict(LeaderTrack((seen(10.0),), path), AHEAD)
    assert predicted is not None
    assert predicted.times_s.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


@given(st.lists(st.floats(0.0, 50.0), min_size=2, max_size=40), st.floats(0.0, 60.0))
def test_the_cubic_never_decreases_and_meets_its_points(steps: list[float], slope: float) -> None:
    values = np.cumsum(np.round(steps, 3))
    nodes = np.arange(float(values.size))
    fine = np.linspace(0.0, nodes[-1], 301)
    found, slopes = monotone_spline(nodes, values, slope, fine)
    assert (np.diff(found) >= -1e-9).all()
    assert (slopes >= 0.0).all()
    at_nodes, _ = monotone_spline(nodes, values, slope, nodes)
    np.testing.assert_allclose(at_nodes, values, atol=1e-9)


def test_limits_ahead_slow_the_leader_down_in_time() -> None:
    limits = SpeedLimits(np.array([0.0, 500.0]), np.array([30.0, 10.0]))
    predictor = BoundedByRules(History(), RoadRules(limits))
    predicted = predictor.predict(LeaderTrack((seen(20.0),)), AHEAD)
    assert predicted is not None
    assert predictor.name is PredictorName.SPEED_LIMITS
    assert predicted.speeds_m_s[5] == pytest.approx(20.0)
    behind_sign = predicted.positions_m > 505.0
    assert behind_sign.any()
    assert predicted.speeds_m_s[behind_sign].max() < 10.5
    assert np.diff(predicted.speeds_m_s).min() > -2.1


def test_who_drives_too_fast_here_does_so_there() -> None:
    limits = SpeedLimits(np.array([0.0, 500.0]), np.array([20.0, 10.0]))
    predicted = BoundedByRules(History(), RoadRules(limits)).predict(
        LeaderTrack((seen(22.0),)), AHEAD
    )
    assert predicted is not None
    assert predicted.speeds_m_s[-1] == pytest.approx(11.0, abs=0.2)


def test_a_learnt_stop_is_expected_and_waited_for() -> None:
    """Three drives stop for 20 s at 500 m; the fourth is predicted to do so."""
    seconds = np.arange(0.0, 121.0)
    speeds = np.interp(seconds, [0, 40, 50, 70, 80, 120], [10, 10, 0, 0, 10, 10])
    positions = 100.0 + np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]))])
    predictor = LearntProfile([(positions, speeds)] * 3)
    predicted = predictor.predict(LeaderTrack((seen(10.0),)), np.arange(0.0, 101.0))
    assert predicted is not None
    assert predicted.speeds_m_s[55:65].max() < 2.0
    assert predicted.positions_m[-1] == pytest.approx(float(positions[100]), abs=60.0)
    assert predictor.predict(LeaderTrack((Observation(0.0, 9000.0, 10.0, 0.0),)), AHEAD) is None


def test_nothing_is_learnt_from_no_drive() -> None:
    with pytest.raises(RouteError, match="0 drives"):
        LearntProfile([])


@pytest.mark.parametrize("cycle", ["wltc_class3b", "nycc"])
def test_bounds_hold_on_cycles_that_they_were_not_read_off(cycle: str) -> None:
    motion = build_route(cycle, initial_gap_m=15.0).leader
    leads = np.array([0.5, 1.0, 2.0, 5.0, 20.0, 60.0])
    kept = []
    for start_s in np.arange(1.0, motion.times_s[-1], 1.7):
        before, now = motion.speeds_at(np.array([start_s - 0.2, start_s])).tolist()
        last = Observation(
            start_s, float(motion.positions_at(start_s)), now, round((now - before) / 0.2, 1)
        )
        predicted = History().predict(LeaderTrack((last,)), start_s + leads)
        kept.append(
            predicted.positions_m - predicted.bounds_m <= motion.positions_at(start_s + leads)
        )
    share = np.mean(kept, axis=0)
    assert (share > 0.97).all(), share
