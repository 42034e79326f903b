"""The motion over one interval: constant acceleration until the vehicle stops or meets its top speed.

Given the command, speed and position follow in closed form (paper eq. 1), before any power is
integrated. The interval is cut where the vehicle comes to rest or reaches its top speed, so that no
sub-step straddles that kink in time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from iptm_core.state import FloatArray

STANDSTILL_SPEED_M_S = 1e-3
STANDSTILL_ACCELERATION_M_S2 = 1e-3
"""Speed and acceleration below which the brakes hold; otherwise the motor would hold a vehicle on a slope
when the optimiser's zero is not exact."""

_ROLLING_M_S = 1e-12
"""Stands for the limit v -> 0 from above: the last instant before the brakes take over."""


@dataclass(frozen=True)
class Motion:
    """Speed, acceleration and position at the stages of ``n`` sub-steps.

    Attributes:
        lengths_s: sub-step lengths, shape (n,), their sum is the interval.
        accelerations_m_s2: acceleration during each sub-step, shape (n,).
        speeds_m_s: speeds at start, middle and end of each sub-step, shape (n, 3). One-sided limits: at
            the stop the end of one sub-step still rolls, the start of the next stands.
        positions_m: positions at the starts and middles in order and at the end, shape (2 n + 1,).
        end_speed_m_s: speed at the end, exactly 0 at standstill.
        end_acceleration_m_s2: acceleration at the end; 0 once stopped or held at the top speed.
        top_speed_reached: the top speed cut the acceleration.
    """

    lengths_s: FloatArray
    accelerations_m_s2: FloatArray
    speeds_m_s: FloatArray
    positions_m: FloatArray
    end_position_m: float
    end_speed_m_s: float
    end_acceleration_m_s2: float
    top_speed_reached: bool = False


def plan_motion(
    position_m: float,
    speed_m_s: float,
    acceleration_m_s2: float,
    top_speed_m_s: float,
    duration_s: float,
    sub_steps: int,
) -> Motion:
    """Lay out the motion of one interval.

    Args:
        position_m: position at the start.
        speed_m_s: speed at the start, within [0, top_speed_m_s].
        top_speed_m_s: speed at which the drive holds instead of accelerating further.
        sub_steps: number of sub-steps n, at least 2.
    """
    end_speed = speed_m_s + acceleration_m_s2 * duration_s
    standing = speed_m_s < STANDSTILL_SPEED_M_S
    if standing and acceleration_m_s2 < STANDSTILL_ACCELERATION_M_S2:
        return _uniform(position_m, 0.0, 0.0, duration_s, sub_steps)
    if end_speed <= 0.0:
        return _cut(position_m, speed_m_s, acceleration_m_s2, 0.0, duration_s, sub_steps)
    if end_speed > top_speed_m_s and acceleration_m_s2 > 0.0:
        return _cut(position_m, speed_m_s, acceleration_m_s2, top_speed_m_s, duration_s, sub_steps)
    return _uniform(position_m, speed_m_s, acceleration_m_s2, duration_s, sub_steps)


def _stages(
    position_m: float, speed_m_s: float, acceleration_m_s2: float, duration_s: float, count: int
) -> tuple[FloatArray, FloatArray]:
    """Speeds (2 count + 1,) and positions (2 count + 1,) over a stretch of constant acceleration."""
    times = np.linspace(0.0, duration_s, 2 * count + 1, dtype=np.float64)
    speeds = speed_m_s + acceleration_m_s2 * times
    positions = position_m + times * (speed_m_s + 0.5 * acceleration_m_s2 * times)
    return speeds, positions


def _by_sub_step(nodes: FloatArray) -> FloatArray:
    """Start, middle and end of each sub-step, shape (n, 3), from the (2 n + 1,) nodes."""
    return np.column_stack((nodes[:-1:2], nodes[1::2], nodes[2::2]))


def _uniform(
    position_m: float, speed_m_s: float, acceleration_m_s2: float, duration_s: float, count: int
) -> Motion:
    speeds, positions = _stages(position_m, speed_m_s, acceleration_m_s2, duration_s, count)
    return Motion(
        np.full(count, duration_s / count),
        np.full(count, acceleration_m_s2),
        _by_sub_step(speeds),
        positions,
        float(positions[-1]),
        float(speeds[-1]),
        acceleration_m_s2,
    )


def _cut(
    position_m: float,
    speed_m_s: float,
    acceleration_m_s2: float,
    reached_m_s: float,
    duration_s: float,
    count: int,
) -> Motion:
    """Accelerate until ``reached_m_s``, then keep it without acceleration for the rest."""
    until_s = min((reached_m_s - speed_m_s) / acceleration_m_s2, duration_s)
    before = min(max(math.ceil(count * until_s / duration_s), 1), count - 1)
    after = count - before
    rest_s = duration_s - until_s
    speeds, positions = _stages(position_m, speed_m_s, acceleration_m_s2, until_s, before)
    if reached_m_s == 0.0:
        speeds = np.maximum(speeds, _ROLLING_M_S)
    held, further = _stages(float(positions[-1]), reached_m_s, 0.0, rest_s, after)
    return Motion(
        np.concatenate((np.full(before, until_s / before), np.full(after, rest_s / after))),
        np.concatenate((np.full(before, acceleration_m_s2), np.zeros(after))),
        np.concatenate((_by_sub_step(speeds), _by_sub_step(held))),
        np.concatenate((positions, further[1:])),
        float(further[-1]),
        reached_m_s,
        0.0,
        top_speed_reached=reached_m_s > 0.0,
    )
