"""What a car could have done at best with the brakes that it has.

A collision means little by itself: a leader may brake harder than the ego vehicle can. A full braking is
computed apart from plant, monitor and controller, behind a leader in the rows of a run, or for many ego
vehicles at once in small steps of time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from iptm_core.braking import SafetyMonitorSettings
from iptm_core.parameters.model import BrakeParameters, ModelParameters
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory

REACTION_S = SafetyMonitorSettings.monitor_reaction_s
"""Time from the row in which braking is decided to the request to the brakes."""
_FINE_STEP_S = 0.05
ANOTHER_LEADER_M = 3.0
"""Position jump, beyond the motion at its speed, from which a leader is another car."""


def seen_from(run: Trajectory, first: int) -> int:
    """Return the row before another one from which on the leader is seen to do what it does until then."""
    speeds, steps_m = run.leader_speed_m_s, np.diff(run.leader_position_m)
    foreseen_m = 0.5 * (speeds[1:] + speeds[:-1]) * run.intervals_s
    jumped = np.abs(steps_m - foreseen_m) > ANOTHER_LEADER_M
    row = first
    while row > 0 and speeds[row - 1] >= speeds[row] and not jumped[row - 1]:
        row -= 1
    if row > 0 and jumped[row - 1]:
        return row
    return min(row + 1, first - 1)


def gaps_when_braking(
    run: Trajectory,
    parameters: ModelParameters,
    start: int,
    last: int,
    reaction_s: float = REACTION_S,
    hardest_m_s2: float = math.inf,
) -> FloatArray:
    """Return the gaps of a vehicle that applies its service brakes from a row on.

    From its state in that row it goes on at its acceleration for a reaction time and the delay of its brakes;
    then the deceleration builds up to the largest one and stays there until standstill. The leader moves as
    it did; between two rows its motion is the cubic of positions and speeds.

    Args:
        hardest_m_s2: deceleration that the road permits, positive; limited by the brakes.

    Returns:
        Gaps in m of the rows from ``start`` to ``last``: each the smallest one since the row before.
    """
    brakes = parameters.brakes
    times = run.time_s[start : last + 1] - run.time_s[start]
    counts = np.ceil(np.diff(times) / _FINE_STEP_S).astype(int)
    pieces = [
        np.linspace(begin, end, count, endpoint=False)
        for begin, end, count in zip(times[:-1], times[1:], counts, strict=True)
    ]
    fine = np.concatenate([*pieces, times[-1:]])
    wait_s = reaction_s + brakes.delay_s
    present = float(run.acceleration_m_s2[start])
    built_up = np.maximum(
        present - brakes.build_up_m_s3 * np.maximum(fine - wait_s, 0.0),
        -max(min(brakes.max_deceleration_m_s2, hardest_m_s2), -present),
    )
    lengths = np.diff(fine)
    gained = np.concatenate(([0.0], np.cumsum(0.5 * (built_up[1:] + built_up[:-1]) * lengths)))
    speeds = np.maximum(float(run.speed_m_s[start]) + gained, 0.0)
    moved = np.concatenate(([0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * lengths)))
    gaps = _leader_positions_m(run, start, last, fine) - run.position_m[start] - moved
    # Row 0 of the result is the start; the others end what lies since the row before.
    ends = np.concatenate(([0], np.cumsum(counts)))
    smallest = [gaps[0], *(gaps[a + 1 : b + 1].min() for a, b in pairwise(ends))]
    return np.array(smallest)


def _leader_positions_m(run: Trajectory, start: int, last: int, times_s: FloatArray) -> FloatArray:
    """Return where the leader was at times since a row, by cubics between the rows."""
    rows = slice(start, last + 1)
    nodes = run.time_s[rows] - run.time_s[start]
    positions, speeds = run.leader_position_m[rows], run.leader_speed_m_s[rows]
    if start == last:
        return np.full(times_s.size, positions[0])
    index = np.clip(np.searchsorted(nodes, times_s, side="right") - 1, 0, nodes.size - 2)
    length = nodes[index + 1] - nodes[index]
    part = (times_s - nodes[index]) / length
    moved = positions[index + 1] - positions[index]
    first, second = speeds[index] * length, speeds[index + 1] * length
    found: FloatArray = positions[index] + part * (
        first + part * (3.0 * moved - 2.0 * first - second + part * (first + second - 2.0 * moved))
    )
    return found


STEP_S = 0.01
LONGEST_S = 60.0

LeadPositions = Callable[[float], FloatArray]
"""From the time in s since the beginning to positions of the lead vehicles, shape (n,)."""


def emergency_stops(
    lead_m: LeadPositions,
    positions_m: FloatArray,
    speeds_m_s: FloatArray,
    accelerations_m_s2: FloatArray,
    brakes: BrakeParameters,
    reaction_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Return smallest gap and speed of impact of ego vehicles that brake as hard as they can.

    Args:
        lead_m: rear bumpers of the lead vehicles.
        positions_m: front bumpers of the ego vehicles at the beginning, shape (n,), as all arrays.
        speeds_m_s: of the ego vehicles.
        accelerations_m_s2: theirs, which last until they brake.
        brakes: of the ego vehicles.
        reaction_s: time from the deceleration of the lead vehicle to the request to the brakes (sampling of
            the sensor).

    Returns:
        Smallest gaps in m up to standstill, negative for an overlap; speed differences in m/s when the gap
        closes, 0 where it does not. Shapes (n,).
    """
    position, speed = positions_m.astype(float), speeds_m_s.astype(float)
    acceleration = accelerations_m_s2.astype(float)
    lead = lead_m(0.0)
    gap = lead - position
    smallest, impact = gap.copy(), np.zeros(gap.shape)
    for step in range(1, round(LONGEST_S / STEP_S) + 1):
        if (step - 1) * STEP_S >= reaction_s + brakes.delay_s - 1e-9:
            acceleration = np.maximum(
                acceleration - brakes.build_up_m_s3 * STEP_S, -brakes.max_deceleration_m_s2
            )
        ahead = np.maximum(speed + acceleration * STEP_S, 0.0)
        position = position + 0.5 * (speed + ahead) * STEP_S
        lead_ahead = lead_m(step * STEP_S)
        gap_ahead = lead_ahead - position
        touched = (gap > 0.0) & (gap_ahead <= 0.0)
        impact[touched] = np.maximum(ahead - (lead_ahead - lead) / STEP_S, 0.0)[touched]
        gap, speed, lead = gap_ahead, ahead, lead_ahead
        np.minimum(smallest, gap, out=smallest)
        if not speed.any():
            break
    return smallest, impact


def braking_leads(
    positions_m: FloatArray, speeds_m_s: FloatArray, decelerations_m_s2: FloatArray
) -> LeadPositions:
    """Return lead vehicles that brake to a standstill from now on; arrays of shape (n,)."""
    halts_s = speeds_m_s / decelerations_m_s2

    def lead_m(elapsed_s: float) -> FloatArray:
        moving_s = np.minimum(elapsed_s, halts_s)
        moved_m: FloatArray = moving_s * (speeds_m_s - 0.5 * decelerations_m_s2 * moving_s)
        return positions_m + moved_m

    return lead_m
