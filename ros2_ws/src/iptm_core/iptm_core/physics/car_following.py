"""Permitted gaps, what is left of them when both vehicles brake, and the controlled stop.

Gaps and reserve are written on ``ops`` like all physics: the safe driving law evaluates them, the optimal
control problem differentiates them.
"""

from __future__ import annotations

import math

from iptm_core.braking import SLIPPERY_LEAD_SHARE, SafetyMonitorSettings
from iptm_core.declaration import has_effect
from iptm_core.parameters.model import BrakeParameters, GapParameters, LimitParameters
from iptm_core.physics.ops import Scalar, maximum, minimum, sqrt
from iptm_core.state import Command, VehicleState


def minimum_gap_m(
    speed_m_s: Scalar, leader_speed_m_s: Scalar, gap: GapParameters, limits: LimitParameters
) -> Scalar:
    """Desired minimum gap s_min as printed in the paper (unnumbered equation below eq. 16).

    ``s_st + v T_h + v (v - v_PV) / (2 sqrt(-a_min a_max))``. The last term is negative while the leader
    pulls away, so the value may fall below the standstill gap.
    """
    braking = 2.0 * sqrt(-limits.min_acceleration_m_s2 * limits.max_acceleration_m_s2)
    approach = speed_m_s * (speed_m_s - leader_speed_m_s) / braking
    return gap.standstill_gap_m + speed_m_s * gap.time_headway_s + approach


def maximum_gap_m(speed_m_s: Scalar, gap: GapParameters, *, smoothing_m: float = 0.0) -> Scalar:
    """Largest permitted gap s_max; with a largest time headway no more than that, but the initial gap.

    Args:
        smoothing_m: width of the smoothed bounds; 0 is exact.

    Returns:
        Gap in m: the paper's constant without a largest time headway.
    """
    if not has_effect(gap.max_time_headway_s):
        return gap.max_gap_m
    by_headway = maximum(gap.max_time_headway_s * speed_m_s, gap.initial_gap_m, smoothing_m)
    return minimum(by_headway, gap.max_gap_m, smoothing_m)


def desired_gap_m(speed_m_s: Scalar, gap: GapParameters) -> Scalar:
    """Gap ``s_st + T_d v`` that plans are drawn to, the constant-time-gap policy of cruise controls.

    It is a price, not a limit: the gap may swing around it, which smooths the motion without more road on
    average. It is not part of the paper.
    """
    return gap.standstill_gap_m + gap.desired_time_headway_s * speed_m_s


LEADER_SURPRISE_M_S = 2.2
"""Speed that a leader may lose on top of braking as hard as the ego can. Drivers brake harder than that,
but not for long: no published cycle that the project carries loses more than 2.16 m/s this way (US06).
A leader that brakes harder without end could only be followed at gaps beyond s_max."""
SPEED_SMOOTHING_M_S = 0.5
RESERVE_SMOOTHING_M = 0.5


def brake_build_up(
    speed_m_s: Scalar, acceleration_m_s2: Scalar, limits: LimitParameters
) -> tuple[Scalar, Scalar, Scalar]:
    """Motion while the acceleration, not below its lower bound, falls to it at the largest jerk.

    Returns:
        How long that takes in s, the distance in m, and the speed at its end in m/s. The latter is negative
        if the vehicle halts before; the distance then follows the same parabola, short of the halt by
        less than 1.4 m from steady driving.
    """
    jerk = limits.max_jerk_m_s3
    duration = (acceleration_m_s2 - limits.min_acceleration_m_s2) / jerk
    end_speed = speed_m_s + duration * (acceleration_m_s2 - 0.5 * jerk * duration)
    distance = duration * (speed_m_s + duration * (0.5 * acceleration_m_s2 - jerk * duration / 6.0))
    return duration, distance, end_speed


def stopping_distance_m(
    speed_m_s: Scalar, acceleration_m_s2: Scalar, limits: LimitParameters
) -> Scalar:
    """Distance to standstill, build-up included; too short by up to 1.4 m for a halt during the build-up."""
    _, distance_m, end_speed_m_s = brake_build_up(speed_m_s, acceleration_m_s2, limits)
    return distance_m + halting_distance_m(end_speed_m_s, limits)


def halting_distance_m(speed_m_s: Scalar, limits: LimitParameters) -> Scalar:
    """Distance to standstill at the hardest deceleration, in m."""
    return speed_m_s * speed_m_s / (-2.0 * limits.min_acceleration_m_s2)


def braking_reserve_m(
    gap_m: Scalar,
    speed_m_s: Scalar,
    acceleration_m_s2: Scalar,
    leader_speed_m_s: Scalar,
    gap: GapParameters,
    limits: LimitParameters,
) -> Scalar:
    """Smallest excess of the gap over s_min if both vehicles now brake as hard as they can.

    The leader is assumed to lose ``LEADER_SURPRISE_M_S`` at once and then to brake at the ego vehicle's own
    hardest deceleration down to standstill; the ego vehicle builds its braking up within the jerk limit. Once
    that is done the excess is linear in time until the leader stands, and grows afterwards. The reserve is
    the smaller one of the values at these two instants; the present excess is another limit's matter.

    As long as it is not negative, s_min can be kept behind every leader that brakes no harder than
    assumed. It is not part of the paper.

    Args:
        leader_speed_m_s: leader speed, not negative.

    Returns:
        Reserve in m, negative where s_min can no longer be kept; a smooth function. It lies at most 0.3 m
        below the exact smallest excess ahead. It lies above it, by up to 5 m, where that excess is reached
        while the brakes build up: behind a much faster leader, or where the ego vehicle halts meanwhile.
    """
    deceleration = -limits.min_acceleration_m_s2
    duration, distance, end_speed = brake_build_up(speed_m_s, acceleration_m_s2, limits)
    leader_start = maximum(leader_speed_m_s - LEADER_SURPRISE_M_S, 0.0, SPEED_SMOOTHING_M_S)
    leader_end = maximum(leader_start - deceleration * duration, 0.0, SPEED_SMOOTHING_M_S)
    leader_stop = halting_distance_m(leader_start, limits)
    leader_moved = leader_stop - halting_distance_m(leader_end, limits)
    at_build_up = gap_m + leader_moved - distance
    at_build_up = at_build_up - minimum_gap_m(end_speed, leader_end, gap, limits)
    # Both decelerate alike from here on, so the difference of their speeds is what the ego vehicle still has.
    rest_speed = maximum(end_speed - leader_end, 0.0, SPEED_SMOOTHING_M_S)
    ego_moved = distance + halting_distance_m(end_speed, limits)
    ego_moved = ego_moved - halting_distance_m(rest_speed, limits)
    at_stop = gap_m + leader_stop - ego_moved - minimum_gap_m(rest_speed, 0.0, gap, limits)
    return -maximum(-at_build_up, -at_stop, RESERVE_SMOOTHING_M)


EMERGENCY_MARGIN_M = 2.0
"""Gap that is left when both vehicles stand: a metre more than the safety monitor asks for by default."""


def emergency_reserve_m(
    gap_m: Scalar, speed_m_s: Scalar, leader_speed_m_s: Scalar, brakes: BrakeParameters
) -> Scalar:
    """Part of the gap that is not needed to stop with the service brakes if the leader brakes fully now.

    The rule of the safety monitor (RSS, arXiv:1708.06374, definition 1) with its default assumptions, on a
    dry road and on a slippery one, the present speed kept until the brakes act. Unlike `braking_reserve_m` it
    does not ask for comfort, which leaves room for the headways of traffic. It is not part of the paper.

    Returns:
        Reserve in m on the worse road, negative where the monitor would soon have to brake.
    """
    assumed = SafetyMonitorSettings
    slippery_m_s2 = assumed.monitor_slippery_deceleration_m_s2
    roads = (
        (assumed.monitor_own_deceleration_m_s2, assumed.monitor_lead_deceleration_m_s2),
        (slippery_m_s2, SLIPPERY_LEAD_SHARE * slippery_m_s2),
    )

    def missing_m(own_m_s2: Scalar, lead_m_s2: float) -> Scalar:
        own_m_s2 = minimum(own_m_s2, brakes.max_deceleration_m_s2)
        # Brakes that build up for a time act like full ones from the middle of it.
        wait_s = assumed.monitor_reaction_s + brakes.delay_s + 0.5 * own_m_s2 / brakes.build_up_m_s3
        stops_m = wait_s * speed_m_s + speed_m_s * speed_m_s / (2.0 * own_m_s2)
        return stops_m - leader_speed_m_s * leader_speed_m_s / (2.0 * lead_m_s2)

    dry_m, wet_m = (missing_m(*road) for road in roads)
    return gap_m - EMERGENCY_MARGIN_M - maximum(dry_m, wet_m, RESERVE_SMOOTHING_M)


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
        deceleration_m_s2: comfortable deceleration, positive; cut to what the limits permit.
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
