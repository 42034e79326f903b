"""Foreseen traction powers: from the preview as far as it reaches, then from the trip so far."""

from __future__ import annotations

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_state

from iptm_controller.horizon import Horizon
from iptm_controller.ocp.grid import POWER_LEVELS, ProblemGrid
from iptm_controller.ocp.layout import ThermalSampleIndex
from iptm_controller.traction_forecast import TractionForecaster
from iptm_core.physics.power_thermal import electric_traction_power_w
from iptm_core.state import FloatArray, LeaderPreview, SlopePreview

FLAT = SlopePreview(np.zeros(1), np.zeros(1))
STEPS = 4


def forecaster() -> TractionForecaster:
    return TractionForecaster(PARAMETERS, ProblemGrid(Horizon.parse(f"3x1+5x5+{STEPS}x30t")))


def powers(samples: FloatArray) -> FloatArray:
    return samples[:, ThermalSampleIndex.TRACTION_POWER].reshape(STEPS, POWER_LEVELS)


def cruise_power_w(speed_m_s: float) -> float:
    return float(electric_traction_power_w(speed_m_s, 0.0, 0.0, PARAMETERS))


def steady(speed_m_s: float) -> LeaderPreview:
    times = np.arange(100.0, 500.0)
    positions = 1060.0 + speed_m_s * (times - 100.0)
    return LeaderPreview(times, positions, np.full(times.size, speed_m_s))


def test_behind_a_steady_leader_the_ego_cruises() -> None:
    own = forecaster()
    state = make_state(speed_m_s=25.0)
    own.remember(state, FLAT)
    samples = own.samples(state, steady(25.0), 300.0, FLAT)
    np.testing.assert_allclose(powers(samples), cruise_power_w(25.0), rtol=1e-6)
    np.testing.assert_allclose(samples[:, ThermalSampleIndex.SPEED], 25.0)


def test_beyond_the_preview_the_trip_so_far_counts() -> None:
    """Two thirds of the time at 10 m/s, one third at 30: the levels are those powers."""
    own = forecaster()
    for tick, speed in enumerate([10.0, 10.0, 30.0] * 20):
        own.remember(make_state(time_s=float(tick), speed_m_s=speed), FLAT)
    state = make_state(time_s=100.0, speed_m_s=25.0)
    # The preview ends inside of the second thermal step, 58 to 88 s ahead.
    samples = own.samples(state, steady(25.0), 60.0, FLAT)
    found = powers(samples)
    np.testing.assert_allclose(found[0], cruise_power_w(25.0), rtol=1e-6)
    usual = [cruise_power_w(10.0), cruise_power_w(10.0), cruise_power_w(30.0)]
    for step in range(1, STEPS):
        np.testing.assert_allclose(found[step], usual, rtol=1e-9)
    assert samples[-1, ThermalSampleIndex.SPEED] == pytest.approx(50.0 / 3.0)


def test_a_stop_of_the_leader_is_smoothed() -> None:
    """Speeds change over the window, not at once; what is averaged keeps the way."""
    times = np.arange(100.0, 500.0)
    speeds = np.where((times > 160.0) & (times < 175.0), 5.0, 20.0)
    positions = 1060.0 + np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]))])
    own = forecaster()
    state = make_state(speed_m_s=20.0)
    own.remember(state, FLAT)
    found = own.samples(state, LeaderPreview(times, positions, speeds), 399.0, FLAT)
    average = found[:, ThermalSampleIndex.SPEED].reshape(STEPS, POWER_LEVELS)[:, 0]
    assert (average > 14.0).all()
    assert average[1] < 18.0
    assert average[-1] == pytest.approx(20.0, abs=0.01)


def test_hills_count_where_the_ego_will_be() -> None:
    own = forecaster()
    state = make_state(speed_m_s=25.0)
    own.remember(state, FLAT)
    flat = powers(own.samples(state, steady(25.0), 300.0, FLAT))
    # Uphill from 2000 m behind the ego vehicle on: reached after 80 s, in the second thermal step.
    climb = SlopePreview(
        state.position_m + np.array([0.0, 2000.0, 2001.0, 9000.0]), np.array([0.0, 0.0, 0.03, 0.03])
    )
    hilly = powers(own.samples(state, steady(25.0), 300.0, climb))
    np.testing.assert_allclose(hilly[0], flat[0])
    assert hilly[1][0] == pytest.approx(flat[1][0])
    assert (hilly[2:] > flat[2:] + 5e3).all()


def test_an_earlier_state_forgets_the_trip() -> None:
    own = forecaster()
    for tick in range(30):
        own.remember(make_state(time_s=100.0 + tick, speed_m_s=30.0), FLAT)
    state = make_state(time_s=0.0, speed_m_s=10.0)
    own.remember(state, FLAT)
    found = powers(own.samples(state, steady(10.0), 0.0, FLAT))
    np.testing.assert_allclose(found, cruise_power_w(10.0))
