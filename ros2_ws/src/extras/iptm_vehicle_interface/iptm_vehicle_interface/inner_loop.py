"""Between two decisions: the plan is followed at 50 Hz, corrected by what is measured meanwhile.

A decision holds an acceleration for a whole tick; passengers would feel each step. Here the accelerations of
the plan are interpolated between the middles of its steps, which keeps its speeds, and never change faster
than passengers accept. The newest range measurement corrects: a vehicle ahead that is nearer or slower than
it was at the decision is met before the next one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from iptm_core.state import Command, FloatArray, LeaderState

LARGEST_JERK_M_S3 = 2.0
SPEED_GAIN_1_S = 0.5
LEAD_SPEED_GAIN_1_S = 0.5
GAP_GAIN_1_S2 = 0.1
LARGEST_CORRECTION_M_S2 = 3.0
"""Towards braking; towards acceleration nothing is added, the next decision may."""
LONGEST_FOLLOWED_S = 3.0
"""Age of a plan from which it is not followed any more."""


@dataclass(frozen=True)
class Followed:
    """What is followed.

    Attributes:
        made_s: time of the decision.
        times_s: of the accelerations, shape (n,).
        accelerations_m_s2: shape (n,).
        node_times_s: of the speeds, shape (m,).
        speeds_m_s: planned, shape (m,).
        leader: vehicle ahead at the decision; None for none.
        compressor_power_w: requested until the next decision.
    """

    made_s: float
    times_s: FloatArray
    accelerations_m_s2: FloatArray
    node_times_s: FloatArray
    speeds_m_s: FloatArray
    leader: LeaderState | None
    compressor_power_w: float


def followed(
    made_s: float,
    plan: Sequence[FloatArray],
    command: Command,
    speed_m_s: float,
    leader: LeaderState | None,
) -> Followed:
    """Return what is followed from a decision on: its plan, or its command where there is none.

    Args:
        made_s: time of the decision, on the clock of the inner loop.
        plan: times of the nodes on the same clock, speeds there, and accelerations from there on, shape (n,)
            each, of which the last is not used; n = 0 for no plan.
        command: what the limiter made of the first step.
        speed_m_s: at the decision.
        leader: vehicle ahead at the decision; None for none.
    """
    nodes, speeds, accelerations = plan
    if nodes.size < 2:
        nodes = made_s + np.array([0.0, LONGEST_FOLLOWED_S])
        speeds = speed_m_s + command.acceleration_m_s2 * (nodes - made_s)
        accelerations = np.zeros(2)
    held = accelerations[:-1].copy()
    held[0] = command.acceleration_m_s2
    return Followed(
        made_s,
        0.5 * (nodes[1:] + nodes[:-1]),
        held,
        nodes,
        np.maximum(speeds, 0.0),
        leader,
        command.compressor_power_w,
    )


def wanted_acceleration_m_s2(
    target: Followed,
    now_s: float,
    speed_m_s: float,
    leader: LeaderState | None,
    last_m_s2: float,
    since_last_s: float,
    reaction_s: float = 0.0,
) -> float:
    """Return the acceleration of an instant, within the jerk that passengers accept.

    Args:
        leader: vehicle ahead now; None for none.
        last_m_s2: acceleration requested before.
        since_last_s: time since then.
        reaction_s: time until the vehicle follows a request, by which the plan is asked for earlier.
    """
    planned = float(np.interp(now_s + reaction_s, target.times_s, target.accelerations_m_s2))
    planned_speed = float(np.interp(now_s, target.node_times_s, target.speeds_m_s))
    wanted = planned + SPEED_GAIN_1_S * (planned_speed - speed_m_s)
    if leader is not None and target.leader is not None:
        expected = target.leader
        slower = leader.speed_m_s - expected.speed_m_s
        nearer = leader.position_m - (
            expected.position_m + expected.speed_m_s * (now_s - target.made_s)
        )
        correction = LEAD_SPEED_GAIN_1_S * min(slower, 0.0) + GAP_GAIN_1_S2 * min(nearer, 0.0)
        wanted += max(correction, -LARGEST_CORRECTION_M_S2)
    reach = LARGEST_JERK_M_S3 * since_last_s
    return min(max(wanted, last_m_s2 - reach), last_m_s2 + reach)
