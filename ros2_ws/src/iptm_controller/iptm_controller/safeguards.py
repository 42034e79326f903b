"""Last checks of a command, independent of the solver: physical bounds and rates, and the collision guard.

Whatever the ladder decides passes through the limiter. A command that is not finite becomes the gentlest
safe one: coast down within the jerk limit, compressor power held.

The optimiser trades limits against each other and relies on the preview, and a plan of an earlier tick does
not account for what has happened since. The guard uses the measured state alone: if the command is carried
out for a tick and the brakes are applied in full afterwards, is the leader touched? It is not part of the
paper.
"""

from __future__ import annotations

import ctypes
import math

import numpy as np

from iptm_controller.forecast import NEAR_S, LeaderForecast
from iptm_controller.plan_data import motion_of
from iptm_core.frozen import replace
from iptm_core.parameters.model import LimitParameters
from iptm_core.physics.ops import doubles
from iptm_core.state import ROUNDING_S, Command, FloatArray, LeaderState, VehicleState

TOLERANCE, POWER_TOLERANCE_W = 1e-6, 1e-3
"""Changes of an acceleration (m/s^2) and of a power that are round-off."""


class CommandLimiter:
    """Clamps acceleration, jerk, speed, compressor power and its rate."""

    def __init__(self, limits: LimitParameters, tick_s: float) -> None:
        self._limits = limits
        self._power_range_w = limits.lowest_thermal_power_w, limits.max_compressor_power_w
        self._tick_s = tick_s

    def within_comfort(self, state: VehicleState) -> VehicleState:
        """Return a state whose acceleration ordinary commands can follow; service brakes go beyond."""
        limits, own = self._limits, state.acceleration_m_s2
        clipped = min(max(own, limits.min_acceleration_m_s2), limits.max_acceleration_m_s2)
        return state if clipped == own else replace(state, acceleration_m_s2=clipped)

    def limit(self, command: Command, state: VehicleState) -> tuple[Command, tuple[str, ...]]:
        """Limit a command relative to the actuated one (``state``).

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
            wanted, acceleration = acceleration, min(max(acceleration, low), high)
            if abs(acceleration - wanted) > TOLERANCE:
                reasons.append(label)
        power_steps = (
            ("compressor power bound", low_w, high_w),
            ("compressor rate", last_power - rate_step, last_power + rate_step),
        )
        for label, low, high in power_steps:
            wanted, power = power, min(max(power, low), high)
            if abs(power - wanted) > POWER_TOLERANCE_W:
                reasons.append(label)
        return Command(acceleration, power), tuple(reasons)


MARGIN_M = 1.0
"""Smallest permitted gap: margin for errors of range and prediction within a tick."""
CONFIRMED_SPEED_ERROR_M_S = 1.0
"""Largest speed deficit of the leader, against its preview, at which the preview is used."""
ROUNDING_M = 1e-6
"""A gap that becomes smaller by less does not change."""
CHECKS_PER_TICK = 4
EMERGENCY = "a collision threatens, hardest braking"


class CollisionGuard:
    """Tracks the motion of the leader and compares commands with what the brakes allow.

    The leader is assumed to keep the last measured deceleration; with a preview confirmed by measurements to
    move as predicted, and from its end on to keep the deceleration of then. So a preview asks for more
    braking than none only where it announces some. A leader that has not been measured for long is assumed
    to have braked at least as hard as the ego vehicle can.

    Attributes:
        leader: lead vehicle measured last.
        deceleration_m_s2: how hard it braked, not negative.
        lost_ticks: ticks without it since.
    """

    def __init__(
        self,
        limits: LimitParameters,
        tick_s: float,
        lost_after_ticks: int,
        library: ctypes.PyDLL | None = None,
    ) -> None:
        """Set up a guard that has not seen a leader.

        Args:
            lost_after_ticks: ticks without a measured leader for which it is taken to go on as it did.
            library: works the same out in C.
        """
        self._library = library
        self._guarded, self._write = doubles(9)
        self._limits = limits
        self._tick_s = tick_s
        self._lost_after_ticks = lost_after_ticks
        self._forget()

    def _forget(self) -> None:
        self.leader: LeaderState | None = None
        self.deceleration_m_s2 = 0.0
        self.lost_ticks = 0

    def observe(self, leader: LeaderState | None, *, is_free: bool = False) -> None:
        """Note the leader of a tick, None if it is not measured or, on a free road, not there."""
        if is_free:
            self._forget()
            return
        if leader is None:
            self.lost_ticks += 1
            if self.lost_ticks > self._lost_after_ticks:
                hardest_m_s2 = -self._limits.min_acceleration_m_s2
                self.deceleration_m_s2 = max(self.deceleration_m_s2, hardest_m_s2)
            return
        last = self.leader
        self._forget()
        self.leader = leader
        if last is not None and 0.0 < leader.time_s - last.time_s < 2.5 * self._tick_s:
            lost_m_s = last.speed_m_s - leader.speed_m_s
            self.deceleration_m_s2 = max(lost_m_s / (leader.time_s - last.time_s), 0.0)

    def collision_threatens(
        self,
        acceleration_m_s2: float,
        state: VehicleState,
        forecast: LeaderForecast | None,
        brake_share: float = 1.0,
    ) -> bool:
        """Return whether a command for the next tick makes the gap fall below the margin, brake as it may.

        Args:
            acceleration_m_s2: command, within the reach of the actuators.
            forecast: the leader's motion that was planned with, None without one.
        """
        leader = self.leader
        if leader is None:
            return False
        if self._library is not None:
            return self._threatens_in_c(
                self._library, acceleration_m_s2, state, leader, forecast, brake_share
            )
        times_s, distance_m = self._braking_distance(acceleration_m_s2, state, brake_share)
        gap_m = leader.position_m - state.position_m
        # A leader never moves backwards: most commands are safe before anything is predicted.
        if gap_m - float(distance_m[-1]) >= MARGIN_M:
            return False
        gaps_m = self._leader_position_m(state.time_s + times_s, leader, forecast)
        gaps_m = gaps_m - state.position_m - distance_m
        # Below the margin already, the gap must not become smaller still.
        return bool(np.any(gaps_m < min(MARGIN_M, float(gaps_m[0]) - ROUNDING_M)))

    def _threatens_in_c(
        self,
        library: ctypes.PyDLL,
        acceleration_m_s2: float,
        state: VehicleState,
        leader: LeaderState,
        forecast: LeaderForecast | None,
        brake_share: float,
    ) -> bool:
        limits = self._limits
        self._write(
            self._tick_s,
            limits.max_jerk_m_s3 * self._tick_s,
            limits.min_acceleration_m_s2,
            brake_share,
            leader.time_s,
            leader.position_m,
            leader.speed_m_s,
            self.deceleration_m_s2,
            0.0 if forecast is None else forecast.known_s,
        )
        motion = None if forecast is None else ctypes.byref(motion_of(forecast.motion))
        ego = acceleration_m_s2, state.time_s, state.position_m, state.speed_m_s
        found = library.iptm_collision_threatens(self._guarded, motion, *ego)
        return bool(found)

    def _braking_distance(
        self, acceleration_m_s2: float, state: VehicleState, brake_share: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return times from now and the way by then, the first tick as commanded, then braking to a halt.

        Braking builds up tick by tick within the jerk limit, as commands do; shapes (n,).
        """
        limits, tick_s = self._limits, self._tick_s
        step = limits.max_jerk_m_s3 * tick_s
        hardest = limits.min_acceleration_m_s2 * brake_share
        build_up = max(math.ceil((acceleration_m_s2 - hardest) / step), 0)
        speed = state.speed_m_s + acceleration_m_s2 * tick_s * (1 + build_up)
        ticks = 1 + build_up + max(math.ceil(max(speed, 0.0) / (-hardest * tick_s)), 0) + 1
        accelerations = np.maximum(acceleration_m_s2 - step * np.arange(ticks), hardest)
        spread = np.repeat(accelerations, CHECKS_PER_TICK)
        interval_s = tick_s / CHECKS_PER_TICK
        ends = state.speed_m_s + np.cumsum(spread) * interval_s
        ends = np.where(np.minimum.accumulate(ends) <= 0.0, 0.0, ends)
        # Where it halts inside an interval the trapezium is too long, by v dt / 2 at most.
        starts = np.concatenate([[state.speed_m_s], ends[:-1]])
        ways: FloatArray = np.zeros(ends.size + 1)
        ways[1:] = np.cumsum(0.5 * (starts + ends) * interval_s)
        times_s: FloatArray = np.zeros(ways.size)
        times_s[1:] = np.cumsum(np.full(ends.size, interval_s))
        return times_s, ways

    def _leader_position_m(
        self, times_s: FloatArray, leader: LeaderState, forecast: LeaderForecast | None
    ) -> FloatArray:
        """Return where the leader is taken to be at trip times, shape of the times."""
        as_measured_m = _braking_on_m(
            times_s - leader.time_s,
            leader.position_m,
            leader.speed_m_s,
            self.deceleration_m_s2,
        )
        if forecast is None or forecast.known_s <= ROUNDING_S:
            return as_measured_m
        until_s = leader.time_s + forecast.known_s
        last_s = max(until_s - self._tick_s, leader.time_s)
        positions_m, speeds_m_s = forecast.motion.at(np.array([leader.time_s, last_s, until_s]))
        now_m_s, last_m_s, end_m_s = speeds_m_s.tolist()
        beyond_m = _braking_on_m(
            np.maximum(times_s - until_s, 0.0),
            float(positions_m[2]),
            end_m_s,
            max((last_m_s - end_m_s) / (until_s - last_s), 0.0),
        )
        predicted_m, _ = forecast.motion.at(np.minimum(times_s, until_s))
        predicted_m = np.where(times_s > until_s, beyond_m, predicted_m)
        too_fast = now_m_s - leader.speed_m_s > CONFIRMED_SPEED_ERROR_M_S
        if too_fast or forecast.known_s < NEAR_S:
            return np.minimum(as_measured_m, predicted_m)
        return predicted_m


def _braking_on_m(
    elapsed_s: FloatArray, position_m: float, speed_m_s: float, deceleration_m_s2: float
) -> FloatArray:
    """Return positions of a vehicle that keeps its deceleration until it stands."""
    if deceleration_m_s2 > 0.0:
        elapsed_s = np.minimum(elapsed_s, speed_m_s / deceleration_m_s2)
    moved: FloatArray = elapsed_s * (speed_m_s - 0.5 * deceleration_m_s2 * elapsed_s)
    return position_m + moved
