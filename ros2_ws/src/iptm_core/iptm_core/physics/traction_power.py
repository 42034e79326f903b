"""Electric traction power, paper eq. (5)."""

from __future__ import annotations

from iptm_core.parameters.model import PowertrainParameters
from iptm_core.physics.ops import Scalar


def traction_power_w(
    speed_m_s: Scalar, motor_torque: Scalar, powertrain: PowertrainParameters
) -> Scalar:
    """Electric power of the motor (P_tra, eq. 5), negative when it feeds back.

    Args:
        speed_m_s: vehicle speed v.
        motor_torque: motor torque T_m in N m.
        powertrain: gear ratios (epsilon = i_g i_0 / r_w) and the copper-loss coefficient sigma.

    Returns:
        Power in W: shaft power plus copper loss ``sigma T_m^2``.
    """
    ratio_1_m = (
        powertrain.transmission_ratio * powertrain.final_drive_ratio / powertrain.wheel_radius_m
    )
    copper_loss = powertrain.motor_loss_w_per_nm2 * motor_torque * motor_torque
    return ratio_1_m * speed_m_s * motor_torque + copper_loss
