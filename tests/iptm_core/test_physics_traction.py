"""From motion to electric power: by hand, by the printed equations, and by bounds."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import RegenerationParameters
from iptm_core.physics.powertrain import (
    advance_position_m,
    advance_speed_m_s,
    brake_release,
    coast_down_force_n,
    drag_loss_w,
    motor_torque_nm,
    regenerative_torque_nm,
    traction_force_n,
    traction_power_w,
    warm_up_force_n,
)

VALUES = load_parameters().values
BODY, POWERTRAIN = VALUES.body, VALUES.powertrain
RATIO_1_M = 2.80 * 3.789 / 0.28  # 37.89, wheel force per motor torque
LIMITS = RegenerationParameters(84.0, 50e3, 1.0, 2.0, 2.0, 0.5)
FORCES = st.floats(-6000.0, 6000.0)
SPEEDS = st.floats(0.0, 37.5)


@pytest.mark.parametrize(
    ("speed", "acceleration", "sine", "force"),
    [
        # 1432 * 9.8 * 0.015 = 210.504 N; 0.5 * 0.3 * 2.22 * 1.026 * 20^2 = 136.6632 N
        (0.0, 0.0, 0.0, 210.504),
        (20.0, 0.0, 0.0, 347.1672),
        # 1432 * 1.022 * 1.5 = 2195.256 N on top, both ways
        (20.0, 1.5, 0.0, 347.1672 + 2195.256),
        (20.0, -1.5, 0.0, 347.1672 - 2195.256),
        # 3 m in 5 m: sin = 0.6, cos = 0.8; weight 14033.6 N
        (0.0, 0.0, 0.6, 14033.6 * (0.6 + 0.015 * 0.8)),
        (0.0, 0.0, -0.6, 14033.6 * (-0.6 + 0.015 * 0.8)),
    ],
)
def test_force_by_hand(speed: float, acceleration: float, sine: float, force: float) -> None:
    found = traction_force_n(speed, acceleration, math.asin(sine), BODY)
    assert found == pytest.approx(force, rel=1e-12)


@given(
    speed=SPEEDS,
    acceleration=st.floats(-2.0, 2.0),
    first_s=st.floats(0.0, 10.0),
    second_s=st.floats(0.0, 10.0),
)
def test_two_short_steps_are_one_long_step(
    speed: float, acceleration: float, first_s: float, second_s: float
) -> None:
    half_way = advance_speed_m_s(speed, acceleration, first_s)
    position = advance_position_m(100.0, speed, acceleration, first_s)
    position = advance_position_m(position, half_way, acceleration, second_s)
    whole = first_s + second_s
    end = advance_speed_m_s(half_way, acceleration, second_s)
    assert end == pytest.approx(advance_speed_m_s(speed, acceleration, whole), abs=1e-12)
    assert position == pytest.approx(
        advance_position_m(100.0, speed, acceleration, whole), abs=1e-10
    )


def test_motion_by_hand() -> None:
    # from 10 m/s with -2 m/s^2 for 3 s: 10 - 6 = 4 m/s, 30 - 9 = 21 m
    assert advance_speed_m_s(10.0, -2.0, 3.0) == 4.0
    assert advance_position_m(5.0, 10.0, -2.0, 3.0) == 26.0


@given(FORCES)
def test_torque_is_the_printed_equation(force_n: float) -> None:
    """T_m = F_v r_w / (i_g i_0 eta_t^sign(F_v)); a lossless driveline has no kink to smooth."""
    sign = (force_n > 0.0) - (force_n < 0.0)
    assert motor_torque_nm(force_n, POWERTRAIN) == pytest.approx(
        force_n * 0.28 / (2.80 * 3.789 * 0.9**sign), rel=1e-13, abs=1e-300
    )
    lossless = replace(POWERTRAIN, driveline_efficiency=1.0)
    smooth = motor_torque_nm(force_n, lossless, force_smoothing_n=150.0)
    assert smooth == pytest.approx(force_n / RATIO_1_M, rel=1e-12, abs=1e-300)


@pytest.mark.parametrize(
    ("speed", "acceleration", "share"),
    [(0.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 1e-9, 1.0), (1e-9, -2.0, 1.0), (20.0, 0.0, 1.0)],
)
def test_the_brakes_hold_only_without_motion_and_without_intent(
    speed: float, acceleration: float, share: float
) -> None:
    assert brake_release(speed, acceleration) == share


@given(speed=SPEEDS, width=st.floats(0.05, 1.0))
def test_the_smooth_brake_hold_withholds_a_known_share(speed: float, width: float) -> None:
    """Once rolling, the withheld share is s^2 / (v^2 + s^2)."""
    released = brake_release(speed, 0.0, speed_smoothing_m_s=width)
    assert 1.0 - released == pytest.approx(width**2 / (speed**2 + width**2), rel=1e-9, abs=1e-15)


def test_power_by_hand() -> None:
    # 10 N m at 20 m/s: 37.89 * 20 * 10 = 7578 W at the shaft, 0.873 * 100 = 87.3 W in copper
    assert traction_power_w(20.0, 10.0, POWERTRAIN) == pytest.approx(7665.3, rel=1e-12)
    assert traction_power_w(20.0, -10.0, POWERTRAIN) == pytest.approx(-7490.7, rel=1e-12)
    assert traction_power_w(0.0, -30.0, POWERTRAIN) == pytest.approx(0.873 * 900.0, rel=1e-12)


@given(force=FORCES, speed=SPEEDS)
def test_power_at_the_wheels_plus_the_losses_is_the_electric_power(
    force: float, speed: float
) -> None:
    """Driving: P = F v + driveline loss + copper loss; braking: the loss is kept from the motor."""
    torque = motor_torque_nm(force, POWERTRAIN)
    wheels = force * speed
    driveline = wheels * (1.0 / 0.9 - 1.0) if force > 0.0 else wheels * (0.9 - 1.0)
    assert driveline >= 0.0
    assert traction_power_w(speed, torque, POWERTRAIN) == pytest.approx(
        wheels + driveline + 0.873 * torque**2, rel=1e-12, abs=1e-9
    )


def test_drag_loss_has_the_same_value_in_both_directions() -> None:
    assert drag_loss_w(-200.0, 0.5, 0.002) == pytest.approx(100.0 + 80.0)
    assert drag_loss_w(200.0, 0.5, 0.002) == drag_loss_w(-200.0, 0.5, 0.002)


@pytest.mark.parametrize(
    ("demand", "motor_speed", "speed", "acceleration", "expected"),
    [
        (120.0, 300.0, 10.0, 1.0, 120.0),  # driving
        (-50.0, 300.0, 10.0, -1.0, -50.0),  # within all limits
        (-150.0, 300.0, 10.0, -1.5, -84.0),  # torque
        (-84.0, 1000.0, 35.0, -1.0, -50.0),  # power: 50 kW at 1000 rad/s
        (-50.0, 45.0, 1.5, -1.0, -42.0),  # half way through the blend
        (-50.0, 30.0, 0.9, -1.0, 0.0),  # friction brakes alone
        (-40.0, 300.0, 10.0, -3.0, -20.0),  # half of it beyond 2 m/s^2
        (-40.0, 300.0, 10.0, -6.0, 0.0),  # all of it
    ],
)
def test_regeneration_by_hand(
    demand: float, motor_speed: float, speed: float, acceleration: float, expected: float
) -> None:
    values = (demand, motor_speed, speed, acceleration)
    assert regenerative_torque_nm(*values, LIMITS) == pytest.approx(expected)
    arrays = [np.array([value]) for value in values]
    np.testing.assert_allclose(regenerative_torque_nm(*arrays, LIMITS), [expected])
    symbols = [ca.SX.sym(name) for name in "tmva"]
    function = ca.Function("torque", symbols, [regenerative_torque_nm(*symbols, LIMITS)])
    assert float(function(*values)) == pytest.approx(expected)


def test_road_load_and_warm_up_by_hand() -> None:
    assert coast_down_force_n(20.0, 100.0, 2.0, 0.5) == pytest.approx(100.0 + 40.0 + 200.0)
    assert warm_up_force_n(150.0, 200.0, 150.0) == pytest.approx(200.0 / np.e)
