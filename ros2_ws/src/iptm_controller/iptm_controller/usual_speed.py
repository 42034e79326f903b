"""A leader without a preview that returns to its usual speed (`gap.leader_return_s`).

The measured acceleration predicts the next seconds. Beyond, a leader that is faster than usual slows down
sooner or later, and a gap that was closed before is opened again by braking. This forecast is cautious: on
the published cycles three leaders in four get farther (a test checks it). Plans that are drawn to a desired
headway save more with it, see `studies/foresight`.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from iptm_controller.lead_check import EXTRAPOLATED_NODES
from iptm_core.state import LeaderPreview, LeaderState

MEMORY_S = 300.0
"""Time constant with which measured speeds are forgotten."""
FIRST_S = 1.0
"""Time that the first measurement stands for."""
BRAKING_DECAY_S, DRIVING_DECAY_S = 4.0, 2.0
"""Time constants with which a measured acceleration decays: braking as it is predicted best, an increase of
speed sooner, because a gap that was closed too soon costs more than one that is closed late."""
FARTHEST_S = 40.0
_ELAPSED_S: list[float] = [
    FARTHEST_S * (node / (EXTRAPOLATED_NODES - 1)) * (node / (EXTRAPOLATED_NODES - 1))
    for node in range(EXTRAPOLATED_NODES)
]


@dataclass(frozen=True)
class UsualSpeed:
    """Mean speed of a leader, exponentially weighted once it has been measured for long.

    Attributes:
        speed_m_s: mean.
        measured_s: time that it covers, 0 before the first measurement.
        until_s: trip time of the newest measurement.
    """

    speed_m_s: float = 0.0
    measured_s: float = 0.0
    until_s: float = 0.0

    def with_measured(self, leader: LeaderState) -> UsualSpeed:
        """Return the mean with a further measurement; an earlier one begins anew."""
        passed_s = leader.time_s - self.until_s
        if passed_s < 0.0 or self.measured_s == 0.0:
            return UsualSpeed(leader.speed_m_s, FIRST_S, leader.time_s)
        measured_s = min(self.measured_s + passed_s, MEMORY_S)
        share = min(passed_s / measured_s, 1.0)
        speed_m_s = self.speed_m_s + share * (leader.speed_m_s - self.speed_m_s)
        return UsualSpeed(speed_m_s, measured_s, leader.time_s)


def returning_motion(
    leader: LeaderState, acceleration_m_s2: float, usual_m_s: float, return_s: float
) -> LeaderPreview:
    """Return how a leader goes on whose acceleration dies away and whose speed returns to the usual one.

    Both do so exponentially. A leader that is slower than usual keeps the speed that it has, and none drives
    backwards.

    Args:
        acceleration_m_s2: as measured, negative when braking.
        return_s: time constant of the return.
    """
    decay_s = BRAKING_DECAY_S if acceleration_m_s2 < 0.0 else DRIVING_DECAY_S
    change_m_s, kept_m_s = decay_s * acceleration_m_s2, min(usual_m_s, leader.speed_m_s)
    positions_m, speeds_m_s = [leader.position_m], [leader.speed_m_s]
    moved_m = 0.0
    for before_s, elapsed_s in itertools.pairwise(_ELAPSED_S):
        driven_m_s = max(leader.speed_m_s - change_m_s * math.expm1(-elapsed_s / decay_s), 0.0)
        left = math.exp(-elapsed_s / return_s)
        speed_m_s = kept_m_s + (driven_m_s - kept_m_s) * left
        moved_m += 0.5 * (elapsed_s - before_s) * (speeds_m_s[-1] + speed_m_s)
        speeds_m_s.append(speed_m_s)
        positions_m.append(leader.position_m + moved_m)
    times_s = leader.time_s + np.array(_ELAPSED_S)
    return LeaderPreview(times_s, np.array(positions_m), np.array(speeds_m_s))
