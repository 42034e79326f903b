"""The last limiter: physical bounds and rates of the command, independent of the solver.

Whatever the ladder decides passes through here. A command that is not finite becomes the gentlest safe
one: coast down within the jerk limit, compressor power held.
"""

from __future__ import annotations

import math

from iptm_core.parameters.model import LimitParameters
from iptm_core.state import Command, VehicleState

TOLERANCE = 1e-6


class CommandLimiter:
    """Clamps acceleration, jerk, speed, compressor power and its rate."""

    def __init__(self, limits: LimitParameters, tick_s: float) -> None:
        self._limits = limits
        self._power_range_w = limits.lowest_thermal_power_w, limits.max_compressor_power_w
        self._tick_s = tick_s

    def limit(self, command: Command, state: VehicleState) -> tuple[Command, tuple[str, ...]]:
        """Limit a command relative to what is actuated now (``state``).

        Returns:
            The command within all bounds, and the bounds that changed it by more than round-off.
        """
        limits, tick_s = self._limits, self._tick_s
        low_w, high_w = self._power_range_w
        reasons: list[str] = []
        acceleration = command.acceleration_m_s2
        power = command.compressor_power_w
        last_acceleration = min(
            max(state.acceleration_m_s2, limits.min_acceleration_m_s2), limits.max_acceleration_m_s2
        )
        last_power = min(max(state.compressor_power_w, low_w), high_w)
        if not math.isfinite(acceleration):
            acceleration = min(last_acceleration, 0.0)
            reasons.append("acceleration not finite")
        if not math.isfinite(power):
            power = last_power
            reasons.append("compressor power not finite")
        jerk_step = limits.max_jerk_m_s3 * tick_s
        rate_step = limits.max_compressor_rate_w_s * tick_s
        # Bounds first, rates last: the rate limits are what the actuators cannot exceed.
        top_speed_acceleration = max(
            (limits.max_speed_m_s - state.speed_m_s) / tick_s, limits.min_acceleration_m_s2
        )
        steps = (
            ("acceleration bound", limits.min_acceleration_m_s2, limits.max_acceleration_m_s2),
            ("top speed", -math.inf, top_speed_acceleration),
            ("jerk", last_acceleration - jerk_step, last_acceleration + jerk_step),
        )
        for label, low, high in steps:
            acceleration = _clamp(acceleration, low, high, label, reasons, TOLERANCE)
        power_steps = (
            ("compressor power bound", low_w, high_w),
            ("compressor rate", last_power - rate_step, last_power + rate_step),
        )
        for label, low, high in power_steps:
            power = _clamp(power, low, high, label, reasons, TOLERANCE * 1000.0)
        return Command(acceleration, power), tuple(reasons)


def _clamp(
    value: float, low: float, high: float, label: str, reasons: list[str], tolerance: float
) -> float:
    clamped = min(max(value, low), high)
    if abs(clamped - value) > tolerance:
        reasons.append(label)
    return clamped
