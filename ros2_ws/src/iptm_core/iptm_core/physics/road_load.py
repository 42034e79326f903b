"""Measured forces at constant speed: coast-down coefficients, and the warm-up after a stop."""

from __future__ import annotations

from iptm_core.physics.ops import Scalar, exp


def coast_down_force_n(
    speed_m_s: Scalar, constant_n: float, linear_n_s_m: float, quadratic_n_s2_m2: float
) -> Scalar:
    """Road load ``A + B v + C v^2`` from the three coefficients of a coast-down test, in N."""
    return constant_n + speed_m_s * (linear_n_s_m + quadratic_n_s2_m2 * speed_m_s)


def warm_up_force_n(driven_s: Scalar, cold_force_n: Scalar, time_constant_s: float) -> Scalar:
    """Additional rolling force of cold tyres, bearings and gear oil.

    Args:
        driven_s: time since the start of the trip.
        cold_force_n: additional force at the start.
        time_constant_s: time constant of the decay.

    Returns:
        Force in N.
    """
    return cold_force_n * exp(-driven_s / time_constant_s)
