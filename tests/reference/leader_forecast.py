"""Forecast of the leader in Python, to the bits of ``c/forecast.c``."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from tests.reference.preview_trust import PreviewFusion, PreviewTrust

from iptm_controller.forecast import (
    HISTORY_S,
    NEAR_S,
    UNKNOWN_ACCELERATION_M_S2,
    ForecastMemory,
    LeaderForecast,
    PreviewQuality,
    assessed,
    doubted,
)
from iptm_controller.lead_check import (
    ACCELERATION_DECAY_S,
    ACCELERATION_WINDOW_S,
    EXTRAPOLATED_DECAYS,
    EXTRAPOLATED_NODES,
    LARGEST_ACCELERATION_M_S2,
    RANGE_ERROR_M,
    SHORTEST_STOP_S,
)
from iptm_controller.preview_trust import PRESENT_ERROR_M_S
from iptm_core.frozen import replace
from iptm_core.state import ROUNDING_S, TOLERANCE_S, FloatArray, LeaderPreview, LeaderState

_SHARES: FloatArray = np.arange(EXTRAPOLATED_NODES) / (EXTRAPOLATED_NODES - 1)


class ReferenceForecaster:
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
        quality, reason = assessed(leader, preview, self._max_age_s, self._horizon_s)
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
        measured_m, measured_m_s = self._extrapolated(leader).at(future.times_s)
        bounded = future.times_s <= leader.time_s + known_s + ROUNDING_S
        bounded[:2] = True
        since_s = np.maximum(future.times_s - preview.times_s[0], ROUNDING_S)
        bounds_m = (
            np.interp(future.times_s, preview.times_s, preview.bounds_m) - preview.bounds_m[0]
        )
        more_m = np.maximum(bounds_m - 0.5 * UNKNOWN_ACCELERATION_M_S2 * since_s**2, 0.0)
        nearer_m = np.minimum(future.positions_m, measured_m) - more_m
        slower_m_s = np.minimum(future.speeds_m_s, measured_m_s) - 2.0 * more_m / since_s
        limits_m = np.maximum(cautious.positions_m, nearer_m)
        limits_m_s = np.maximum(cautious.speeds_m_s, slower_m_s)
        return LeaderPreview(
            future.times_s,
            np.where(bounded, limits_m, future.positions_m),
            np.where(bounded, limits_m_s, future.speeds_m_s),
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


def _never_backwards(preview: LeaderPreview) -> LeaderPreview:
    """Return a preview without the small negative speeds and steps of estimators at standstill."""
    if preview.speeds_m_s.min() >= 0.0 and (np.diff(preview.positions_m) >= 0.0).all():
        return preview
    return replace(
        preview,
        positions_m=np.maximum.accumulate(preview.positions_m),
        speeds_m_s=np.maximum(preview.speeds_m_s, 0.0),
    )


def measured_acceleration_m_s2(measured: Sequence[LeaderState]) -> float:
    """Return the leader's acceleration from its speeds of the last second, 0 without enough of them.

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
    since_s = min(last.time_s - ACCELERATION_WINDOW_S - TOLERANCE_S, before.time_s)
    recent = [state for state in measured if state.time_s >= since_s]
    mean_s = moment = spread = 0.0
    for state in recent:
        mean_s += state.time_s
    mean_s /= len(recent)
    for state in recent:
        moment += (state.time_s - mean_s) * state.speed_m_s
        spread += (state.time_s - mean_s) * (state.time_s - mean_s)
    slope_m_s2 = moment / spread
    return slope_m_s2 if abs(slope_m_s2) <= LARGEST_ACCELERATION_M_S2 else 0.0


def extrapolated_motion(
    leader: LeaderState, acceleration_m_s2: float, decay_s: float = ACCELERATION_DECAY_S
) -> LeaderPreview:
    """Return how a leader goes on of which only the present is known.

    Its acceleration dies away exponentially, which is what to expect of one that varies as a first-order
    Gauss-Markov process (R. A. Singer, Estimating optimal tracking filter performance for manned
    maneuvering targets, IEEE Transactions on Aerospace and Electronic Systems 6, 1970). It never drives
    backwards.

    Args:
        acceleration_m_s2: as measured, negative when braking.
        decay_s: time constant of its decay.
    """
    change_m_s, shares = decay_s * acceleration_m_s2, _SHARES
    until_s = EXTRAPOLATED_DECAYS * decay_s
    if leader.speed_m_s + change_m_s < 0.0:
        stop_s = -decay_s * math.log1p(leader.speed_m_s / change_m_s)
        until_s = min(until_s, stop_s)
        if stop_s < SHORTEST_STOP_S:
            shares = shares[:1]
    elapsed_s = until_s * shares
    gone = -np.array([math.expm1(each) for each in (-elapsed_s / decay_s).tolist()])
    speeds_m_s = np.maximum(leader.speed_m_s + change_m_s * gone, 0.0)
    moved_m = leader.speed_m_s * elapsed_s + change_m_s * (elapsed_s - decay_s * gone)
    return LeaderPreview(leader.time_s + elapsed_s, leader.position_m + moved_m, speeds_m_s)
