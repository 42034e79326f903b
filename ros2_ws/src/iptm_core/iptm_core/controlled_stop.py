"""The controlled stop: the one braking law of plant and controller when there is nothing better."""

from __future__ import annotations

import math

from iptm_core.parameters.model import LimitParameters
from iptm_core.state import Command, VehicleState

COMFORTABLE_DECELERATION_M_S2 = 1.0


def controlled_stop_command(
    state: VehicleState,
    limits: LimitParameters,
    duration_s: float = 1.0,
    deceleration_m_s2: float = COMFORTABLE_DECELERATION_M_S2,
) -> Command:
    """Next command of a comfortable stop with compressor and heater run down.

    The deceleration builds up within the jerk limit, stays at the comfortable value and fades out so that
    the vehicle comes to rest without a jolt. The compressor ramps to its lower bound, a heater to it
    from below. Applied interval after interval this brings the vehicle to standstill from any state.

    Args:
        state: present state; its inputs are the values last actuated.
        limits: bounds and rates.
        duration_s: time for which the command will be held.
        deceleration_m_s2: comfortable deceleration, positive; cut to what the limits permit.

    Returns:
        A command inside all bounds and rates.
    """
    jerk_step = limits.max_jerk_m_s3 * duration_s
    # Reduced by one jerk step per interval from here on, the deceleration ends together with the speed.
    fading = math.sqrt(0.25 * jerk_step**2 + 2.0 * limits.max_jerk_m_s3 * state.speed_m_s)
    fading -= 0.5 * jerk_step
    wanted = max(-deceleration_m_s2, -fading, limits.min_acceleration_m_s2)
    # After service braking the measured deceleration lies outside the comfort limits.
    last = max(state.acceleration_m_s2, limits.min_acceleration_m_s2)
    acceleration = min(max(wanted, last - jerk_step), last + jerk_step)
    power_step = limits.max_compressor_rate_w_s * duration_s
    last_w = state.compressor_power_w
    compressor = min(max(limits.min_compressor_power_w, last_w - power_step), last_w + power_step)
    return Command(float(acceleration), float(compressor))
