"""Actuator response to a command, and the resulting motion over one interval.

The plant is the last to touch a command. Whatever a controller sends, the values actuated here lie inside
the bounds of the paper's Table I and change no faster than it permits; every correction is reported.

Speed and position follow in closed form (paper eq. 1), before any power is integrated. The interval is cut
where the vehicle comes to rest or reaches its top speed, so that no sub-step straddles that kink in time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

import numpy as np

from iptm_core.parameters.model import LimitParameters
from iptm_core.physics.car_following import controlled_stop_command
from iptm_core.state import Command, CommandSource, FloatArray, VehicleState

ACCELERATION_RESOLUTION_M_S2 = 1e-9
COMPRESSOR_RESOLUTION_W = 1e-6
"""Corrections below these are rounding, not clamping: they are applied but not reported."""


class Clamp(Enum):
    """Why an actuated value differs from the commanded one."""

    NON_FINITE = "non_finite_command"
    ACCELERATION_BOUND = "acceleration_bound"
    JERK = "jerk"
    COMPRESSOR_BOUND = "compressor_bound"
    COMPRESSOR_RATE = "compressor_rate"
    TOP_SPEED = "top_speed"
    PACK_POWER = "pack_power"


@dataclass(frozen=True)
class ActuatorReport:
    """One command and what became of it.

    Attributes:
        clamps: every limit that changed it, in the order applied; empty if none did.
    """

    requested: Command
    actuated: Command
    clamps: tuple[Clamp, ...] = ()

    @property
    def source(self) -> float:
        """Number of the `CommandSource`: whether the command could be carried out."""
        broken = Clamp.NON_FINITE in self.clamps
        return float(CommandSource.STOP if broken else CommandSource.ANSWER)

    @property
    def reason(self) -> str:
        """One readable line: which limits changed the command and from what to what; empty if none."""
        if not self.clamps:
            return ""
        names = ", ".join(clamp.value for clamp in self.clamps)
        asked, done = self.requested, self.actuated
        return (
            f"{names}: acceleration {asked.acceleration_m_s2:.4g} -> {done.acceleration_m_s2:.4g} "
            f"m/s^2, compressor {asked.compressor_power_w:.5g} -> {done.compressor_power_w:.5g} W"
        )


def limit_command(
    command: Command,
    state: VehicleState,
    limits: LimitParameters,
    duration_s: float,
    last_acceleration_m_s2: float | None = None,
) -> ActuatorReport:
    """Bring a command inside bounds and rates, relative to the values last actuated.

    A command with a NaN or an infinity in either value is one decision gone wrong and is replaced as a
    whole by the controlled stop.

    Args:
        state: present state; its inputs are the values last actuated.
        duration_s: length of the interval over which the command will be held; the rates scale with it.
        last_acceleration_m_s2: acceleration last requested where that is not the one of the state.
    """
    clamps: list[Clamp] = []
    # After service braking the deceleration lies outside the comfort limits; a command starts at their edge.
    last_m_s2 = (
        state.acceleration_m_s2 if last_acceleration_m_s2 is None else last_acceleration_m_s2
    )
    last_m_s2 = max(last_m_s2, limits.min_acceleration_m_s2)
    wanted = command
    if not (math.isfinite(command.acceleration_m_s2) and math.isfinite(command.compressor_power_w)):
        clamps.append(Clamp.NON_FINITE)
        wanted = controlled_stop_command(state, limits, duration_s)

    acceleration = _limit(
        wanted.acceleration_m_s2,
        (limits.min_acceleration_m_s2, limits.max_acceleration_m_s2),
        (last_m_s2, limits.max_jerk_m_s3 * duration_s),
        (Clamp.ACCELERATION_BOUND, Clamp.JERK),
        ACCELERATION_RESOLUTION_M_S2,
        clamps,
    )
    compressor = _limit(
        wanted.compressor_power_w,
        (limits.lowest_thermal_power_w, limits.max_compressor_power_w),
        (state.compressor_power_w, limits.max_compressor_rate_w_s * duration_s),
        (Clamp.COMPRESSOR_BOUND, Clamp.COMPRESSOR_RATE),
        COMPRESSOR_RESOLUTION_W,
        clamps,
    )
    return ActuatorReport(command, Command(acceleration, compressor), tuple(clamps))


def _limit(
    value: float,
    bounds: tuple[float, float],
    last_and_step: tuple[float, float],
    kinds: tuple[Clamp, Clamp],
    resolution: float,
    clamps: list[Clamp],
) -> float:
    """Clip to the bounds, then to the reachable range around the last value; note which limit acted."""
    low, high = bounds
    last, step = last_and_step
    bounded = min(max(value, low), high)
    if abs(bounded - value) > resolution:
        clamps.append(kinds[0])
    reachable = min(max(bounded, last - step), last + step)
    if abs(reachable - bounded) > resolution:
        clamps.append(kinds[1])
    # A last value outside the bounds (limits changed between runs) may not pull the result out.
    return float(min(max(reachable, low), high))


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
    """Speeds (count, 3) and positions (2 count + 1,) over a stretch of constant acceleration."""
    times, by_sub_step = _stage_times_s(duration_s, count)
    speeds = speed_m_s + acceleration_m_s2 * by_sub_step
    positions = position_m + times * (speed_m_s + 0.5 * acceleration_m_s2 * times)
    return speeds, positions


@lru_cache(maxsize=64)
def _stage_times_s(duration_s: float, count: int) -> tuple[FloatArray, FloatArray]:
    """Times of the stages in order, and start, middle and end of each sub-step."""
    times: FloatArray = np.linspace(0.0, duration_s, 2 * count + 1, dtype=np.float64)
    return times, np.column_stack([times[:-1].reshape(-1, 2), times[2::2]])


@lru_cache(maxsize=64)
def _equal_lengths_s(duration_s: float, count: int) -> FloatArray:
    return np.full(count, duration_s / count)


def _uniform(
    position_m: float, speed_m_s: float, acceleration_m_s2: float, duration_s: float, count: int
) -> Motion:
    speeds, positions = _stages(position_m, speed_m_s, acceleration_m_s2, duration_s, count)
    accelerations: FloatArray = np.empty(count)
    accelerations.fill(acceleration_m_s2)
    return Motion(
        _equal_lengths_s(duration_s, count),
        accelerations,
        speeds,
        positions,
        positions.item(-1),
        speeds.item(-1),
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
        np.concatenate((speeds, held)),
        np.concatenate((positions, further[1:])),
        float(further[-1]),
        reached_m_s,
        0.0,
        top_speed_reached=reached_m_s > 0.0,
    )
