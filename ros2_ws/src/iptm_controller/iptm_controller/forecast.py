"""Forecast of the leader's motion for the optimiser: measured past, predicted future, and its quality.

A preview is used only if it is well formed and recent enough; beyond its end the leader keeps its last speed.
It is trusted as far as its bounds allow, and up to the horizon that earlier previews justify. From
there on the plan follows the expected motion and keeps its braking reserve. Without a preview the leader is
extrapolated: its measured acceleration decays. Which of these holds, and why, is part of the result.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from iptm_controller.lead_check import (
    ACCELERATION_DECAY_S,
    LARGEST_SPEED_ERROR_M_S,
    extrapolated_motion,
    measured_acceleration_m_s2,
)
from iptm_controller.preview_trust import (
    PRESENT_ERROR_M_S,
    FusionMemory,
    PreviewFusion,
    PreviewTrust,
    TrustMemory,
)
from iptm_core.frozen import replace
from iptm_core.state import (
    ROUNDING_S,
    SPEED_AT_REST_M_S,
    TOLERANCE_S,
    LeaderPreview,
    LeaderState,
)

HISTORY_S = 3.0
MAX_LEADER_SPEED_M_S = 100.0
NEAR_S = 3.0
"""Where the trusted horizon is shorter than this, the measured motion limits the forecast up to here."""


class PreviewQuality(IntEnum):
    """Quality of the preview."""

    FULL = 0
    """A valid preview, known over the whole horizon."""
    SHORT = 1
    """A valid preview that ends inside the horizon (constant speed beyond it), or is known up to there."""
    STALE = 2
    """The newest preview is too old; the measured motion is extrapolated."""
    MISSING = 3
    """No preview has been received; the measured motion is extrapolated."""
    INVALID = 4
    """The preview is malformed or contradicts the measurements; the measured motion is extrapolated."""
    DOUBTED = 5
    """A valid preview, but it or earlier ones were wrong; trusted up to a shorter horizon."""


@dataclass(frozen=True)
class LeaderForecast:
    """Motion of the leader around now.

    Attributes:
        motion: past and future, one piece.
        limiting: motion that the gap limits hold for: less its bounds as far as it is known, and at the first
            node in any case.
        quality: how the future is known.
        reason: one sentence, empty while the quality is full.
        age_s: age of the preview used, NaN without one.
        known_s: how far ahead the motion is known by a trusted preview; 0 where it is extrapolated.
    """

    motion: LeaderPreview
    limiting: LeaderPreview
    quality: PreviewQuality
    reason: str
    age_s: float
    known_s: float


def preview_fault(preview: LeaderPreview) -> str:
    """Return the fault of a preview in length, order, finiteness or plausibility, empty for none."""
    times, positions, speeds = preview.times_s, preview.positions_m, preview.speeds_m_s
    sizes = (times.size, positions.size, speeds.size)
    if len(set(sizes)) != 1:
        return f"preview has {sizes} times, positions and speeds; allowed: equal numbers"
    for label, values in (("time", times), ("position", positions), ("speed", speeds)):
        finite = np.isfinite(values)
        if not finite.all():
            bad = _first(~finite)
            return f"preview {label} is {values[bad]} at node {bad}; allowed: finite values"
    with np.errstate(over="ignore"):
        passed_s, moved_m = times[1:] - times[:-1], positions[1:] - positions[:-1]
        halts, backwards = passed_s <= 0.0, moved_m < SPEED_AT_REST_M_S * np.maximum(passed_s, 1.0)
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
    if speeds.size and not (
        speeds.min() >= SPEED_AT_REST_M_S and speeds.max() <= MAX_LEADER_SPEED_M_S
    ):
        return (
            f"preview speed is {speeds.min():.2f} to {speeds.max():.2f} m/s; "
            f"allowed: {SPEED_AT_REST_M_S:g} to {MAX_LEADER_SPEED_M_S:g} m/s"
        )
    return _bounds_fault(preview)


def _bounds_fault(preview: LeaderPreview) -> str:
    bounds = preview.bounds_m
    if bounds.size not in {0, preview.times_s.size}:
        return f"preview has {bounds.size} bounds; allowed: 0 or {preview.times_s.size}"
    if bounds.size and not (bounds.min() >= 0.0 and bounds.max() < np.inf):
        return f"preview bound is {bounds.min():g} to {bounds.max():g} m; allowed: finite values from 0 m"
    return ""


def _never_backwards(preview: LeaderPreview) -> LeaderPreview:
    """Return a preview without the small negative speeds and steps of estimators at standstill."""
    if preview.speeds_m_s.min() >= 0.0 and (np.diff(preview.positions_m) >= 0.0).all():
        return preview
    return replace(
        preview,
        positions_m=np.maximum.accumulate(preview.positions_m),
        speeds_m_s=np.maximum(preview.speeds_m_s, 0.0),
    )


def doubted(trusted_s: float) -> str:
    """Return the reason of a shorter horizon."""
    return f"previews were wrong; trusted for {trusted_s:g} s"


def _first(flags: NDArray[np.bool_]) -> int:
    return int(np.flatnonzero(flags)[0])


ForecastMemory = tuple[tuple[LeaderState, ...], FusionMemory, TrustMemory]
"""Leader measured in the last seconds, oldest first; average of the previews, and trust in them."""


class LeaderForecaster:
    """Keeps the leader's recent past and joins it with each tick's preview."""

    def __init__(
        self,
        horizon_s: float,
        max_age_s: float,
        tick_s: float = 1.0,
        decay_s: float = ACCELERATION_DECAY_S,
        braking_decay_s: float = ACCELERATION_DECAY_S,
    ) -> None:
        """Set up a forecaster that has not measured a leader.

        Args:
            horizon_s: time that a full preview covers.
            decay_s: time constant with which the leader's measured acceleration decays where nothing is
                predicted.
            braking_decay_s: the same where it brakes.
        """
        self._decay_s, self._braking_decay_s = decay_s, braking_decay_s
        self._horizon_s = horizon_s
        self._max_age_s = max_age_s
        self._past: deque[LeaderState] = deque()
        self.trust = PreviewTrust(tick_s)
        self.fusion = PreviewFusion()

    @property
    def memory(self) -> ForecastMemory:
        """State carried from tick to tick."""
        return self.kept_memory()()

    @memory.setter
    def memory(self, memory: ForecastMemory) -> None:
        past, self.fusion.memory, self.trust.memory = memory
        self._past = deque(past)

    def kept_memory(self) -> Callable[[], ForecastMemory]:
        """Return what builds the memory of now, whenever it is called."""
        memory = tuple(self._past), self.fusion.memory, self.trust.memory
        return lambda: memory

    @property
    def noise(self) -> str:
        """How rough the previews are, empty if they pass unchanged."""
        return self.fusion.memory.noise

    def leader_at(self, time_s: float, leader: LeaderState | None) -> LeaderState | None:
        """Return a measured leader as extrapolated to a later instant; as measured for the same one."""
        if leader is None or time_s <= leader.time_s:
            return leader
        positions_m, speeds_m_s = self._extrapolated(leader).at(np.array([time_s]))
        return LeaderState(time_s, float(positions_m[0]), float(speeds_m_s[0]))

    def forecast(self, leader: LeaderState, preview: LeaderPreview) -> LeaderForecast:
        """Combine the measured leader with a preview.

        The prediction is shifted so that it starts at the measured position: a late or noisy preview
        must not move the leader that the range sensor sees.
        """
        self._remember(leader)
        self.trust.observe(leader)
        quality, reason = self._assess(leader, preview)
        age_s = leader.time_s - preview.generated_at_s if preview.times_s.size else float("nan")
        if quality not in {PreviewQuality.FULL, PreviewQuality.SHORT}:
            motion = self._with_past(self._extrapolated(leader))
            return LeaderForecast(motion, motion, quality, reason, age_s, 0.0)
        preview = _never_backwards(preview)
        # An expectation is revised from tick to tick, which is not noise.
        if preview.known_nodes == preview.times_s.size:
            preview = self.fusion.fused(preview)
        future = self._follow_preview(leader, preview)
        self.trust.remember(leader, future, preview.known_until_s)
        motion = limited = self._with_past(future)
        known_s = max(preview.known_until_s - leader.time_s, 0.0)
        now_m_s = float(motion.speeds_m_s[len(self._past) - 1])
        is_present = abs(now_m_s - leader.speed_m_s) <= PRESENT_ERROR_M_S
        trusted_s = self.trust.horizon_s if is_present else 0.0
        if trusted_s < known_s:
            known_s, quality = trusted_s, PreviewQuality.DOUBTED
            reason = doubted(trusted_s)
        if preview.bounds_m.size or trusted_s < NEAR_S:
            motion, limited = self._bounded(leader, preview, motion, known_s, trusted_s)
        return LeaderForecast(motion, limited, quality, reason, age_s, known_s)

    def _bounded(
        self,
        leader: LeaderState,
        preview: LeaderPreview,
        motion: LeaderPreview,
        known_s: float,
        trusted_s: float,
    ) -> tuple[LeaderPreview, LeaderPreview]:
        """Return the expected motion and the one that limits hold for, of a preview with bounds or doubts."""
        columns = motion.times_s, motion.positions_m, motion.speeds_m_s
        future = LeaderPreview(*(each[len(self._past) - 1 :] for each in columns))
        motions = [future]
        if preview.bounds_m.size:
            motions.append(self._limiting(leader, preview, future, known_s))
        if trusted_s < NEAR_S:
            motions = [self._not_beyond_measured(leader, each) for each in motions]
        joined = [self._with_past(each) for each in motions]
        return joined[0], joined[-1]

    def _limiting(
        self, leader: LeaderState, preview: LeaderPreview, future: LeaderPreview, known_s: float
    ) -> LeaderPreview:
        cautious = self._follow_preview(leader, preview.cautious())
        bounded = future.times_s <= leader.time_s + known_s + ROUNDING_S
        bounded[:2] = True
        return LeaderPreview(
            future.times_s,
            np.where(bounded, cautious.positions_m, future.positions_m),
            np.where(bounded, cautious.speeds_m_s, future.speeds_m_s),
        )

    def _not_beyond_measured(self, leader: LeaderState, future: LeaderPreview) -> LeaderPreview:
        """Return a predicted motion that is nowhere ahead of the measured one for the next seconds.

        What it loses there stays lost behind; its speeds there are the predicted ones.
        """
        positions_m, speeds_m_s = self._extrapolated(leader).at(future.times_s)
        near = future.times_s <= leader.time_s + NEAR_S + ROUNDING_S
        excess_m = np.maximum(future.positions_m - positions_m, 0.0)
        lost_m = np.where(near, excess_m, excess_m[near][-1])
        return LeaderPreview(
            future.times_s,
            future.positions_m - lost_m,
            np.where(near, np.minimum(future.speeds_m_s, speeds_m_s), future.speeds_m_s),
        )

    def _extrapolated(self, leader: LeaderState) -> LeaderPreview:
        acceleration_m_s2 = measured_acceleration_m_s2(self._past)
        decay_s = self._braking_decay_s if acceleration_m_s2 < 0.0 else self._decay_s
        return extrapolated_motion(leader, acceleration_m_s2, decay_s)

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
            reason = f"preview is {age_s:.1f} s old; allowed: up to {self._max_age_s:g} s"
            return PreviewQuality.STALE, reason
        if age_s < -TOLERANCE_S:
            return PreviewQuality.INVALID, f"preview was generated {-age_s:.3f} s in the future"
        last_s = float(preview.times_s[-1])
        if last_s <= leader.time_s:
            return PreviewQuality.STALE, f"preview ended {leader.time_s - last_s:.1f} s ago"
        predicted_m_s = float(np.interp(leader.time_s, preview.times_s, preview.speeds_m_s))
        if abs(predicted_m_s - leader.speed_m_s) > LARGEST_SPEED_ERROR_M_S:
            return PreviewQuality.INVALID, (
                f"preview is {predicted_m_s - leader.speed_m_s:+.1f} m/s off the measured speed, "
                f"more than {LARGEST_SPEED_ERROR_M_S:g} m/s"
            )
        until_s = min(last_s, preview.known_until_s)
        if until_s < leader.time_s + self._horizon_s - TOLERANCE_S:
            verb = "is known for" if until_s < last_s else "covers"
            ahead_s = max(until_s - leader.time_s, 0.0)
            return (
                PreviewQuality.SHORT,
                f"preview {verb} {ahead_s:.1f} s of a {self._horizon_s:g} s horizon",
            )
        return PreviewQuality.FULL, ""

    @staticmethod
    def _follow_preview(leader: LeaderState, preview: LeaderPreview) -> LeaderPreview:
        now = np.array([leader.time_s])
        position_now, speed_now = preview.at(now)
        ahead = preview.times_s > leader.time_s + ROUNDING_S
        shift_m = leader.position_m - float(position_now[0])
        return LeaderPreview(
            np.concatenate([now, preview.times_s[ahead]]),
            np.concatenate([[leader.position_m], preview.positions_m[ahead] + shift_m]),
            np.concatenate([speed_now, preview.speeds_m_s[ahead]]),
        )

    def _with_past(self, future: LeaderPreview) -> LeaderPreview:
        past = list(self._past)[:-1]
        if not past:
            return future
        return LeaderPreview(
            np.concatenate([[state.time_s for state in past], future.times_s]),
            np.concatenate([[state.position_m for state in past], future.positions_m]),
            np.concatenate([[state.speed_m_s for state in past], future.speeds_m_s]),
        )
