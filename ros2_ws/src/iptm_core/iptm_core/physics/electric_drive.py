"""Losses of motor and inverter that grow with speed, and the limits of regenerative braking.

The paper has one loss, ``sigma T_m^2`` (eq. 5), and one constant for regeneration, ``zeta`` (eq. 4).
These functions refine both; they are fitted to measured cars in ``iptm_validation``.
"""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.physics.ops import Scalar, absolute, maximum, minimum


@dataclass(frozen=True)
class RegenerationLimits:
    """What the motor may contribute to braking.

    Attributes:
        torque_nm: largest regenerative motor torque, positive.
        power_w: largest regenerative shaft power, positive.
        blend_start_m_s: speed below which the friction brakes alone stop the vehicle.
        blend_end_m_s: speed above which the motor brakes within its limits.
        deceleration_m_s2: deceleration from which on the friction brakes take over, positive.
        decline_s2_m: share of the regenerative torque that is lost per m/s^2 beyond that deceleration.
    """

    torque_nm: float
    power_w: float
    blend_start_m_s: float
    blend_end_m_s: float
    deceleration_m_s2: float
    decline_s2_m: float


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
    limits: RegenerationLimits,
) -> Scalar:
    """Motor torque for a demanded torque: braking is shared with the friction brakes.

    Args:
        torque_nm: demanded motor torque, negative when braking.
        motor_speed_rad_s: motor speed, not negative.
        speed_m_s: vehicle speed, not negative.
        acceleration_m_s2: acceleration of the vehicle, negative when braking.
        limits: limits of regeneration.

    Returns:
        Motor torque in N m; the friction brakes supply the difference.
    """
    blend_width = limits.blend_end_m_s - limits.blend_start_m_s
    blend = minimum(maximum((speed_m_s - limits.blend_start_m_s) / blend_width, 0.0), 1.0)
    beyond = maximum(-acceleration_m_s2 - limits.deceleration_m_s2, 0.0)
    share = maximum(1.0 - limits.decline_s2_m * beyond, 0.0)
    # Below one rad/s the power limit does not bind at any torque of a road vehicle.
    power_bound = limits.power_w / maximum(motor_speed_rad_s, 1.0)
    bound = blend * minimum(limits.torque_nm, power_bound)
    return maximum(torque_nm, 0.0) + maximum(share * minimum(torque_nm, 0.0), -bound)
