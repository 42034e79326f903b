"""Rules of the road ahead as they are known at present, and a prediction of a leader that obeys them.

Signals have a periodic plan, or the phases of their messages. Yellow counts as closed.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.road_ahead import BRAKING_M_S2, SpeedLimits
from iptm_core.state import FloatArray, LeaderPreview
from iptm_v2x_bridge.prediction.predictor import (
    ErrorGrowth,
    LeaderPredictor,
    LeaderTrack,
    PredictorName,
)

Span = tuple[float, float]
"""Beginning and end, s of TimestampIts, possibly infinite."""
ALWAYS: tuple[Span, ...] = ((-math.inf, math.inf),)
STANDING_M_S = 0.1
QUEUE_M = 60.0
"""A leader that stands this close behind a closed line stands because of it."""
HARDEST_M_S2 = 2.5
"""Drivers who would have to brake harder for a line that has just closed pass it."""
START_M_S2 = 1.2
"""Acceleration with which drivers start when the line opens."""
SLACK_S = 1.0
"""Time before its planned opening at which a line may open; bounds the prediction of a standing leader."""
GROWTH = ErrorGrowth(
    (0.0, 0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0, 60.0),
    (0.02, 0.03, 0.07, 0.26, 0.65, 1.3, 3.5, 12.6, 56.0, 192.0, 491.0, 727.0),
)
NO_LIMITS = SpeedLimits(np.zeros(1), np.full(1, 70.0))
"""For a road of which no limit is known: no car is faster."""
_STEP_S = 0.25


@dataclass(frozen=True)
class Signal:
    """One stop line and when it is closed, once or in a plan that repeats itself.

    Attributes:
        stop_line_m: position along the road.
        closed_s: spans in which it is closed, increasing and apart from each other, s of TimestampIts; of a
            repeated plan in s since its beginning, within the cycle.
        cycle_s: time after which the plan repeats itself; None without a plan.
        begins_at_s: an instant at which the plan begins, s of TimestampIts.
    """

    stop_line_m: float
    closed_s: tuple[Span, ...]
    cycle_s: float | None = None
    begins_at_s: float = 0.0

    @classmethod
    def cyclic(
        cls, stop_line_m: float, cycle_s: float, opens_at_s: float, open_for_s: float
    ) -> Signal:
        """Return a line that turns green at some instant (s of TimestampIts) and once in every cycle.

        Raises:
            RouteError: a value is not finite or out of range.
        """
        values = (stop_line_m, cycle_s, opens_at_s, open_for_s)
        if not (all(map(math.isfinite, values)) and cycle_s > 0.0 and 0.0 <= open_for_s <= cycle_s):
            raise RouteError(
                f"signal is {values}; allowed: finite numbers, cycle_s above 0, open_for_s from 0 to cycle_s"
            )
        closed = ((open_for_s, cycle_s),) if open_for_s < cycle_s else ()
        return cls(stop_line_m, closed, cycle_s, opens_at_s)

    def _inside_s(self, time_s: float) -> float:
        return time_s if self.cycle_s is None else (time_s - self.begins_at_s) % self.cycle_s

    def _closed_at(self, inside_s: float) -> Span | None:
        return next((span for span in self.closed_s if span[0] <= inside_s < span[1]), None)

    def is_open(self, time_s: float) -> bool:
        """Return whether the line may be passed at an instant."""
        return self._closed_at(self._inside_s(time_s)) is None

    def open_until_s(self, time_s: float) -> float:
        """Return when the line closes that is open now; now if it is closed; infinite if it never does."""
        inside_s = self._inside_s(time_s)
        if self._closed_at(inside_s) is not None:
            return time_s
        closes_s = min((span[0] for span in self.closed_s if span[0] > inside_s), default=math.inf)
        return closes_s if self.cycle_s is None else time_s + (closes_s - inside_s)

    def closed_until_s(self, time_s: float) -> float:
        """Return when the line opens that is closed now; now if it is open; infinite if it never does."""
        inside_s = self._inside_s(time_s)
        span = self._closed_at(inside_s)
        if span is None:
            return time_s
        if self.cycle_s is None:
            return span[1]
        return math.inf if span == (0.0, self.cycle_s) else time_s + span[1] - inside_s


@dataclass
class RoadRules:
    """Rules of the road as they are known at present; messages change them from tick to tick.

    Attributes:
        limits: speed limits, None where none is known.
        signals: in driving order.

    Raises:
        RouteError: the positions of the signals do not increase.
    """

    limits: SpeedLimits | None = None
    signals: tuple[Signal, ...] = ()

    def __post_init__(self) -> None:
        places = [signal.stop_line_m for signal in self.signals]
        if any(later <= earlier for earlier, later in pairwise(places)):
            raise RouteError(f"stop lines are at {places} m; allowed: increasing positions")

    def next_after(self, position_m: float) -> Signal | None:
        """Return the first signal whose stop line lies beyond a position, None if there is none."""
        index = bisect_right(self.signals, position_m, key=lambda signal: signal.stop_line_m)
        return self.signals[index] if index < len(self.signals) else None


class BoundedByRules:
    """Takes another prediction and keeps it within speed limits and behind closed stop lines."""

    def __init__(self, inner: LeaderPredictor, rules: RoadRules) -> None:
        self._inner, self._rules = inner, rules

    @property
    def name(self) -> PredictorName:
        """Of the known rules."""
        return PredictorName.SIGNALS if self._rules.signals else PredictorName.SPEED_LIMITS

    def predict(self, track: LeaderTrack, times_s: FloatArray) -> LeaderPreview | None:
        """Return the bounded motion, None while no rule is known.

        Speeds above a limit are taken to be the driver's habit. A leader that stands at or in the queue of a
        closed line stays until it opens: until then its bound is constant, afterwards it grows.
        """
        if self._rules.limits is None and not self._rules.signals:
            return None
        last = track.last
        count = math.ceil(max(float(times_s[-1]) - last.time_s, 0.0) / _STEP_S) + 1
        fine: FloatArray = last.time_s + _STEP_S * np.arange(count + 1, dtype=np.float64)
        free = self._inner.predict(track, fine)
        if free is None:
            return None
        positions, speeds = self._obey(track, free, fine)
        reached = fine[: len(positions)]
        leads = np.maximum(times_s - self._known_until_s(track), 0.0)
        return replace(
            free,
            times_s=times_s,
            positions_m=np.interp(times_s, reached, positions),
            speeds_m_s=np.interp(times_s, reached, speeds),
            bounds_m=GROWTH.at(leads) + last.bound_m,
        )

    def _obey(
        self, track: LeaderTrack, free: LeaderPreview, fine: FloatArray
    ) -> tuple[list[float], list[float]]:
        last, length_m = track.last, track.length_m
        limits = self._rules.limits or NO_LIMITS
        # Without signals the leader may brake as hard as the other prediction expects.
        hardest_m_s2 = HARDEST_M_S2 if self._rules.signals else math.inf
        # Someone who drives 10 % above the limit here will do so there.
        habit = max(1.0, last.speed_m_s / limits.approach_at_m_s(last.position_m))
        positions, speeds = [last.position_m], [last.speed_m_s]
        halting_for = self._held_by(track)
        starting = False
        for time_s, free_m_s in zip(fine.tolist()[1:], free.speeds_m_s.tolist()[1:], strict=False):
            position, speed = positions[-1], speeds[-1]
            signal = self._rules.next_after(position + length_m)
            room_m = math.inf
            if signal is not None and not signal.is_open(time_s):
                room_m = signal.stop_line_m - length_m - position
                if signal is not halting_for and speed * speed > 2.0 * HARDEST_M_S2 * room_m:
                    room_m = math.inf
            stopping = math.sqrt(2.0 * BRAKING_M_S2 * room_m)
            if stopping < speed:
                halting_for = signal
            if halting_for is not None and halting_for.is_open(time_s):
                halting_for, starting = None, True
            wanted = speed + START_M_S2 * _STEP_S if starting else free_m_s
            if halting_for is not None:
                wanted, starting = speed, False
            allowed = habit * limits.approach_at_m_s(position)
            wanted = min(wanted, stopping, max(allowed, speed - 2.0 * BRAKING_M_S2 * _STEP_S))
            wanted = max(wanted, speed - hardest_m_s2 * _STEP_S, 0.0)
            moved = 0.5 * _STEP_S * (speed + wanted)
            positions.append(position + min(moved, room_m))
            speeds.append(wanted if moved <= room_m else 0.0)
        return positions, speeds

    def _held_by(self, track: LeaderTrack) -> Signal | None:
        """Return the closed line because of which the leader stands, None if it moves or none is near."""
        last = track.last
        if last.speed_m_s > STANDING_M_S:
            return None
        signal = self._rules.next_after(last.position_m + track.length_m)
        if signal is None or signal.is_open(last.time_s):
            return None
        return signal if signal.stop_line_m - last.position_m <= QUEUE_M else None

    def _known_until_s(self, track: LeaderTrack) -> float:
        """Return up to when the present position is known to stay."""
        time_s = track.last.time_s
        signal = self._held_by(track)
        return time_s if signal is None else max(time_s, signal.closed_until_s(time_s) - SLACK_S)
