"""Motor torque behind the driveline, paper eq. (3), and the brake hold at standstill."""

from __future__ import annotations

from iptm_core.parameters.model import PowertrainParameters
from iptm_core.physics.ops import Scalar, both, maximum, where


def motor_torque_nm(
    force_n: Scalar, powertrain: PowertrainParameters, *, force_smoothing_n: float = 0.0
) -> Scalar:
    """Motor torque for a wheel force (T_m, eq. 3).

    The driveline loses on both ways: ``F eta^-sign(F)`` equals ``max(F / eta, F eta)``, which is the
    form used here because it is one convex kink.

    Args:
        force_n: wheel force F_v.
        powertrain: ratios, wheel radius and driveline efficiency.
        force_smoothing_n: width of the smoothed kink in N of wheel force; 0 is exact.

    Returns:
        Torque in N m with the sign of the force.
    """
    efficiency = powertrain.driveline_efficiency
    # The two branches differ by F (1/eta - eta): the width is scaled so that it reads in newtons of F.
    width = force_smoothing_n * (1.0 / efficiency - efficiency)
    driven = maximum(force_n / efficiency, force_n * efficiency, width)
    ratio = powertrain.transmission_ratio * powertrain.final_drive_ratio
    return driven * powertrain.wheel_radius_m / ratio


def motor_speed_rad_s(speed_m_s: Scalar, powertrain: PowertrainParameters) -> Scalar:
    """Motor speed at a vehicle speed."""
    ratio = powertrain.transmission_ratio * powertrain.final_drive_ratio
    return speed_m_s * (ratio / powertrain.wheel_radius_m)


def brake_release(
    speed_m_s: Scalar, acceleration_m_s2: Scalar, *, speed_smoothing_m_s: float = 0.0
) -> Scalar:
    """Share of the motor torque that acts near standstill: 0 while the brakes hold, 1 when rolling.

    At v = 0 without commanded motion the brakes hold the vehicle, whatever the slope. The smoothed
    form depends on speed only and reaches one half at ``speed_smoothing_m_s``.
    """
    if speed_smoothing_m_s > 0.0:
        squared = speed_m_s * speed_m_s
        return squared / (squared + speed_smoothing_m_s * speed_smoothing_m_s)
    return where(both(speed_m_s <= 0.0, acceleration_m_s2 <= 0.0), 0.0, 1.0)
