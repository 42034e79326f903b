"""Signals and speed limits: when a line is open, and how a leader keeps rules."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import RouteError
from iptm_core.road_ahead import SpeedLimits
from iptm_core.state import FloatArray, LeaderPreview
from iptm_v2x_bridge.prediction.expected_motion import History
from iptm_v2x_bridge.prediction.predictor import LeaderTrack, Observation, PredictorName
from iptm_v2x_bridge.prediction.road_rules import BoundedByRules, RoadRules, Signal

TIMES: FloatArray = np.arange(0.0, 61.0)
FREE = SpeedLimits(np.array([0.0]), np.array([50.0]))
# Green from 10 s to 40 s of every 80 s.
SIGNAL = Signal.cyclic(stop_line_m=500.0, cycle_s=80.0, opens_at_s=10.0, open_for_s=30.0)


def predict(
    position_m: float,
    speed_m_s: float,
    *signals: Signal,
    limits: SpeedLimits = FREE,
    time_s: float = 0.0,
) -> LeaderPreview:
    track = LeaderTrack((Observation(time_s, position_m, speed_m_s, 0.0),), length_m=5.0)
    predictor = BoundedByRules(History(), RoadRules(limits, signals))
    predicted = predictor.predict(track, time_s + TIMES)
    assert predicted is not None
    assert predictor.name is PredictorName.SIGNALS
    return predicted


@pytest.mark.parametrize(
    ("time_s", "is_open", "open_until_s", "closed_until_s"),
    [
        (0.0, False, 0.0, 10.0),
        (10.0, True, 40.0, 10.0),
        (39.5, True, 40.0, 39.5),
        (40.0, False, 40.0, 90.0),
        (-75.0, False, -75.0, -70.0),
        (-65.0, True, -40.0, -65.0),
    ],
)
def test_a_signal_by_hand(
    time_s: float, is_open: bool, open_until_s: float, closed_until_s: float
) -> None:
    assert SIGNAL.is_open(time_s) is is_open
    assert SIGNAL.open_until_s(time_s) == pytest.approx(open_until_s)
    assert SIGNAL.closed_until_s(time_s) == pytest.approx(closed_until_s)


def test_signals_that_never_change() -> None:
    assert Signal.cyclic(0.0, 60.0, 0.0, 60.0).open_until_s(7.0) == math.inf
    assert Signal.cyclic(0.0, 60.0, 0.0, 0.0).closed_until_s(7.0) == math.inf


@pytest.mark.parametrize(
    "values", [(0.0, 0.0, 0.0, 0.0), (0.0, 60.0, 0.0, 61.0), (math.nan, 60.0, 0.0, 30.0)]
)
def test_impossible_signals_are_refused(values: tuple[float, float, float, float]) -> None:
    with pytest.raises(RouteError, match="allowed"):
        Signal.cyclic(*values)


def test_stop_lines_out_of_order_are_refused() -> None:
    with pytest.raises(RouteError, match="increasing"):
        RoadRules(None, (SIGNAL, SIGNAL))


def test_the_leader_halts_before_a_closed_line_and_drives_on_when_it_opens() -> None:
    # Its front is 195 m away; it would be there after 14 s, closed from 5 s to 50 s.
    predicted = predict(300.0, 14.0, Signal.cyclic(500.0, 80.0, 50.0, 35.0))
    fronts = predicted.positions_m + 5.0
    assert (fronts[TIMES < 50.0] <= 500.0 + 1e-9).all()
    assert fronts[49] > 495.0
    assert predicted.speeds_m_s[49] == 0.0
    assert predicted.speeds_m_s[60] > 8.0
    assert History().predict(LeaderTrack((Observation(0.0, 300.0, 14.0, 0.0),)), TIMES).positions_m[
        50
    ] == pytest.approx(1000.0)


def test_an_open_line_and_one_that_closes_too_late_change_nothing() -> None:
    # At the line after 7 s: once open for long, once closed when 14 m are left, which takes 7 m/s^2.
    for signal in (Signal.cyclic(400.0, 80.0, -5.0, 60.0), Signal.cyclic(400.0, 80.0, -20.0, 26.0)):
        predicted = predict(297.0, 14.0, signal)
        np.testing.assert_allclose(predicted.positions_m, 297.0 + 14.0 * TIMES, atol=1e-6)


def test_a_standing_leader_is_known_until_its_line_opens() -> None:
    predicted = predict(480.0, 0.0, SIGNAL, time_s=42.0)  # the line opens 48 s later
    standing = TIMES <= 47.0
    assert (predicted.positions_m[standing] == 480.0).all()
    assert (predicted.bounds_m[standing] == predicted.bounds_m[0]).all()
    assert predicted.bounds_m[55] > 10.0
    # The same leader in front of an open line is known no better than any other.
    assert predict(480.0, 0.0, SIGNAL, time_s=12.0).bounds_m[10] > 10.0


@given(st.floats(0.0, 25.0), st.floats(0.0, 480.0), st.floats(0.0, 80.0), st.floats(1.0, 79.0))
def test_no_closed_line_is_passed_by_who_can_halt(
    speed_m_s: float, position_m: float, opens_at_s: float, open_for_s: float
) -> None:
    signal = Signal.cyclic(500.0, 80.0, opens_at_s, open_for_s)
    limits = SpeedLimits(np.array([0.0, 300.0]), np.array([25.0, 12.0]))
    track = LeaderTrack((Observation(0.0, position_m, speed_m_s, 0.0),), length_m=5.0)
    fine = 0.25 * np.arange(0.0, 241.0)
    predicted = BoundedByRules(History(), RoadRules(limits, (signal,))).predict(track, fine)
    assert predicted is not None
    assert (np.diff(predicted.positions_m) >= -1e-9).all()
    assert (predicted.speeds_m_s >= 0.0).all()
    assert (predicted.speeds_m_s <= max(speed_m_s, 25.0) + 1e-9).all()
    passed = np.flatnonzero(np.diff((predicted.positions_m + 5.0 > 500.0).astype(int)))
    for index in passed.tolist():
        speed, front = predicted.speeds_m_s[index], predicted.positions_m[index] + 5.0
        # Whoever passes while it is closed could not have halted.
        assert (
            signal.is_open(fine[index])
            or signal.is_open(fine[index + 1])
            or (speed**2 > 2.0 * 2.4 * (500.0 - front))
        )
