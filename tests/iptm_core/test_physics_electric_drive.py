"""Drag loss, limits of regeneration and road load: values by hand, and the same in symbols."""

import casadi as ca
import numpy as np
import pytest

from iptm_core.parameters.model import RegenerationParameters
from iptm_core.physics.traction import (
    coast_down_force_n,
    drag_loss_w,
    regenerative_torque_nm,
    warm_up_force_n,
)

LIMITS = RegenerationParameters(84.0, 50e3, 1.0, 2.0, 2.0, 0.5)


def test_drag_loss_has_the_same_value_in_both_directions() -> None:
    assert drag_loss_w(-200.0, 0.5, 0.002) == pytest.approx(100.0 + 80.0)
    assert drag_loss_w(200.0, 0.5, 0.002) == drag_loss_w(-200.0, 0.5, 0.002)
    assert drag_loss_w(0.0, 0.5, 0.002) == 0.0


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
    assert warm_up_force_n(0.0, 200.0, 150.0) == 200.0
    assert warm_up_force_n(150.0, 200.0, 150.0) == pytest.approx(200.0 / np.e)
