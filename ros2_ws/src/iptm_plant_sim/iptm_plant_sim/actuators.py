"""What the actuators make of a command: bounds, rates and the refusal of nonsense.

The plant is the last to touch a command. Whatever a controller sends, the values actuated here lie inside
the bounds of the paper's Table I and change no faster than it permits; every correction is reported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from iptm_core.parameters.model import LimitParameters
from iptm_core.physics.car_following import controlled_stop_command
from iptm_core.state import Command, CommandSource, VehicleState

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
    def source(self) -> CommandSource:
        """Whether the command could be carried out."""
        broken = Clamp.NON_FINITE in self.clamps
        return CommandSource.STOP if broken else CommandSource.ANSWER

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
