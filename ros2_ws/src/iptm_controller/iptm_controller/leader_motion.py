"""Motion of the lead vehicle as measured, and extrapolated from what is measured."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from iptm_core.state import FloatArray, LeaderPreview, LeaderState

ACCELERATION_DECAY_S = 4.0
"""Time constant with which the lead vehicle's acceleration decays where nothing is predicted. In every
published cycle positions 3 to 8 s ahead are predicted better than at a constant speed, and over all of them
together better than with half or twice the constant (a test checks both)."""
ACCELERATION_WINDOW_S = 1.0
"""The acceleration is the least-squares slope of the speeds in this window, of at least two samples."""
LARGEST_ACCELERATION_M_S2 = 10.0
"""More than tyres transmit: a larger change of the measured speed is not the motion of one vehicle."""
RANGE_ERROR_M = 1.0
"""A position jump larger than this, beyond what the speeds explain, means that another vehicle leads."""
_EXTRAPOLATED_S = 5.0 * ACCELERATION_DECAY_S
_SHORTEST_STOP_S = 1e-3
_SHARES: FloatArray = np.array([node / 40.0 for node in range(41)])


def measured_acceleration_m_s2(measured: Sequence[LeaderState]) -> float:
    """Return the leader's acceleration from its speeds of the last second, 0 without enough of them.

    Args:
        measured: leader at increasing times, the newest one last. Where a measurement is missing, the one
            before counts instead.
    """
    if len(measured) < 2:
        return 0.0
    last, before = measured[-1], measured[-2]
    passed_s, changed_m_s = last.time_s - before.time_s, last.speed_m_s - before.speed_m_s
    moved_m = last.position_m - before.position_m
    unexplained_m = abs(moved_m - 0.5 * passed_s * (last.speed_m_s + before.speed_m_s))
    if unexplained_m > 0.5 * passed_s * abs(changed_m_s) + RANGE_ERROR_M:
        return 0.0
    since_s = min(last.time_s - ACCELERATION_WINDOW_S - 1e-6, before.time_s)
    recent = [state for state in measured if state.time_s >= since_s]
    times_s = np.array([state.time_s for state in recent])
    times_s -= times_s.mean()
    speeds_m_s = np.array([state.speed_m_s for state in recent])
    slope_m_s2 = float(times_s @ speeds_m_s / (times_s @ times_s))
    return slope_m_s2 if abs(slope_m_s2) <= LARGEST_ACCELERATION_M_S2 else 0.0


def extrapolated_motion(leader: LeaderState, acceleration_m_s2: float) -> LeaderPreview:
    """Return how a leader goes on of which only the present is known.

    Its acceleration dies away exponentially, which is what to expect of one that varies as a first-order
    Gauss-Markov process (R. A. Singer, Estimating optimal tracking filter performance for manned
    maneuvering targets, IEEE Transactions on Aerospace and Electronic Systems 6, 1970). It never drives
    backwards.

    Args:
        acceleration_m_s2: as measured, negative when braking.
    """
    decay_s, change_m_s = ACCELERATION_DECAY_S, ACCELERATION_DECAY_S * acceleration_m_s2
    until_s, shares = _EXTRAPOLATED_S, _SHARES
    if leader.speed_m_s + change_m_s < 0.0:
        stop_s = -decay_s * math.log1p(leader.speed_m_s / change_m_s)
        until_s = min(until_s, stop_s)
        if stop_s < _SHORTEST_STOP_S:
            shares = shares[:1]
    elapsed_s = until_s * shares
    gone = -np.expm1(-elapsed_s / decay_s)
    speeds_m_s = np.maximum(leader.speed_m_s + change_m_s * gone, 0.0)
    moved_m = leader.speed_m_s * elapsed_s + change_m_s * (elapsed_s - decay_s * gone)
    return LeaderPreview(leader.time_s + elapsed_s, leader.position_m + moved_m, speeds_m_s)
