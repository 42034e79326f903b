"""Permitted gaps, and braking within the jerk limit against a simulation in small steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import strategies as st

from iptm_core.braking import SafetyMonitorSettings
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import (
    LEADER_SURPRISE_M_S,
    brake_build_up,
    braking_reserve_m,
    desired_gap_m,
    emergency_reserve_m,
    minimum_gap_m,
    stopping_distance_m,
)
from iptm_core.routes import CYCLE_NAMES
from iptm_core.routes.cycles import load_cycle
from iptm_core.state import FloatArray
from iptm_plant_sim.safety_monitor import SafetyMonitor

Agree = Callable[..., None]
VALUES = load_parameters().values
SPEEDS = st.floats(0.0, 37.5)


def gap(speed: float, leader_speed: float) -> float:
    value: float = minimum_gap_m(speed, leader_speed, VALUES.gap, VALUES.limits)
    return value


def test_by_hand() -> None:
    # s_st + v T_h + v (v - v_PV) / (2 sqrt(2 * 2)) = 5 + 1.5 v + v (v - v_PV) / 4
    assert gap(0.0, 0.0) == 5.0
    assert gap(0.0, 30.0) == 5.0
    assert gap(20.0, 20.0) == 35.0
    assert gap(20.0, 10.0) == pytest.approx(35.0 + 50.0, rel=1e-12)
    assert gap(20.0, 0.0) == pytest.approx(35.0 + 100.0, rel=1e-12)
    assert gap(20.0, 25.0) == pytest.approx(35.0 - 25.0, rel=1e-12)


def test_desired_gap_by_hand() -> None:
    policy = replace(VALUES.gap, desired_time_headway_s=1.6)
    assert [desired_gap_m(v, policy) for v in (0.0, 20.0)] == [5.0, 37.0]


def test_emergency_reserve_is_what_the_safety_monitor_leaves(parameters: ModelParameters) -> None:
    """Less a metre, on the worse of a dry and a slippery road."""
    monitor = SafetyMonitor(SafetyMonitorSettings(), parameters.brakes)
    road = monitor.road_braking()
    roads = [each for each in (road.full, road.slippery) if each is not None]
    worse = set()
    for speed, lead in ((5.0, 0.0), (37.5, 0.0), (20.0, 18.0), (35.0, 35.0), (30.0, 25.0)):
        safe_m = [monitor.safe_distance_m(speed, 0.0, lead, capability=each) for each in roads]
        worse.add(int(np.argmax(safe_m)))
        reserve_m = emergency_reserve_m(400.0, speed, lead, parameters.brakes)
        assert reserve_m == pytest.approx(400.0 - max(safe_m) - 1.0, abs=0.3)
    assert worse == {0, 1}


STEP_S = 0.01


def travelled_m(speeds: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(0.5 * STEP_S * (speeds[1:] + speeds[:-1]))])


def excesses_m(
    gap_m: float, speed: float, acceleration: float, leader_speed: float, values: ModelParameters
) -> FloatArray:
    """Gap minus s_min while both brake to standstill, in small steps."""
    times = np.arange(0.0, 45.0, STEP_S)
    limits = values.limits
    braking = np.maximum(acceleration - limits.max_jerk_m_s3 * times, limits.min_acceleration_m_s2)
    ego = speed + travelled_m(braking)
    halted = np.flatnonzero((ego <= 0.0) & (braking <= 0.0))
    if halted.size:
        ego[halted[0] :] = 0.0
    start = max(leader_speed - LEADER_SURPRISE_M_S, 0.0)
    leader = np.maximum(start + limits.min_acceleration_m_s2 * times, 0.0)
    gaps = gap_m + travelled_m(leader) - travelled_m(ego)
    return gaps - minimum_gap_m(ego, leader, values.gap, limits)


def test_build_up_by_hand(parameters: ModelParameters) -> None:
    """From rolling at 20 m/s: 4 s to -2 m/s^2, on average -1 m/s^2."""
    by_hand = (4.0, 80.0 - 0.5 * 4.0**3 / 6.0, 16.0)
    assert brake_build_up(20.0, 0.0, parameters.limits) == pytest.approx(by_hand)


def test_stopping_distance_by_hand(parameters: ModelParameters) -> None:
    """Build-up as above, then 16 m/s or 20 m/s at 2 m/s^2."""
    limits = parameters.limits
    assert stopping_distance_m(20.0, 0.0, limits) == pytest.approx(74.6667 + 64.0, abs=1e-4)
    assert stopping_distance_m(20.0, -2.0, limits) == pytest.approx(100.0)


def test_stopping_distance_is_hardly_short_of_a_halt_during_the_build_up(
    parameters: ModelParameters,
) -> None:
    limits = parameters.limits
    for acceleration in np.linspace(-2.0, 2.0, 9):
        for speed in np.linspace(0.0, 10.0, 21):
            times = np.arange(0.0, 20.0, STEP_S)
            braking = np.maximum(acceleration - limits.max_jerk_m_s3 * times, -2.0)
            moved = travelled_m(speed + travelled_m(braking))
            shortage = moved.max() - stopping_distance_m(speed, acceleration, limits)
            assert -0.05 <= shortage < 1.4


def test_reserve_is_the_smallest_excess_ahead(parameters: ModelParameters) -> None:
    """But for what is reached while the brakes build up, within a few metres of it."""
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(500):
        speed, leader_speed = rng.uniform(0.0, 37.5, 2)
        acceleration, gap = rng.uniform(-2.0, 2.0), rng.uniform(0.0, 150.0)
        reserve = braking_reserve_m(
            gap, speed, acceleration, leader_speed, parameters.gap, parameters.limits
        )
        excesses = excesses_m(gap, speed, acceleration, leader_speed, parameters)
        errors.append(min(reserve, excesses[0]) - excesses.min())
    assert min(errors) > -0.3
    assert max(errors) < 5.0
    assert np.median(errors) < 0.1


def test_reserve_is_smooth(parameters: ModelParameters) -> None:
    """Its second derivatives exist and stay moderate, kinks of the plain minimum included."""
    arguments = ca.SX.sym("z", 4)
    reserve = braking_reserve_m(*ca.vertsplit(arguments), parameters.gap, parameters.limits)
    curvature = ca.Function("h", [arguments], [ca.hessian(reserve, arguments)[0]])
    for speed in np.linspace(0.0, 37.5, 16):
        for leader_speed in np.linspace(0.0, 37.5, 61):
            for acceleration in (-2.0, 0.0, 2.0):
                values = curvature([60.0, speed, acceleration, leader_speed]).full()
                assert np.isfinite(values).all()


@pytest.mark.parametrize("name", sorted(CYCLE_NAMES))
def test_no_published_cycle_surprises_more_than_assumed(
    parameters: ModelParameters, name: str
) -> None:
    """Largest loss of speed between any two seconds on top of the assumed deceleration."""
    cycle = load_cycle(name)
    deceleration = -parameters.limits.min_acceleration_m_s2
    rest = cycle.speeds_m_s + deceleration * cycle.times_s
    surprises = np.maximum.accumulate(rest) - rest
    assert surprises.max() <= LEADER_SURPRISE_M_S
