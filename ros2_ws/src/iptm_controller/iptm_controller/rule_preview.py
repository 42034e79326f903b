"""A preview used without an optimisation: the gentlest cubic that meets the lead vehicle in some seconds.

In h seconds the ego vehicle reaches the desired gap and the speed that the lead vehicle has then. Among all
motions that do, the position of the one with the least integral of the squared acceleration is a cubic in
time. The longest h counts whose motion keeps s_min behind the predicted lead vehicle at every second. It may
brake harder than is comfortable: the limiter bounds it, as in the cruise controls.
"""

from __future__ import annotations

import math

import numpy as np

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import minimum_gap_m
from iptm_core.state import LeaderPreview, VehicleState

LONGEST_S = 20
"""Longest time in which the lead vehicle is met: beyond it the gap swings widely and little more is saved."""
TOLERANCE_M = 0.05
"""Gap below s_min, and distance driven backwards in a second, that still count as kept."""


def gentlest_acceleration_m_s2(
    state: VehicleState,
    motion: LeaderPreview,
    known_s: float,
    time_headway_s: float,
    parameters: ModelParameters,
    tick_s: float,
) -> float:
    """Return the mean acceleration of the next tick, NaN where no motion keeps s_min.

    Args:
        motion: predicted motion of the lead vehicle.
        known_s: for how long it is known.
        time_headway_s: beyond the gap at standstill, when it is met.
    """
    gap, limits = parameters.gap, parameters.limits
    longest_s = min(math.floor(known_s), LONGEST_S)
    elapsed_s = np.arange(1.0, longest_s + 1.0, dtype=np.float64)
    leader_m, leader_m_s = motion.at(state.time_s + elapsed_s)
    speed = state.speed_m_s
    for met_s in range(longest_s, 0, -1):
        on_way_s, end_m_s = elapsed_s[:met_s], float(leader_m_s[met_s - 1])
        desired_m = gap.standstill_gap_m + time_headway_s * end_m_s
        way_m = float(leader_m[met_s - 1]) - desired_m - state.position_m
        first = 6.0 * (way_m - speed * met_s) / met_s**2 - 2.0 * (end_m_s - speed) / met_s
        jerk = 2.0 * ((end_m_s - speed) / met_s - first) / met_s
        speeds = speed + on_way_s * (first + 0.5 * jerk * on_way_s)
        driven_m = on_way_s * (speed + on_way_s * (0.5 * first + jerk * on_way_s / 6.0))
        gaps_m = leader_m[:met_s] - state.position_m - driven_m
        least_m = minimum_gap_m(speeds, leader_m_s[:met_s], gap, limits)
        least_m = np.maximum(least_m, gap.standstill_gap_m)
        if (speeds >= -TOLERANCE_M).all() and (gaps_m >= least_m - TOLERANCE_M).all():
            return first + 0.5 * jerk * tick_s
    return math.nan
