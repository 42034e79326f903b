"""Signals of the road ahead, and a prediction of a leader that obeys them and the speed limits.

Signals have a periodic plan, or the phases of their messages. Yellow counts as closed.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.road_ahead import BRAKING_M_S2, SpeedLimits
from iptm_core.state import FloatArray
from iptm_v2x_bridge.prediction.predictor import (
    Knowledge,
    Prediction,
    Predictor,
    PredictorName,
)
from iptm_v2x_bridge.prediction.speed_limits import GROWTH

STANDING_M_S = 0.1
QUEUE_M = 60.0
"""A leader that stands this close behind a closed line stands because of it."""
HARDEST_M_S2 = 2.5
"""Drivers who would have to brake harder for a line that has just closed pass it."""
START_M_S2 = 1.2
"""Acceleration with which drivers start when the line opens."""
SLACK_S = 1.0
"""Time before its planned opening at which a line may open; bounds the prediction of a standing leader."""
_STEP_S = 0.25


class Signal(Protocol):
    """One stop line. Times are s of TimestampIts."""

    @property
    def stop_line_m(self) -> float:
        """Position along the road."""
        ...

    def is_open(self, time_s: float) -> bool:
        """Return whether the line may be passed at an instant."""
        ...

    def open_until_s(self, time_s: float) -> float:
        """Return when the line closes that is open now; now if it is closed; infinite if it never does."""
        ...

    def closed_until_s(self, time_s: float) -> float:
        """Return when the line opens that is closed now; now if it is open; infinite if it never does."""
        ...


@dataclass(frozen=True)
class CyclicSignal:
    """One stop line with a plan that repeats itself.

    Attributes:
        stop_line_m: position along the road.
        cycle_s: time after which the plan repeats itself, above 0.
        opens_at_s: an instant at which it turns green, s of TimestampIts.
        open_for_s: how long it is green then; 0 to the cycle.

    Raises:
        RouteError: a value is not finite or out of range.
    """

    stop_line_m: float
    cycle_s: float
    opens_at_s: float
    open_for_s: float

    def __post_init__(self) -> None:
        finite = all(math.isfinite(value) for value in vars(self).values())
        if not (finite and self.cycle_s > 0.0 and 0.0 <= self.open_for_s <= self.cycle_s):
            raise RouteError(
                f"signal is {self}; allowed: finite numbers, cycle_s above 0, open_for_s from 0 to cycle_s"
            )

    def is_open(self, time_s: float) -> bool:
        """See `Signal`."""
        return (time_s - self.opens_at_s) % self.cycle_s < self.open_for_s

    def open_until_s(self, time_s: float) -> float:
        """See `Signal`."""
        if self.open_for_s == self.cycle_s:
            return math.inf
        inside = (time_s - self.opens_at_s) % self.cycle_s
        return time_s + max(self.open_for_s - inside, 0.0)

    def closed_until_s(self, time_s: float) -> float:
        """See `Signal`."""
        if self.is_open(time_s):
            return time_s
        if self.open_for_s == 0.0:
            return math.inf
        return time_s + self.cycle_s - (time_s - self.opens_at_s) % self.cycle_s


@dataclass(frozen=True)
class SwitchedSignal:
    """One stop line that is closed for certain times and open for all others.

    Attributes:
        stop_line_m: position along the road.
        closed_s: beginnings and ends of these times, possibly infinite, increasing and apart from each other.
    """

    stop_line_m: float
    closed_s: tuple[tuple[float, float], ...]

    def _closed_at(self, time_s: float) -> tuple[float, float] | None:
        return next((span for span in self.closed_s if span[0] <= time_s < span[1]), None)

    def is_open(self, time_s: float) -> bool:
        """See `Signal`."""
        return self._closed_at(time_s) is None

    def open_until_s(self, time_s: float) -> float:
        """See `Signal`."""
        if not self.is_open(time_s):
            return time_s
        return min((begins for begins, _ in self.closed_s if begins > time_s), default=math.inf)

    def closed_until_s(self, time_s: float) -> float:
        """See `Signal`."""
        span = self._closed_at(time_s)
        return time_s if span is None else span[1]


@dataclass(frozen=True)
class SignalPlan:
    """The signals along the road.

    Attributes:
        signals: in driving order.

    Raises:
        RouteError: the positions do not increase.
    """

    signals: tuple[Signal, ...]

    def __post_init__(self) -> None:
        places = [signal.stop_line_m for signal in self.signals]
        if any(later <= earlier for earlier, later in pairwise(places)):
            raise RouteError(f"stop lines are at {places} m; allowed: increasing positions")

    def next_after(self, position_m: float) -> Signal | None:
        """Return the first signal whose stop line lies beyond a position, None if there is none."""
        index = bisect_right(self.signals, position_m, key=lambda signal: signal.stop_line_m)
        return self.signals[index] if index < len(self.signals) else None


class BoundedBySignals:
    """Takes another prediction and keeps it within speed limits and behind closed stop lines."""

    def __init__(self, inner: Predictor, limits: SpeedLimits, plan: SignalPlan) -> None:
        self._inner, self._limits, self._plan = inner, limits, plan

    def predict(self, known: Knowledge, times_s: FloatArray) -> Prediction | None:
        """Return the bounded motion.

        A leader that stands at or in the queue of a closed line stays until it opens: until then its bound
        is constant, afterwards it grows.
        """
        last = known.last
        count = math.ceil(max(float(times_s[-1]) - last.time_s, 0.0) / _STEP_S) + 1
        fine: FloatArray = last.time_s + _STEP_S * np.arange(count + 1, dtype=np.float64)
        free = self._inner.predict(known, fine)
        if free is None:
            return None
        positions, speeds = self._obey(known, free, fine)
        reached = fine[: len(positions)]
        leads = np.maximum(times_s - self._known_until_s(known), 0.0)
        return replace(
            free,
            predictor=PredictorName.SIGNALS,
            times_s=times_s,
            positions_m=np.interp(times_s, reached, positions),
            speeds_m_s=np.interp(times_s, reached, speeds),
            bounds_m=GROWTH.at(leads) + last.bound_m,
        )

    def _obey(
        self, known: Knowledge, free: Prediction, fine: FloatArray
    ) -> tuple[list[float], list[float]]:
        last, length_m = known.last, known.length_m
        habit = max(1.0, last.speed_m_s / self._limits.approach_at_m_s(last.position_m))
        positions, speeds = [last.position_m], [last.speed_m_s]
        halting_for = self._held_by(known)
        starting = False
        for time_s, free_m_s in zip(fine.tolist()[1:], free.speeds_m_s.tolist()[1:], strict=False):
            position, speed = positions[-1], speeds[-1]
            signal = self._plan.next_after(position + length_m)
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
            allowed = habit * self._limits.approach_at_m_s(position)
            wanted = min(wanted, stopping, max(allowed, speed - 2.0 * BRAKING_M_S2 * _STEP_S))
            wanted = max(wanted, speed - HARDEST_M_S2 * _STEP_S, 0.0)
            moved = 0.5 * _STEP_S * (speed + wanted)
            positions.append(position + min(moved, room_m))
            speeds.append(wanted if moved <= room_m else 0.0)
        return positions, speeds

    def _held_by(self, known: Knowledge) -> Signal | None:
        """Return the closed line because of which the leader stands, None if it moves or none is near."""
        last = known.last
        if last.speed_m_s > STANDING_M_S:
            return None
        signal = self._plan.next_after(last.position_m + known.length_m)
        if signal is None or signal.is_open(last.time_s):
            return None
        return signal if signal.stop_line_m - last.position_m <= QUEUE_M else None

    def _known_until_s(self, known: Knowledge) -> float:
        """Return up to when the present position is known to stay."""
        time_s = known.last.time_s
        signal = self._held_by(known)
        return time_s if signal is None else max(time_s, signal.closed_until_s(time_s) - SLACK_S)
