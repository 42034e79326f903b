"""The leader's motion as the optimiser sees it: measured past, predicted future, and how good it is.

A preview is used only if it is well formed and recent enough; otherwise the leader is taken to keep its
measured speed. Which of the two holds, and why, is part of the result.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from iptm_controller.motion import Motion
from iptm_core.errors import PreviewError
from iptm_core.state import LeaderPreview, LeaderState

HISTORY_S = 3.0
MAX_LEADER_SPEED_M_S = 100.0


class PreviewQuality(IntEnum):
    """How the leader's future is known."""

    FULL = 0
    """A valid preview covers the whole horizon."""
    SHORT = 1
    """A valid preview ends inside the horizon; constant speed beyond it."""
    STALE = 2
    """The newest preview is too old; constant measured speed."""
    MISSING = 3
    """No preview has been received; constant measured speed."""
    INVALID = 4
    """The preview is malformed; constant measured speed."""


@dataclass(frozen=True)
class LeaderForecast:
    """Motion of the leader around now.

    Attributes:
        motion: past and future, one piece.
        quality: how the future is known.
        reason: one sentence, empty while the quality is full.
        age_s: age of the preview used, NaN without one.
        known_s: how far ahead a preview backs the motion; 0 where a constant speed is all there is.
    """

    motion: Motion
    quality: PreviewQuality
    reason: str
    age_s: float
    known_s: float


def check_preview(preview: LeaderPreview) -> None:
    """Check lengths, order, finiteness and plausibility of a preview.

    Raises:
        PreviewError: says what is wrong, the value and what is allowed.
    """
    sizes = (preview.times_s.size, preview.positions_m.size, preview.speeds_m_s.size)
    if len(set(sizes)) != 1:
        raise PreviewError(
            f"preview has {sizes} times, positions and speeds, expected equal numbers"
        )
    if not np.isfinite(preview.generated_at_s):
        raise PreviewError(
            f"preview was generated at {preview.generated_at_s} s, allowed are finite times"
        )
    for label, values in (
        ("times", preview.times_s),
        ("positions", preview.positions_m),
        ("speeds", preview.speeds_m_s),
    ):
        if not np.all(np.isfinite(values)):
            bad = int(np.flatnonzero(~np.isfinite(values))[0])
            raise PreviewError(f"preview {label} are not finite at node {bad}: {values[bad]}")
    if np.any(np.diff(preview.times_s) <= 0.0):
        bad = int(np.flatnonzero(np.diff(preview.times_s) <= 0.0)[0])
        raise PreviewError(f"preview times do not increase after node {bad}")
    if np.any(np.diff(preview.positions_m) < -1e-6):
        bad = int(np.flatnonzero(np.diff(preview.positions_m) < -1e-6)[0])
        raise PreviewError(f"preview positions move backwards after node {bad}")
    with np.errstate(over="ignore"):
        reach_m = 1.0 + MAX_LEADER_SPEED_M_S * np.diff(preview.times_s)
        leaps = np.diff(preview.positions_m) > reach_m
    if np.any(leaps):
        bad = int(np.flatnonzero(leaps)[0])
        raise PreviewError(
            f"preview positions leap after node {bad}, allowed are {MAX_LEADER_SPEED_M_S:g} m/s"
        )
    if preview.speeds_m_s.size and not (
        preview.speeds_m_s.min() >= 0.0 and preview.speeds_m_s.max() <= MAX_LEADER_SPEED_M_S
    ):
        raise PreviewError(
            f"preview speeds span {preview.speeds_m_s.min():.2f} to {preview.speeds_m_s.max():.2f} m/s, "
            f"allowed are 0 to {MAX_LEADER_SPEED_M_S:g} m/s"
        )


class LeaderForecaster:
    """Keeps the leader's recent past and joins it with each tick's preview."""

    def __init__(self, horizon_s: float, max_age_s: float) -> None:
        self._horizon_s = horizon_s
        self._max_age_s = max_age_s
        self._past: deque[LeaderState] = deque()

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
            known_s = min(float(preview.times_s[-1]) - leader.time_s, self._horizon_s)
        else:
            future = Motion(
                np.array([leader.time_s]),
                np.array([leader.position_m]),
                np.array([leader.speed_m_s]),
            )
        return LeaderForecast(self._with_past(future), quality, reason, age_s, known_s)

    def _remember(self, leader: LeaderState) -> None:
        if self._past and leader.time_s <= self._past[-1].time_s:
            self._past.clear()
        self._past.append(leader)
        while self._past[0].time_s < leader.time_s - HISTORY_S:
            self._past.popleft()

    def _assess(self, leader: LeaderState, preview: LeaderPreview) -> tuple[PreviewQuality, str]:
        if preview.times_s.size == 0:
            return PreviewQuality.MISSING, "no preview of the leader received yet"
        try:
            check_preview(preview)
        except PreviewError as error:
            return PreviewQuality.INVALID, str(error)
        age_s = leader.time_s - preview.generated_at_s
        if age_s > self._max_age_s:
            return (
                PreviewQuality.STALE,
                f"preview is {age_s:.1f} s old, allowed are {self._max_age_s:g} s",
            )
        if age_s < -1e-6:
            return PreviewQuality.INVALID, f"preview was generated {-age_s:.3f} s in the future"
        last_s = float(preview.times_s[-1])
        if last_s <= leader.time_s:
            return PreviewQuality.STALE, f"preview ended {leader.time_s - last_s:.1f} s ago"
        if last_s < leader.time_s + self._horizon_s - 1e-6:
            return (
                PreviewQuality.SHORT,
                f"preview covers {last_s - leader.time_s:.1f} s of a {self._horizon_s:g} s horizon",
            )
        return PreviewQuality.FULL, ""

    @staticmethod
    def _follow_preview(leader: LeaderState, preview: LeaderPreview) -> Motion:
        predicted = Motion(preview.times_s, preview.positions_m, preview.speeds_m_s)
        now = np.array([leader.time_s])
        position_now, speed_now = predicted.at(now)
        ahead = preview.times_s > leader.time_s + 1e-9
        shift_m = leader.position_m - float(position_now[0])
        return Motion(
            np.concatenate([now, preview.times_s[ahead]]),
            np.concatenate([[leader.position_m], preview.positions_m[ahead] + shift_m]),
            np.concatenate([speed_now, preview.speeds_m_s[ahead]]),
        )

    def _with_past(self, future: Motion) -> Motion:
        past = list(self._past)[:-1]
        if not past:
            return future
        return Motion(
            np.concatenate([[state.time_s for state in past], future.times_s]),
            np.concatenate([[state.position_m for state in past], future.positions_m]),
            np.concatenate([[state.speed_m_s for state in past], future.speeds_m_s]),
        )
