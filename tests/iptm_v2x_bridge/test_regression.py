"""The regression on a leader's last seconds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import RouteError
from iptm_core.routes import build_route
from iptm_core.routes.cycles import LeaderMotion, load_cycle
from iptm_v2x_bridge.prediction.expected_motion import History
from iptm_v2x_bridge.prediction.predictor import LeaderTrack, Observation
from iptm_v2x_bridge.prediction.regression import (
    FEATURES,
    NEAR_S,
    PAST_S,
    SPEED_NODES_M_S,
    Regression,
    RegressionModel,
    regression_features,
)

SHIPPED = RegressionModel.load()
BY_HAND = RegressionModel(
    trained_on="by hand",
    drives=(),
    leads_s=(1.0, 3.0),
    # Twice the last change of speed after 1 s, nothing after 3 s: the last features are the changes.
    coefficients=((0.0,) * (FEATURES - PAST_S) + (2.0,) + (0.0,) * (PAST_S - 1), (0.0,) * FEATURES),
    bound_speeds_m_s=(0.0, 20.0),
    bound_accelerations_m_s2=(0.0,),
    bounds_m=((1.0, 3.0), (4.0, 12.0)),
)


def heard(speeds_m_s: list[float], every_s: float = 1.0) -> LeaderTrack:
    """A leader whose last message is at 100 s, at 1000 m."""
    count = len(speeds_m_s)
    return LeaderTrack(
        tuple(
            Observation(100.0 - every_s * (count - 1 - k), 1000.0, speed, None)
            for k, speed in enumerate(speeds_m_s)
        )
    )


def test_motion_and_bounds_by_hand() -> None:
    predicted = Regression(BY_HAND).predict(
        heard([9.0, 10.0]), np.array([100.0, 101.0, 102.0, 103.0, 105.0])
    )
    assert predicted.speeds_m_s.tolist() == [10.0, 12.0, 11.0, 10.0, 10.0]
    # 11 m in the first second, 22 m in the next two, half of which is at 11.5 m/s in the mean.
    assert predicted.positions_m.tolist() == [1000.0, 1011.0, 1022.5, 1033.0, 1053.0]
    # At 10 m/s half-way between the nodes: 2 m and 8 m, linear between and on with 3 m/s.
    assert predicted.bounds_m.tolist() == [0.0, 2.0, 5.0, 8.0, 14.0]


def test_late_gains_of_speed_count_more_and_the_bounded_motion_stays() -> None:
    gains = replace(BY_HAND, coefficients=(BY_HAND.coefficients[0],) * 2)
    times_s = np.array([100.0, 101.0, 103.0])
    predicted = Regression(gains).predict(heard([9.0, 10.0]), times_s)
    # 2 m/s more after 1 s, and 1.5 times as much after 3 s.
    assert predicted.speeds_m_s.tolist() == [10.0, 12.0, 13.0]
    assert predicted.positions_m.tolist() == [1000.0, 1011.0, 1036.0]
    assert predicted.bounds_m.tolist() == [0.0, 2.0, 9.0]
    as_driven = Regression(gains, gain_factor=1.0).predict(heard([9.0, 10.0]), times_s)
    assert as_driven.positions_m[-1] - as_driven.bounds_m[-1] == 1036.0 - 9.0
    assert as_driven.speeds_m_s.tolist() == [10.0, 12.0, 12.0]
    # Expected losses are as they are in the drives.
    losses = Regression(gains).predict(heard([11.0, 10.0]), times_s)
    assert losses.speeds_m_s.tolist() == [10.0, 8.0, 8.0]


def test_features_by_hand() -> None:
    past = np.array([[7.5, 7.0, *np.full(PAST_S - 1, 7.0)]])
    (features,) = regression_features(past)
    level, braking, speeding = np.split(features[: 3 * len(SPEED_NODES_M_S)], 3)
    assert level.tolist() == [0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert not braking.any()
    assert speeding.tolist() == (0.5 * level).tolist()
    assert features[3 * len(SPEED_NODES_M_S) :].tolist() == [0.5, *np.zeros(PAST_S - 1)]


def test_a_leader_never_falls_behind_where_it_stands() -> None:
    predicted = Regression(SHIPPED).predict(heard([0.0] * 20), 100.0 + np.arange(61.0))
    assert (predicted.positions_m - predicted.bounds_m >= 1000.0 - 1e-9).all()


def test_near_bounds_cover_drivers_who_brake_harder_than_those_of_the_training() -> None:
    """Seconds of US06, not trained on: the bounds of the training drives covered 89 % of them."""
    motion = build_route("us06", initial_gap_m=15.0).leader
    kept = []
    for now_s in np.arange(12.0, 590.0):
        speeds = motion.speeds_at(now_s - 12.0 + np.arange(13.0))
        predicted = Regression(SHIPPED).predict(heard(speeds.tolist()), np.array([100.0, 101.0]))
        driven_m = float(np.diff(motion.positions_at(np.array([now_s, now_s + 1.0])))[0])
        kept.append(predicted.positions_m[1] - predicted.bounds_m[1] <= 1000.0 + driven_m)
    assert np.mean(kept) > 0.95


@given(st.lists(st.floats(0.0, 45.0), min_size=1, max_size=30))
def test_at_first_a_leader_may_be_where_its_decaying_acceleration_takes_it(
    speeds_m_s: list[float],
) -> None:
    """Whatever is expected instead, the gap is kept to that motion as without a regression."""
    track, times = heard(speeds_m_s), 100.0 + np.arange(0.0, NEAR_S + 0.5, 0.5)
    predicted, decaying = Regression(SHIPPED).predict(track, times), History().predict(track, times)
    lowest_m = np.maximum(decaying.positions_m - decaying.bounds_m, 1000.0)
    assert (predicted.positions_m - predicted.bounds_m <= lowest_m + 1e-9).all()


def test_the_rate_of_the_messages_does_not_matter() -> None:
    times = np.arange(0.0, 12.05, 0.1)
    speeds = 12.0 + 0.3 * times
    fast = Regression(SHIPPED).predict(heard(speeds.tolist(), 0.1), 100.0 + np.arange(31.0))
    slow = Regression(SHIPPED).predict(heard(speeds[::10].tolist()), 100.0 + np.arange(31.0))
    np.testing.assert_allclose(fast.positions_m, slow.positions_m, atol=1e-6)


@given(st.lists(st.floats(0.0, 45.0), min_size=1, max_size=30))
def test_whatever_was_driven_the_motion_is_one(speeds_m_s: list[float]) -> None:
    predicted = Regression(SHIPPED).predict(heard(speeds_m_s), 100.0 + np.arange(0.0, 91.0, 0.5))
    assert predicted.positions_m[0] == 1000.0
    assert predicted.speeds_m_s.min() >= 0.0
    assert (np.diff(predicted.positions_m) >= -1e-9).all()
    assert predicted.bounds_m[0] == 0.0
    assert (np.diff(predicted.bounds_m) >= -1e-9).all()
    assert np.isfinite(predicted.bounds_m).all()


def test_bounds_hold_on_a_cycle_that_was_not_trained_on() -> None:
    cycle = load_cycle("wltc_class3b")
    motion = LeaderMotion(cycle.times_s, cycle.speeds_m_s, 0.0)
    leads = np.array([1.0, 2.0, 5.0, 10.0, 20.0])
    late = []
    for now_s in np.arange(20.0, motion.times_s[-1] - 30.0):
        seconds = now_s - np.arange(12.0)[::-1]
        speeds, positions = motion.speeds_at(seconds), motion.positions_at(seconds)
        track = LeaderTrack(
            tuple(
                Observation(float(t), float(p), float(v), None)
                for t, p, v in zip(seconds, positions, speeds, strict=True)
            )
        )
        predicted = Regression(SHIPPED).predict(track, now_s + leads)
        late.append(predicted.positions_m - predicted.bounds_m > motion.positions_at(now_s + leads))
    assert np.mean(late, axis=0).max() < 0.015


def test_a_model_survives_its_file(tmp_path: Path) -> None:
    path = tmp_path / "own.json"
    path.write_text(SHIPPED.as_json(), encoding="utf-8")
    assert RegressionModel.load(str(path)) == SHIPPED
    assert "CC BY 4.0" in SHIPPED.trained_on


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"leads_s": 1}', SHIPPED.as_json().replace("0.0", '"a"', 1)]
)
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "own.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RouteError, match="regression"):
        RegressionModel.load(str(path))


@pytest.mark.parametrize(
    "change",
    [
        {"leads_s": (3.0, 1.0)},
        {"leads_s": (0.0, 1.0)},
        {"leads_s": (1.0,)},
        {"coefficients": ((0.0,) * FEATURES,)},
        {"bounds_m": ((0.5, 1.5), (2.0, float("nan")))},
        {"bound_speeds_m_s": ()},
    ],
)
def test_models_that_do_not_fit_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(RouteError, match="regression has"):
        replace(BY_HAND, **change)  # type: ignore[arg-type]


def test_a_missing_file_is_refused() -> None:
    with pytest.raises(RouteError, match="none"):
        RegressionModel.load("none.json")
