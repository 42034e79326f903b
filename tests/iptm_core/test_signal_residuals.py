"""Signals that belong together: what they leave unexplained, by numbers from known motions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from iptm_core.signal_residuals import (
    RANGE_LIMIT_M,
    RANGE_TIME_S,
    Contradiction,
    Residual,
    SignalWatch,
    unexplained_change,
)

STEP_S = 0.05


def watched(gap_of, rate_of, duration_s: float) -> float | None:
    """Return when a contradiction shows in signals made from a gap that falls by 2 m/s, None for never."""
    watch = SignalWatch()
    for time_s in np.arange(0.0, duration_s, STEP_S).tolist():
        true_m = 60.0 - 2.0 * time_s
        watch.see_gap(time_s, gap_of(true_m), rate_of(-2.0))
        if watch.contradictions:
            assert watch.contradictions == (Contradiction.RANGE,)
            return time_s
    return None


def test_unexplained_is_what_no_course_of_the_rate_explains():
    assert unexplained_change(-3.0, -2.0, -2.0, 1.0) == pytest.approx(-1.0)
    # From -2 to 0 m/s within 1 s a gap changes by -2 to 0 m, whenever the rate changes.
    for change_m in (-2.0, -1.0, 0.0):
        assert unexplained_change(change_m, -2.0, 0.0, 1.0) == 0.0
    assert unexplained_change(0.5, -2.0, 0.0, 1.0) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("gap_of", "rate_of", "within_s"),
    [
        (lambda m: 1.5 * m + 10.0, lambda r: r, 2.5),
        (lambda m: m, lambda _: 0.0, 1.2),
        (lambda m: m, lambda r: -r, 0.6),
        (lambda m: m, lambda r: 0.5 * r, 2.5),
        (lambda _: 60.0, lambda r: r, 1.2),
    ],
    ids=["gap scaled", "rate zero", "rate reversed", "rate halved", "gap frozen"],
)
def test_signals_that_are_wrong_contradict_each_other(gap_of, rate_of, within_s):
    assert watched(lambda m: m, lambda r: r, 20.0) is None
    found_s = watched(gap_of, rate_of, 20.0)
    assert found_s is not None
    assert found_s < within_s


def test_noise_and_another_target_are_no_contradiction():
    random = np.random.default_rng(4)
    watch = SignalWatch()
    for time_s in np.arange(0.0, 600.0, STEP_S).tolist():
        at_m = 40.0 + 15.0 * math.sin(0.3 * time_s) + (25.0 if time_s > 300.0 else 0.0)
        noise_m, noise_m_s = 0.3 * random.standard_normal(), 0.1 * random.standard_normal()
        watch.see_gap(time_s, at_m + noise_m, 4.5 * math.cos(0.3 * time_s) + noise_m_s)
        assert not watch.contradictions
    watch.see_gap(600.0, math.nan, 0.0)
    watch.see_gap(600.1, 90.0, 5.0)
    assert not watch.contradictions


def test_speed_and_acceleration():
    for acceleration, contradicts in ((1.0, False), (0.4, True), (-1.0, True)):
        watch = SignalWatch()
        for time_s in np.arange(0.0, 6.0, STEP_S).tolist():
            watch.see_speed(time_s, 5.0 + time_s, acceleration)
        assert bool(watch.contradictions) is contradicts
    watch = SignalWatch()  # brakes hold a standing vehicle
    for time_s in np.arange(0.0, 6.0, STEP_S).tolist():
        watch.see_speed(time_s, 0.0, -1.0)
        assert not watch.contradictions


def test_a_steady_error_of_the_rate_is_estimated_by_its_residual():
    residual = Residual()
    for _ in range(400):
        residual = residual.after(-0.5 * STEP_S, STEP_S, RANGE_TIME_S)
    assert residual.value / RANGE_TIME_S == pytest.approx(-0.5, rel=0.02)
    assert -0.5 < residual.beyond(RANGE_LIMIT_M) / RANGE_TIME_S < 0.0
