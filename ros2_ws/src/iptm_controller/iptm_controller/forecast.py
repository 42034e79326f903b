"""The leader's motion as the optimiser sees it: measured past, predicted future, and how good it is.

A preview is used only if it is well formed and recent enough, and behind its end the leader is taken to keep
its last speed. Without one the leader is extrapolated: its measured acceleration dies away. Which of the two
holds, and why, is part of the result.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from iptm_core.state import FloatArray, LeaderPreview, LeaderState

HISTORY_S = 3.0
MAX_LEADER_SPEED_M_S = 100.0
LARGEST_SPEED_ERROR_M_S = 6.0
"""Beyond this difference to the measured speed a preview is that of another drive. Four times the noise that
the study of imperfect previews assumes."""
ACCELERATION_DECAY_S = 4.0
"""Time constant with which the leader's acceleration dies away where nothing is foretold. In every published
cycle positions 3 to 8 s ahead are predicted better than at a constant speed, and over all of them together
better than with half or twice the constant (a test checks both)."""
ACCELERATION_WINDOW_S = 1.0
"""The leader's acceleration is the slope of the speeds measured since so long, of two of them at least."""
LARGEST_ACCELERATION_M_S2 = 10.0
"""More than tyres transmit: a larger change of the measured speed is not the motion of one vehicle."""
RANGE_ERROR_M = 1.0
"""So far beside the way that two measured speeds permit, the second one is that of another vehicle."""
_EXTRAPOLATED_S = 5.0 * ACCELERATION_DECAY_S
_SHORTEST_STOP_S = 1e-3
_SHARES: FloatArray = np.array([node / 40.0 for node in range(41)])


class PreviewQuality(IntEnum):
    """How the leader's future is known."""

    FULL = 0
    """A valid preview covers the whole horizon."""
    SHORT = 1
    """A valid preview ends inside the horizon; constant speed beyond it."""
    STALE = 2
    """The newest preview is too old; the measured motion is extrapolated."""
    MISSING = 3
    """No preview has been received; the measured motion is extrapolated."""
    INVALID = 4
    """The preview is malformed or contradicts what is measured; the measured motion is extrapolated."""


@dataclass(frozen=True)
class PredictedLeaderMotion:
    """Positions and speeds at increasing node times, the speed held outside them.

    Attributes:
        times_s: node times, shape (n,), increasing, n >= 1.
        positions_m: positions at the nodes, shape (n,).
        speeds_m_s: speeds at the nodes, shape (n,).
    """

    times_s: FloatArray
    positions_m: FloatArray
    speeds_m_s: FloatArray

    def at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and speeds at any times, shapes of ``times_s``.

        Between two nodes the speed is linear; the position is the cubic that meets both nodes in
        position and speed, which is the exact quadratic where the nodes are consistent.
        """
        nodes = self.times_s
        if nodes.size == 1:
            elapsed = times_s - nodes[0]
            return self.positions_m[0] + self.speeds_m_s[0] * elapsed, np.full(
                times_s.shape, self.speeds_m_s[0]
            )
        index = nodes.searchsorted(times_s, side="right") - 1
        index = np.minimum(np.maximum(index, 0), nodes.size - 2)
        start = nodes[index]
        width = nodes[index + 1] - start
        inside = np.minimum(np.maximum(times_s, nodes[0]), nodes[-1])
        tau = (inside - start) / width
        v_0, v_1 = self.speeds_m_s[index], self.speeds_m_s[index + 1]
        p_0, p_1 = self.positions_m[index], self.positions_m[index + 1]
        # Rest that a linear speed leaves over; zero for consistent nodes.
        rest = p_1 - p_0 - 0.5 * width * (v_0 + v_1)
        position = p_0 + width * tau * (v_0 + 0.5 * tau * (v_1 - v_0))
        position = position + rest * tau * tau * (3.0 - 2.0 * tau)
        speed = v_0 + tau * (v_1 - v_0)
        return position + speed * (times_s - inside), speed


@dataclass(frozen=True)
class LeaderForecast:
    """Motion of the leader around now.

    Attributes:
        motion: past and future, one piece.
        quality: how the future is known.
        reason: one sentence, empty while the quality is full.
        age_s: age of the preview used, NaN without one.
        known_s: how far ahead a preview backs the motion; 0 where it is extrapolated.
    """

    motion: PredictedLeaderMotion
    quality: PreviewQuality
    reason: str
    age_s: float
    known_s: float


def preview_fault(preview: LeaderPreview) -> str:
    """Return what is wrong with lengths, order, finiteness or plausibility of a preview, empty if nothing."""
    times, positions, speeds = preview.times_s, preview.positions_m, preview.speeds_m_s
    sizes = (times.size, positions.size, speeds.size)
    if len(set(sizes)) != 1:
        return f"preview has {sizes} times, positions and speeds; allowed: equal numbers"
    if not np.isfinite(preview.generated_at_s):
        return f"preview was generated at {preview.generated_at_s} s; allowed: finite times"
    for label, values in (("time", times), ("position", positions), ("speed", speeds)):
        finite = np.isfinite(values)
        if not finite.all():
            bad = _first(~finite)
            return f"preview {label} is {values[bad]} at node {bad}; allowed: finite values"
    with np.errstate(over="ignore"):
        passed_s, moved_m = times[1:] - times[:-1], positions[1:] - positions[:-1]
        halts, backwards = passed_s <= 0.0, moved_m < -1e-6
        leaps = moved_m > 1.0 + MAX_LEADER_SPEED_M_S * passed_s
    if halts.any():
        return f"preview times do not increase after node {_first(halts)}"
    if backwards.any():
        return f"preview positions move backwards after node {_first(backwards)}"
    if leaps.any():
        return (
            f"preview positions leap after node {_first(leaps)}; "
            f"allowed: {MAX_LEADER_SPEED_M_S:g} m/s"
        )
    if speeds.size and not (speeds.min() >= 0.0 and speeds.max() <= MAX_LEADER_SPEED_M_S):
        return (
            f"preview speed is {speeds.min():.2f} to {speeds.max():.2f} m/s; "
            f"allowed: 0 to {MAX_LEADER_SPEED_M_S:g} m/s"
        )
    return ""


def measured_acceleration_m_s2(measured: Sequence[LeaderState]) -> float:
    """Return the leader's acceleration by its speeds of the last second, 0 where they do not tell.

    Args:
        measured: leader at increasing times, the newest one last. Where a measurement is missing, the one
            before counts instead.
    """
    if len(measured) < 2:
        return 0.0
    last, before = measured[-1], measured[-2]
    passed_s, changed_m_s = last.time_s - before.time_s, last.speed_m_s - before.speed_m_s
    moved_m = last.position_m - before.position_m
    unexplained_m = abs(moved_m - 0.5 * passed_s * (last.speed_m_s + before.speed_m_s))
    if unexplained_m > 0.5 * passed_s * abs(changed_m_s) + RANGE_ERROR_M:
        return 0.0
    since_s = min(last.time_s - ACCELERATION_WINDOW_S - 1e-6, before.time_s)
    recent = [state for state in measured if state.time_s >= since_s]
    times_s = np.array([state.time_s for state in recent])
    times_s -= times_s.mean()
    speeds_m_s = np.array([state.speed_m_s for state in recent])
    slope_m_s2 = float(times_s @ speeds_m_s / (times_s @ times_s))
    return slope_m_s2 if abs(slope_m_s2) <= LARGEST_ACCELERATION_M_S2 else 0.0


def extrapolated_motion(leader: LeaderState, acceleration_m_s2: float) -> PredictedLeaderMotion:
    """Return how a leader goes on of which only the present is known.

    Its acceleration dies away exponentially, which is what to expect of one that varies as a first-order
    Gauss-Markov process (R. A. Singer, Estimating optimal tracking filter performance for manned
    maneuvering targets, IEEE Transactions on Aerospace and Electronic Systems 6, 1970). It never drives
    backwards.

    Args:
        leader: as measured.
        acceleration_m_s2: as measured, negative when braking.
    """
    decay_s, change_m_s = ACCELERATION_DECAY_S, ACCELERATION_DECAY_S * acceleration_m_s2
    until_s, shares = _EXTRAPOLATED_S, _SHARES
    if leader.speed_m_s + change_m_s < 0.0:
        stop_s = -decay_s * math.log1p(leader.speed_m_s / change_m_s)
        until_s = min(until_s, stop_s)
        if stop_s < _SHORTEST_STOP_S:
            shares = shares[:1]
    elapsed_s = until_s * shares
    gone = -np.expm1(-elapsed_s / decay_s)
    speeds_m_s = np.maximum(leader.speed_m_s + change_m_s * gone, 0.0)
    moved_m = leader.speed_m_s * elapsed_s + change_m_s * (elapsed_s - decay_s * gone)
    return PredictedLeaderMotion(leader.time_s + elapsed_s, leader.position_m + moved_m, speeds_m_s)


def _first(flags: NDArray[np.bool_]) -> int:
    return int(np.flatnonzero(flags)[0])


class LeaderForecaster:
    """Keeps the leader's recent past and joins it with each tick's preview."""

    def __init__(self, horizon_s: float, max_age_s: float) -> None:
        self._horizon_s = horizon_s
        self._max_age_s = max_age_s
        self._past: deque[LeaderState] = deque()

    @property
    def past(self) -> tuple[LeaderState, ...]:
        """Leader measured in the last seconds, oldest first."""
        return tuple(self._past)

    @past.setter
    def past(self, past: tuple[LeaderState, ...]) -> None:
        self._past = deque(past)

    def forecast(self, leader: LeaderState, preview: LeaderPreview) -> LeaderForecast:
        """Combine the measured leader with a preview.

        The prediction is shifted so that it starts at the measured position: a late or noisy preview
        must not move the leader that the range sensor sees.
        """
        self._remember(leader)
        quality, reason = self._assess(leader, preview)
        age_s = leader.time_s - preview.generated_at_s if preview.times_s.size else float("nan")
        known_s = 0.0
        if quality in {PreviewQuality.FULL, PreviewQuality.SHORT}:
            future = self._follow_preview(leader, preview)
            known_s = float(preview.times_s[-1]) - leader.time_s
        else:
            future = extrapolated_motion(leader, measured_acceleration_m_s2(self._past))
        return LeaderForecast(self._with_past(future), quality, reason, age_s, known_s)

    def _remember(self, leader: LeaderState) -> None:
        if self._past and leader.time_s < self._past[-1].time_s:
            self._past.clear()
        elif self._past and leader.time_s == self._past[-1].time_s:
            self._past.pop()  # measured again
        self._past.append(leader)
        while self._past[0].time_s < leader.time_s - HISTORY_S:
            self._past.popleft()

    def _assess(self, leader: LeaderState, preview: LeaderPreview) -> tuple[PreviewQuality, str]:
        if preview.times_s.size == 0:
            return PreviewQuality.MISSING, "no preview of the leader received yet"
        fault = preview_fault(preview)
        if fault:
            return PreviewQuality.INVALID, fault
        age_s = leader.time_s - preview.generated_at_s
        if age_s > self._max_age_s:
            return (
                PreviewQuality.STALE,
                f"preview is {age_s:.1f} s old; allowed: up to {self._max_age_s:g} s",
            )
        if age_s < -1e-6:
            return PreviewQuality.INVALID, f"preview was generated {-age_s:.3f} s in the future"
        last_s = float(preview.times_s[-1])
        if last_s <= leader.time_s:
            return PreviewQuality.STALE, f"preview ended {leader.time_s - last_s:.1f} s ago"
        foretold_m_s = float(np.interp(leader.time_s, preview.times_s, preview.speeds_m_s))
        if abs(foretold_m_s - leader.speed_m_s) > LARGEST_SPEED_ERROR_M_S:
            return PreviewQuality.INVALID, (
                f"preview is {foretold_m_s - leader.speed_m_s:+.1f} m/s off the measured speed, "
                f"more than {LARGEST_SPEED_ERROR_M_S:g} m/s"
            )
        if last_s < leader.time_s + self._horizon_s - 1e-6:
            return (
                PreviewQuality.SHORT,
                f"preview covers {last_s - leader.time_s:.1f} s of a {self._horizon_s:g} s horizon",
            )
        return PreviewQuality.FULL, ""

    @staticmethod
    def _follow_preview(leader: LeaderState, preview: LeaderPreview) -> PredictedLeaderMotion:
        predicted = PredictedLeaderMotion(preview.times_s, preview.positions_m, preview.speeds_m_s)
        now = np.array([leader.time_s])
        position_now, speed_now = predicted.at(now)
        ahead = preview.times_s > leader.time_s + 1e-9
        shift_m = leader.position_m - float(position_now[0])
        return PredictedLeaderMotion(
            np.concatenate([now, preview.times_s[ahead]]),
            np.concatenate([[leader.position_m], preview.positions_m[ahead] + shift_m]),
            np.concatenate([speed_now, preview.speeds_m_s[ahead]]),
        )

    def _with_past(self, future: PredictedLeaderMotion) -> PredictedLeaderMotion:
        past = list(self._past)[:-1]
        if not past:
            return future
        return PredictedLeaderMotion(
            np.concatenate([[state.time_s for state in past], future.times_s]),
            np.concatenate([[state.position_m for state in past], future.positions_m]),
            np.concatenate([[state.speed_m_s for state in past], future.speeds_m_s]),
        )
