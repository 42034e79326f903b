"""Permitted distances to the leader: the smallest by the intelligent driver model, and the largest."""

from __future__ import annotations

import math

from iptm_core.parameters.model import GapParameters, LimitParameters
from iptm_core.physics.ops import Scalar, maximum, minimum


def minimum_gap_m(
    speed_m_s: Scalar, leader_speed_m_s: Scalar, gap: GapParameters, limits: LimitParameters
) -> Scalar:
    """Desired minimum gap s_min as printed in the paper (unnumbered equation below eq. 16).

    ``s_st + v T_h + v (v - v_PV) / (2 sqrt(-a_min a_max))``. The last term is negative while the leader
    pulls away, so the value may fall below the standstill gap.

    Args:
        speed_m_s: host speed v.
        leader_speed_m_s: leader speed v_PV.
        gap: standstill gap and time headway.
        limits: acceleration bounds.

    Returns:
        Gap in m.
    """
    braking = 2.0 * math.sqrt(-limits.min_acceleration_m_s2 * limits.max_acceleration_m_s2)
    approach = speed_m_s * (speed_m_s - leader_speed_m_s) / braking
    return gap.standstill_gap_m + speed_m_s * gap.time_headway_s + approach


def maximum_gap_m(speed_m_s: Scalar, gap: GapParameters, *, smoothing_m: float = 0.0) -> Scalar:
    """Largest permitted gap s_max; with a largest time headway no more than that, but the initial gap.

    Args:
        speed_m_s: host speed v.
        gap: largest gap, largest time headway (0: none), and the gap at standstill at which trips begin.
        smoothing_m: width of the smoothed bounds; 0 is exact.

    Returns:
        Gap in m: the paper's constant without a largest time headway.
    """
    if gap.max_time_headway_s == 0.0:
        return gap.max_gap_m
    by_headway = maximum(gap.max_time_headway_s * speed_m_s, gap.initial_gap_m, smoothing_m)
    return minimum(by_headway, gap.max_gap_m, smoothing_m)
