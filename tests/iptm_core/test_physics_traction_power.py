"""Electric power of the motor: shaft power plus copper loss."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.traction import motor_torque_nm, traction_power_w

Agree = Callable[..., None]
POWERTRAIN = load_parameters().values.powertrain


def test_by_hand() -> None:
    # 10 N m at 20 m/s: 37.89 * 20 * 10 = 7578 W at the shaft, 0.873 * 100 = 87.3 W in copper
    assert traction_power_w(20.0, 10.0, POWERTRAIN) == pytest.approx(7665.3, rel=1e-12)
    assert traction_power_w(20.0, -10.0, POWERTRAIN) == pytest.approx(-7490.7, rel=1e-12)


def test_a_standing_motor_only_burns_copper() -> None:
    assert traction_power_w(0.0, 30.0, POWERTRAIN) == pytest.approx(0.873 * 900.0, rel=1e-12)
    assert traction_power_w(0.0, -30.0, POWERTRAIN) == pytest.approx(0.873 * 900.0, rel=1e-12)
    assert traction_power_w(30.0, 0.0, POWERTRAIN) == 0.0


@given(force=st.floats(-6000.0, 6000.0), speed=st.floats(0.0, 37.5))
def test_power_at_the_wheels_plus_the_losses_is_the_electric_power(
    force: float, speed: float
) -> None:
    """Driving: P = F v + driveline loss + copper loss; braking: the loss is kept from the motor."""
    torque = motor_torque_nm(force, POWERTRAIN)
    wheels = force * speed
    driveline = wheels * (1.0 / 0.9 - 1.0) if force > 0.0 else wheels * (0.9 - 1.0)
    copper = 0.873 * torque**2
    assert driveline >= 0.0
    assert traction_power_w(speed, torque, POWERTRAIN) == pytest.approx(
        wheels + driveline + copper, rel=1e-12, abs=1e-9
    )


@given(force=st.floats(-6000.0, 0.0), speed=st.floats(0.0, 37.5))
def test_regeneration_never_returns_more_than_the_wheels_give(force: float, speed: float) -> None:
    assert traction_power_w(speed, motor_torque_nm(force, POWERTRAIN), POWERTRAIN) >= force * speed


def test_without_losses_electric_power_is_wheel_power() -> None:
    ideal = replace(POWERTRAIN, driveline_efficiency=1.0, motor_loss_w_per_nm2=0.0)
    for force in (-2000.0, 0.0, 3000.0):
        torque = motor_torque_nm(force, ideal)
        assert traction_power_w(13.0, torque, ideal) == pytest.approx(13.0 * force, rel=1e-12)


def test_all_backends_agree(parameters: ModelParameters, agree_in_all_backends: Agree) -> None:
    random = np.random.default_rng(2)
    agree_in_all_backends(
        lambda v, torque: traction_power_w(v, torque, parameters.powertrain),
        random.uniform(0.0, 37.5, 40),
        random.uniform(-80.0, 100.0, 40),
    )
