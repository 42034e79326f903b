"""Longitudinal dynamics of the vehicle, paper eqs. (1) and (2)."""

from __future__ import annotations

from iptm_core.parameters.model import BodyParameters
from iptm_core.physics.ops import Scalar, cos, sin


def traction_force_n(
    speed_m_s: Scalar, acceleration_m_s2: Scalar, slope_rad: Scalar, body: BodyParameters
) -> Scalar:
    """Force at the wheels that grade, rolling, air and inertia ask for (F_v, eq. 2).

    Args:
        speed_m_s: speed v, not negative.
        acceleration_m_s2: acceleration a, negative when braking.
        slope_rad: road slope theta, positive uphill.
        body: vehicle body.

    Returns:
        Force in N, positive when the vehicle has to be driven, negative when it has to be braked.
    """
    weight_n = body.mass_kg * body.gravity_m_s2
    grade = weight_n * sin(slope_rad)
    rolling = weight_n * body.rolling_resistance * cos(slope_rad)
    drag = (
        0.5
        * body.drag_coefficient
        * body.frontal_area_m2
        * body.air_density_kg_m3
        * speed_m_s
        * speed_m_s
    )
    inertia = body.mass_kg * body.rotational_inertia_factor * acceleration_m_s2
    return grade + rolling + drag + inertia


def advance_position_m(
    position_m: Scalar, speed_m_s: Scalar, acceleration_m_s2: Scalar, duration_s: float
) -> Scalar:
    """Position after a time of constant acceleration, exact solution of eq. (1)."""
    return position_m + duration_s * (speed_m_s + 0.5 * duration_s * acceleration_m_s2)


def advance_speed_m_s(speed_m_s: Scalar, acceleration_m_s2: Scalar, duration_s: float) -> Scalar:
    """Speed after a time of constant acceleration, exact solution of eq. (1)."""
    return speed_m_s + duration_s * acceleration_m_s2
