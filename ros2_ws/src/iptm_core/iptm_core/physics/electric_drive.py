"""Losses of motor and inverter that grow with speed, and the limits of regenerative braking.

The paper has one loss, ``sigma T_m^2`` (eq. 5), and one constant for regeneration, ``zeta`` (eq. 4).
These functions refine both; they are fitted to measured cars in ``iptm_validation``.
"""

from __future__ import annotations

from iptm_core.parameters.model import RegenerationParameters
from iptm_core.physics.ops import Scalar, absolute, maximum, minimum


def drag_loss_w(
    motor_speed_rad_s: Scalar, linear_w_s_rad: float, quadratic_w_s2_rad2: float
) -> Scalar:
    """Loss of a turning motor without torque: bearings and hysteresis (linear), eddy currents (quadratic).

    Args:
        motor_speed_rad_s: motor speed, either sign.
        linear_w_s_rad: coefficient c_1 in W s/rad.
        quadratic_w_s2_rad2: coefficient c_2 in W s^2/rad^2.

    Returns:
        Loss in W, not negative.
    """
    speed = absolute(motor_speed_rad_s)
    return speed * (linear_w_s_rad + quadratic_w_s2_rad2 * speed)


def regenerative_torque_nm(
    torque_nm: Scalar,
    motor_speed_rad_s: Scalar,
    speed_m_s: Scalar,
    acceleration_m_s2: Scalar,
    limits: RegenerationParameters,
    *,
    torque_smoothing_nm: float = 0.0,
    speed_smoothing_m_s: float = 0.0,
) -> Scalar:
    """Motor torque for a demanded torque: braking is shared with the friction brakes.

    Args:
        torque_nm: demanded motor torque, negative when braking.
        motor_speed_rad_s: motor speed, not negative.
        speed_m_s: vehicle speed, not negative.
        acceleration_m_s2: acceleration of the vehicle, negative when braking.
        limits: limits of regeneration.
        torque_smoothing_nm: width of the smoothed bound of the torque; 0 is exact.
        speed_smoothing_m_s: width of the smoothed ends of the blending; 0 is exact.

    Returns:
        Motor torque in N m; the friction brakes supply the difference.
    """
    blend_width = limits.blend_end_m_s - limits.blend_start_m_s
    blend_smoothing = speed_smoothing_m_s / blend_width
    blend = (speed_m_s - limits.blend_start_m_s) / blend_width
    blend = minimum(maximum(blend, 0.0, blend_smoothing), 1.0, blend_smoothing)
    beyond = maximum(-acceleration_m_s2 - limits.deceleration_m_s2, 0.0)
    share = maximum(1.0 - limits.decline_s2_m * beyond, 0.0)
    # Below one rad/s the power limit does not bind at any torque of a road vehicle.
    power_bound = limits.power_w / maximum(motor_speed_rad_s, 1.0)
    bound = blend * minimum(limits.torque_nm, power_bound, torque_smoothing_nm)
    braking = minimum(torque_nm, 0.0)
    return maximum(torque_nm + (share - 1.0) * braking, -bound, torque_smoothing_nm)
