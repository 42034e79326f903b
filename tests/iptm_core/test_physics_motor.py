"""Motor torque through the lossy driveline, and the brakes that hold at standstill."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.traction import brake_release, motor_torque_nm

Agree = Callable[..., None]
POWERTRAIN = load_parameters().values.powertrain
RATIO_1_M = 2.80 * 3.789 / 0.28  # 37.89, wheel force per motor torque
FORCES = st.floats(-6000.0, 6000.0)


def by_the_printed_equation(force_n: float) -> float:
    """T_m = F_v r_w / (i_g i_0 eta_t^sign(F_v))."""
    sign = (force_n > 0.0) - (force_n < 0.0)
    return force_n * 0.28 / (2.80 * 3.789 * 0.9**sign)


def test_driving_pays_the_driveline_and_braking_is_paid_less() -> None:
    # 378.9 N at the wheels are 10 N m at the motor of a lossless driveline
    assert motor_torque_nm(378.9, POWERTRAIN) == pytest.approx(10.0 / 0.9, rel=1e-12)
    assert motor_torque_nm(-378.9, POWERTRAIN) == pytest.approx(-9.0, rel=1e-12)
    assert motor_torque_nm(0.0, POWERTRAIN) == 0.0


@given(FORCES)
def test_torque_is_the_printed_equation(force_n: float) -> None:
    assert motor_torque_nm(force_n, POWERTRAIN) == pytest.approx(
        by_the_printed_equation(force_n), rel=1e-13, abs=1e-300
    )


@given(FORCES)
def test_a_lossless_driveline_has_no_kink(force_n: float) -> None:
    lossless = replace(POWERTRAIN, driveline_efficiency=1.0)
    expected = pytest.approx(force_n / RATIO_1_M, rel=1e-12, abs=1e-300)
    assert motor_torque_nm(force_n, lossless) == expected
    assert motor_torque_nm(force_n, lossless, force_smoothing_n=150.0) == expected


@given(force_n=FORCES, width_n=st.floats(1.0, 500.0))
def test_the_smoothed_torque_errs_by_a_known_amount(force_n: float, width_n: float) -> None:
    """Above the exact torque, by at most (1/eta - eta) width / 2 of wheel force, less away from 0."""
    spread = 1.0 / 0.9 - 0.9
    error_n = RATIO_1_M * (
        motor_torque_nm(force_n, POWERTRAIN, force_smoothing_n=width_n)
        - motor_torque_nm(force_n, POWERTRAIN)
    )
    bound_n = 0.5 * spread * width_n
    if abs(force_n) > width_n:
        bound_n = 0.25 * spread * width_n**2 / abs(force_n)
    assert -1e-9 <= error_n <= bound_n + 1e-9


def test_the_smoothed_torque_error_at_the_kink_is_its_bound() -> None:
    # 0.5 * (1/0.9 - 0.9) * 150 N = 15.83 N, 0.418 N m at the motor
    smooth = motor_torque_nm(0.0, POWERTRAIN, force_smoothing_n=150.0)
    assert smooth == pytest.approx(0.5 * (1.0 / 0.9 - 0.9) * 150.0 / RATIO_1_M, rel=1e-12)
    assert smooth == pytest.approx(0.418, abs=5e-4)


@pytest.mark.parametrize(
    ("speed", "acceleration", "share"),
    [(0.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 1e-9, 1.0), (1e-9, -2.0, 1.0), (20.0, 0.0, 1.0)],
)
def test_the_brakes_hold_only_without_motion_and_without_intent(
    speed: float, acceleration: float, share: float
) -> None:
    assert brake_release(speed, acceleration) == share


@given(speed=st.floats(0.0, 37.5), width=st.floats(0.05, 1.0))
def test_the_smooth_brake_hold_withholds_a_known_share(speed: float, width: float) -> None:
    """Once rolling, the withheld share is s^2 / (v^2 + s^2): one half at v = s, below (s / v)^2."""
    released = brake_release(speed, 0.0, speed_smoothing_m_s=width)
    assert 1.0 - released == pytest.approx(width**2 / (speed**2 + width**2), rel=1e-9, abs=1e-15)
    assert brake_release(width, 0.0, speed_smoothing_m_s=width) == 0.5
    assert brake_release(0.0, 2.0, speed_smoothing_m_s=width) == 0.0


def test_all_backends_agree(parameters: ModelParameters, agree_in_all_backends: Agree) -> None:
    forces = np.concatenate([np.linspace(-5000.0, 5000.0, 31), [0.0]])
    speeds, accelerations = np.meshgrid([0.0, 0.1, 1.0, 30.0], [-2.0, 0.0, 0.5])
    for width in (0.0, 150.0):
        agree_in_all_backends(
            lambda force, width=width: motor_torque_nm(
                force, parameters.powertrain, force_smoothing_n=width
            ),
            forces,
        )
    for width in (0.0, 0.3):
        agree_in_all_backends(
            lambda v, a, width=width: brake_release(v, a, speed_smoothing_m_s=width),
            speeds.ravel(),
            accelerations.ravel(),
        )
