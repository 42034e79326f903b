"""Motion inside an interval: exact, and cut where the vehicle stops or meets its top speed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_plant_sim.actuators import Motion, plan_motion

TOP = 37.5


def plan(speed: float, acceleration: float, duration: float = 1.0, n: int = 10) -> Motion:
    return plan_motion(100.0, speed, acceleration, TOP, duration, n)


def test_constant_acceleration_is_exact() -> None:
    motion = plan(10.0, 1.5)
    assert motion.end_speed_m_s == pytest.approx(11.5, abs=1e-14)
    assert motion.end_position_m == pytest.approx(100.0 + 10.0 + 0.75, abs=1e-12)
    assert motion.end_acceleration_m_s2 == 1.5
    np.testing.assert_allclose(motion.lengths_s, 0.1)
    np.testing.assert_allclose(motion.speeds_m_s[3], [10.45, 10.525, 10.6])


def test_stop_inside_the_interval_is_cut_at_the_stop() -> None:
    motion = plan(0.9, -2.0)
    until = 0.45
    assert motion.end_speed_m_s == 0.0
    assert motion.end_acceleration_m_s2 == 0.0
    assert motion.end_position_m == pytest.approx(100.0 + 0.5 * 0.9 * until, abs=1e-12)
    braking = motion.accelerations_m_s2 < 0.0
    assert motion.lengths_s[braking].sum() == pytest.approx(until)
    assert motion.lengths_s.sum() == pytest.approx(1.0)
    # The last braking instant still rolls, the first standing one does not: no kink inside a step.
    assert 0.0 < motion.speeds_m_s[braking][-1, 2] < 1e-9
    assert (motion.speeds_m_s[~braking] == 0.0).all()
    assert (motion.accelerations_m_s2[~braking] == 0.0).all()


def test_top_speed_holds_without_further_acceleration() -> None:
    motion = plan(TOP - 1.0, 2.0)
    assert motion.top_speed_reached
    assert motion.end_speed_m_s == TOP
    assert motion.end_acceleration_m_s2 == 0.0
    assert motion.end_position_m == pytest.approx(100.0 + (TOP - 0.5) * 0.5 + TOP * 0.5, abs=1e-12)


@pytest.mark.parametrize("acceleration", [-2.0, -1e-6, 0.0, 1e-7, 9e-4])
def test_brakes_hold_unless_told_to_move(acceleration: float) -> None:
    motion = plan(0.0, acceleration)
    assert (motion.speeds_m_s == 0.0).all()
    assert (motion.accelerations_m_s2 == 0.0).all()
    assert motion.end_position_m == 100.0


@pytest.mark.parametrize("duration", [0.05, 1.0])
def test_standstill_ends_with_a_commanded_motion(duration: float) -> None:
    motion = plan(0.0, 0.01, duration)
    assert motion.end_speed_m_s == pytest.approx(0.01 * duration)
    assert motion.end_position_m > 100.0


@given(
    speed=st.floats(0.0, TOP),
    acceleration=st.floats(-2.0, 2.0),
    duration=st.floats(0.01, 10.0),
    n=st.integers(2, 40),
)
def test_every_motion_is_consistent(
    speed: float, acceleration: float, duration: float, n: int
) -> None:
    motion = plan(speed, acceleration, duration, n)
    assert motion.lengths_s.shape == motion.accelerations_m_s2.shape == (n,)
    assert motion.speeds_m_s.shape == (n, 3)
    assert motion.positions_m.shape == (2 * n + 1,)
    assert (motion.lengths_s >= 0.0).all()
    assert motion.lengths_s.sum() == pytest.approx(duration)
    assert (motion.speeds_m_s >= 0.0).all()
    assert motion.speeds_m_s.max() <= TOP * (1.0 + 1e-12)
    assert 0.0 <= motion.end_speed_m_s <= TOP * (1.0 + 1e-12)
    assert (np.diff(motion.positions_m) >= -1e-12).all()
    # Simpson's rule is exact for piecewise linear speed.
    weights = motion.lengths_s[:, None] * np.array([1.0, 4.0, 1.0]) / 6.0
    distance = float((weights * motion.speeds_m_s).sum())
    assert motion.end_position_m - 100.0 == pytest.approx(distance, abs=1e-9)
