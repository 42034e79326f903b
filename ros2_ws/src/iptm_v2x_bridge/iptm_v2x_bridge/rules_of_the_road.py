"""The host keeps speed limits and stop lines itself: a leader that is not there stands for them.

The controller knows one thing ahead of it, the leader. Where the rules are stricter than the car ahead, or
no car is there, it is given a leader that drives as the rules allow, and that stands behind a line that is
closed when the host arrives.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from iptm_core.parameters.model import ModelParameters
from iptm_core.settings import PreviewSettings
from iptm_core.state import FloatArray, LeaderPreview, LeaderState
from iptm_v2x_bridge.bridge import BridgeAnswer, TickBridge
from iptm_v2x_bridge.prediction.assumed_braking import ASSUMED_BRAKING_M_S2
from iptm_v2x_bridge.prediction.predictor import PredictorName
from iptm_v2x_bridge.prediction.road_rules import RoadRules
from iptm_v2x_bridge.prediction.signals import Signal
from iptm_v2x_bridge.prediction.speed_limits import BRAKING_M_S2, NO_LIMITS
from iptm_v2x_bridge.source import preview_times_s

START_M_S2 = 1.0
"""Acceleration with which the host is reckoned to get going, less than it can."""
PASS_MARGIN_S = 3.0
"""The host counts on passing a line only if it arrives so long before it closes."""
EARLY_S = 1.0
"""The host may be so much earlier than reckoned; a line must have opened by then."""
STOP_BEFORE_M = 2.0
"""Where the host halts before a closed line."""
HARDEST_M_S2 = 1.8
"""A line that would take harder braking is passed; the margin has seen to it that it is still open."""
ROOM_S = 1.0
"""Headway of the leader that is not there beyond that of the host's spacing policy."""
PACE_MARGIN_M = 20.0
"""The leader that keeps the speed limit stays so much nearer than the largest gap of the host's policy."""
_STEP_S = 0.5


@dataclass(frozen=True, eq=False)
class _Motion:
    """Positions (rear end for a leader, front for the host) and speeds at given times, shape (n,) each."""

    positions_m: FloatArray
    speeds_m_s: FloatArray


class RulesOfTheRoad:
    """Answers ticks with whatever is nearest: the leader that is heard of, or the rules."""

    def __init__(
        self,
        inner: TickBridge,
        host_speed_m_s: Callable[[], float],
        rules: RoadRules,
        parameters: ModelParameters,
        settings: PreviewSettings | None = None,
        *,
        foresight_s: float = math.inf,
        start_timestamp_ms: int = 0,
    ) -> None:
        """Set up the rules.

        Args:
            inner: knows of the leader.
            host_speed_m_s: tells the host's present speed.
            rules: speed limits of the road and its signals.
            parameters: of the host: its spacing policy, and how hard it can brake.
            settings: length and step of the previews.
            foresight_s: lines that the host would reach later are not looked at.
            start_timestamp_ms: TimestampIts at trip time 0.
        """
        self._inner, self._host_speed_m_s = inner, host_speed_m_s
        self._rules, self._gap = rules, parameters.gap
        self._limits, self._plan = NO_LIMITS, rules.plan
        # The controller reckons with a leader that brakes as hard as the host can.
        self._reckoned_m_s2 = -parameters.limits.min_acceleration_m_s2
        self._settings = settings or PreviewSettings()
        self._foresight_s = foresight_s
        self._start_s = start_timestamp_ms / 1000.0
        self._pace: tuple[float, float, float] | None = None
        self._holding_m: float | None = None
        """The line that held the host at the last tick."""
        self._last: BridgeAnswer | None = None

    def answer(self, time_ns: int, host_position_m: float) -> BridgeAnswer:
        """Return the answer to one tick; the same one again has the same answer. See `TickBridge.answer`."""
        if self._last is None or time_ns != self._last.time_ns:
            self._last = self._answer(time_ns, host_position_m)
        return self._last

    def _answer(self, time_ns: int, host_position_m: float) -> BridgeAnswer:
        answer = self._inner.answer(time_ns, host_position_m)
        # Only now: what has been heard by this tick counts.
        self._limits, self._plan = self._rules.limits or NO_LIMITS, self._rules.plan
        speed = self._host_speed_m_s()
        times = preview_times_s(self._settings, time_ns)
        known, worst = self._of_inner(answer, times, ASSUMED_BRAKING_M_S2)
        # Lines are looked at for a leader that drives on, however little is known of it.
        _, expected = self._of_inner(answer, times, 0.0)
        rules = [self._pace_ahead(times, host_position_m, speed)]
        held = self._held(times, host_position_m, speed, expected)
        if held is not None:
            rules.append(held)
        return self._nearest(answer, times, known, worst, rules)

    @staticmethod
    def _of_inner(
        answer: BridgeAnswer, times: FloatArray, braking_m_s2: float
    ) -> tuple[int, _Motion]:
        """Return how many nodes the leader is known at, and its motion, which past them brakes."""
        leader, preview = answer.leader, answer.preview.cautious()
        if leader is None:
            return times.size, _Motion(np.full(times.size, np.inf), np.zeros(times.size))
        if answer.preview.known_until_s < times[0]:
            known, last = 1, (leader.position_m, leader.speed_m_s)
            positions: FloatArray = np.full(times.size, leader.position_m)
            speeds: FloatArray = np.full(times.size, leader.speed_m_s)
        else:
            known = int(np.searchsorted(times, answer.preview.known_until_s + 1e-6))
            positions = np.interp(times, preview.times_s, preview.positions_m)
            speeds = np.interp(times, preview.times_s, preview.speeds_m_s)
            last = (float(positions[known - 1]), float(speeds[known - 1]))
        beyond = np.maximum(times - times[known - 1], 0.0)
        braked = beyond if braking_m_s2 == 0.0 else np.minimum(beyond, last[1] / braking_m_s2)
        onward = last[0] + braked * (last[1] - 0.5 * braking_m_s2 * braked)
        later = np.arange(times.size) >= known
        slower = np.maximum(last[1] - braking_m_s2 * braked, 0.0)
        return known, _Motion(np.where(later, onward, positions), np.where(later, slower, speeds))

    def _spacing_m(self, speed_m_s: float) -> float:
        return self._gap.standstill_gap_m + speed_m_s * (self._gap.time_headway_s + ROOM_S)

    def _pace_ahead(self, times: FloatArray, host_position_m: float, speed: float) -> _Motion:
        """Return a leader that drives at the limits, never far ahead of the host."""
        now_s = float(times[0])
        largest_m = max(self._gap.max_gap_m - PACE_MARGIN_M, self._spacing_m(speed))
        farthest_m = host_position_m + largest_m
        pace = self._pace
        if pace is None or now_s < pace[0]:
            position, pace_speed = farthest_m, speed
        else:
            moved = self._free_drive(pace[1], pace[2], now_s - pace[0])
            position, pace_speed = moved.positions_m[-1], moved.speeds_m_s[-1]
        position = min(max(position, host_position_m), farthest_m)
        self._pace = (now_s, float(position), float(pace_speed))
        drive = self._free_drive(*self._pace[1:], float(times[-1]) - now_s)
        fine = now_s + _STEP_S * np.arange(drive.positions_m.size)
        return _Motion(
            np.interp(times, fine, drive.positions_m), np.interp(times, fine, drive.speeds_m_s)
        )

    def _free_drive(self, position: float, speed: float, duration_s: float) -> _Motion:
        positions, speeds = [position], [speed]
        for _ in range(max(round(duration_s / _STEP_S), 1)):
            allowed = self._limits.approach_at_m_s(positions[-1])
            aimed = min(speeds[-1] + START_M_S2 * _STEP_S, allowed)
            aimed = max(aimed, speeds[-1] - 2.0 * BRAKING_M_S2 * _STEP_S, 0.0)
            positions.append(positions[-1] + 0.5 * _STEP_S * (speeds[-1] + aimed))
            speeds.append(aimed)
        return _Motion(np.array(positions), np.array(speeds))

    def _held(
        self, times: FloatArray, host_position_m: float, speed: float, ahead: _Motion
    ) -> _Motion | None:
        """Return a leader behind the next line that is closed when the host arrives, None if all are open."""
        now_s, end_s = float(times[0]), float(times[-1])
        fine = np.arange(now_s, end_s + 0.5 * _STEP_S, _STEP_S)
        room = np.interp(fine, times, ahead.positions_m) - self._gap.standstill_gap_m
        places = room.tolist()
        holds: list[tuple[Signal, float]] = []
        while True:
            drive, arrivals = self._lawful_drive(now_s, host_position_m, speed, places, holds)
            closed = self._first_closed(arrivals, now_s, host_position_m, speed, holds)
            if closed is None:
                break
            holds.append(closed)
        self._holding_m = holds[0][0].stop_line_m if holds else None
        if not holds:
            return None
        spacing = self._gap.time_headway_s + ROOM_S
        rear = drive.positions_m + self._gap.standstill_gap_m + spacing * drive.speeds_m_s
        speeds = drive.speeds_m_s
        for signal, opens_s in holds:
            behind_line_m = signal.stop_line_m - STOP_BEFORE_M + self._gap.standstill_gap_m
            stands = (fine < opens_s) & (rear > behind_line_m)
            rear, speeds = np.where(stands, behind_line_m, rear), np.where(stands, 0.0, speeds)
        return _Motion(
            np.maximum.accumulate(np.interp(times, fine, rear)), np.interp(times, fine, speeds)
        )

    def _first_closed(
        self,
        arrivals: list[tuple[Signal, float]],
        now_s: float,
        host_position_m: float,
        speed: float,
        holds: list[tuple[Signal, float]],
    ) -> tuple[Signal, float] | None:
        """Return the first line that the host would find closed, and when it opens."""
        for signal, time_s in arrivals:
            if time_s - now_s > self._foresight_s:
                return None
            at = self._start_s + time_s
            early = max(at - EARLY_S, self._start_s + now_s)
            if signal.is_open(early) and signal.open_until_s(at) - at >= PASS_MARGIN_S:
                continue
            way_m = signal.stop_line_m - host_position_m
            is_too_late = speed * speed > 2.0 * HARDEST_M_S2 * way_m
            if is_too_late and not holds and signal.stop_line_m != self._holding_m:
                continue
            opens = signal.closed_until_s(signal.open_until_s(early))
            return signal, opens + EARLY_S - self._start_s
        return None

    def _lawful_drive(
        self,
        now_s: float,
        position: float,
        speed: float,
        room_m: list[float],
        holds: list[tuple[Signal, float]],
    ) -> tuple[_Motion, list[tuple[Signal, float]]]:
        """Return the host's drive within limits, behind its leader and the lines that hold it.

        Returns:
            The drive at the steps, and when it passes lines that do not hold it.
        """
        positions, speeds, arrivals = [position], [speed], []
        held = {signal.stop_line_m: opens_s for signal, opens_s in holds}
        signal = self._plan.next_after(position)
        for number in range(1, len(room_m)):
            time_s = now_s + number * _STEP_S
            position, speed = positions[-1], speeds[-1]
            aimed = min(speed + START_M_S2 * _STEP_S, self._limits.approach_at_m_s(position))
            stop_m = math.inf
            if signal is not None and held.get(signal.stop_line_m, -math.inf) > time_s:
                stop_m = max(signal.stop_line_m - STOP_BEFORE_M, position)
                # What is to be braked for at once may take more than comfort.
                way_m = max(stop_m - positions[0], 0.1)
                braking = max(BRAKING_M_S2, 0.5 * speeds[0] ** 2 / way_m)
                aimed = min(aimed, math.sqrt(2.0 * braking * (stop_m - position)))
            if room_m[number] < math.inf:
                aimed = min(aimed, max(room_m[number] - position, 0.0) / self._gap.time_headway_s)
            aimed = max(aimed, speed - HARDEST_M_S2 * _STEP_S, 0.0)
            moved = min(0.5 * _STEP_S * (speed + aimed), stop_m - position)
            if signal is not None and position + moved > signal.stop_line_m:
                share = (signal.stop_line_m - position) / moved
                if signal.stop_line_m not in held:
                    arrivals.append((signal, time_s - (1.0 - share) * _STEP_S))
                signal = self._plan.next_after(position + moved)
            positions.append(position + moved)
            speeds.append(aimed)
        return _Motion(np.array(positions), np.array(speeds)), arrivals

    def _nearest(
        self,
        answer: BridgeAnswer,
        times: FloatArray,
        known: int,
        leader: _Motion,
        rules: list[_Motion],
    ) -> BridgeAnswer:
        motions = [leader, *rules]
        places = np.stack([motion.positions_m for motion in motions])
        nearest = np.argmin(places, axis=0)
        columns = np.arange(times.size)
        positions = np.maximum.accumulate(places[nearest, columns])
        speeds = np.stack([motion.speeds_m_s for motion in motions])[nearest, columns]
        # From any node on the controller reckons with a leader that brakes to a halt. The car behind the
        # rules may do so, too, and then halts nearer.
        room = np.maximum(leader.positions_m - positions, 0.0)
        halting = 2.0 * self._reckoned_m_s2 * room + leader.speeds_m_s**2
        speeds = np.where(nearest > 0, np.minimum(speeds, np.sqrt(halting)), speeds)
        # What is beyond the known part of the leader's motion counts only where the rules are stricter.
        unknown = (columns >= known) & (nearest == 0)
        count = int(np.argmax(unknown)) if unknown.any() else times.size
        if answer.leader is not None and nearest[0] == 0 and not np.any(nearest[:count]):
            return answer
        now_s = float(times[0])
        by_rules = bool(nearest[0])
        return replace(
            answer,
            leader=LeaderState(now_s, float(positions[0]), float(speeds[0])),
            preview=LeaderPreview(now_s, times[:count], positions[:count], speeds[:count]),
            predictor=str(PredictorName.RULES) if by_rules else answer.predictor,
            leader_bound_m=0.0 if by_rules else answer.leader_bound_m,
        )
