"""Messages with the very same stamp put together, and which stamps belong to the trip.

A stamp is judged by the trip so far and by a steady clock. What follows the newest tick within reach is
taken at once; a stamp of 0 begins a new trip at once. Any other jump is taken for a stray stamp, until
the trip so far has been silent for a while and the jump has been confirmed: nothing that arrives once
can make a node deaf, and a plant whose time has really jumped is followed again after `quiet_s`.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Generic, TypeVar

from iptm_core.errors import ParameterError
from iptm_core.state import NS_PER_S
from iptm_ros.codecs.cdr import is_stamp

LEAST_REACH_NS = 10 * NS_PER_S
"""Smallest limit on the trip time between two ticks."""
REACH_STEPS = 10
"""The same limit in steps between ticks: a busy node misses some in real time."""
LEAST_QUIET_S = 1.0
"""Shortest steady time of silence of a trip before another time is accepted."""
QUIET_INTERVALS = 3.0
"""The same time in intervals between ticks (the shortest of the last few), for slow trips."""
RESTARTED_TICKS = 3
"""Ticks for which a trip that replaced another one counts as just begun."""
_SETTLED_TICKS = 3
_INTERVALS = 8
_RIVALS = 8


class Verdict(Enum):
    """Classification of a stamp against the trip."""

    NEXT = "next"
    """A later tick of the trip."""
    REPEATED = "repeated"
    """The newest tick again: a node has missed the answer."""
    NEW_TRIP = "new_trip"
    """Another trip, or a time that has really jumped."""
    RESUMED = "resumed"
    """The trip before the present one goes on: what began it was a stray stamp."""
    STRAY = "stray"
    """No stamp of the trip."""


class StampGate:
    """Follows the time of one trip, whose first stamp comes from anywhere; see the module.

    Attributes:
        strays: stamps turned away so far.
    """

    def __init__(self, steady_time_s: Callable[[], float] = time.monotonic) -> None:
        self._steady_time_s = steady_time_s
        self._now_ns: int | None = None
        self._step_ns = 0
        self._ticks = 0
        self._heard_s = 0.0
        self._begun_s = 0.0
        self._replaces = False
        self._intervals_s: deque[float] = deque(maxlen=_INTERVALS)
        self._before: tuple[int, int] | None = None
        self._rivals: deque[int] = deque(maxlen=_RIVALS)
        self.strays = 0

    @property
    def now_ns(self) -> int | None:
        """Stamp of the newest tick, None before the first."""
        return self._now_ns

    @property
    def has_restarted(self) -> bool:
        """Whether another trip took the place of the one so far, within the last `RESTARTED_TICKS` ticks."""
        return self._replaces and self._ticks < RESTARTED_TICKS

    @property
    def expected_ns(self) -> int:
        """Stamp at which the next tick would lie if the step stayed the same."""
        return (self._now_ns or 0) + self._step_ns

    @property
    def quiet_s(self) -> float:
        """Steady time for which the trip must be silent before another time is accepted."""
        return max(LEAST_QUIET_S, QUIET_INTERVALS * min(self._intervals_s, default=0.0))

    def follows(self, stamp_ns: int) -> bool:
        """Return whether a stamp may be a later tick of the trip, without judging it."""
        return self._now_ns is None or _within_reach(self._now_ns, self._step_ns, stamp_ns)

    def is_late(self, stamp_ns: int) -> bool:
        """Return whether a stamp lies within reach behind the newest tick, or on it."""
        now_ns = self._now_ns
        return now_ns is not None and (
            stamp_ns == now_ns or _within_reach(stamp_ns, self._step_ns, now_ns)
        )

    def may_resume(self, stamp_ns: int) -> bool:
        """Return whether a stamp may be a tick of the trip before, which a 0 has interrupted a moment ago."""
        if self._before is None:
            return False
        last_ns, step_ns = self._before
        return stamp_ns == last_ns or _within_reach(last_ns, step_ns, stamp_ns)

    def judge(self, stamp_ns: int) -> Verdict:
        """Judge a stamp and, unless it is a stray one, follow it."""
        if not is_stamp(stamp_ns):
            return self.turn_away()
        now_s = self._steady_time_s()
        last_ns = self._now_ns
        if stamp_ns == last_ns:
            self._heard_s = now_s
            return Verdict.REPEATED
        if last_ns is None:
            return self._begin(stamp_ns, now_s, Verdict.NEXT)
        follows = _within_reach(last_ns, self._step_ns, stamp_ns)
        # A trip of nothing but its beginning is the less credible one.
        if self.may_resume(stamp_ns) and not (follows and self._ticks):
            return self._begin(stamp_ns, now_s, Verdict.RESUMED)
        if follows:
            return self._go_on(last_ns, stamp_ns, now_s)
        if stamp_ns == 0:
            before = (last_ns, self._step_ns)
            verdict = self._begin(stamp_ns, now_s, Verdict.NEW_TRIP)
            self._before = before
            return verdict
        return self._judge_rival(stamp_ns, now_s)

    def turn_away(self) -> Verdict:
        """Count a stamp that cannot belong to any trip."""
        self.strays += 1
        return Verdict.STRAY

    def _begin(self, stamp_ns: int, now_s: float, verdict: Verdict) -> Verdict:
        if verdict is Verdict.RESUMED and self._before is not None:
            self._step_ns = self._before[1]
        self._now_ns, self._heard_s = stamp_ns, now_s
        self._begun_s, self._ticks = now_s, 0
        self._replaces = verdict is Verdict.NEW_TRIP
        self._before = None
        self._rivals.clear()
        return verdict

    def _go_on(self, last_ns: int, stamp_ns: int, now_s: float) -> Verdict:
        self._intervals_s.append(now_s - self._heard_s)
        self._step_ns = stamp_ns - last_ns
        self._now_ns, self._heard_s = stamp_ns, now_s
        self._ticks += 1
        if self._ticks >= _SETTLED_TICKS and now_s - self._begun_s >= LEAST_QUIET_S:
            self._before = None
        return Verdict.NEXT

    def _judge_rival(self, stamp_ns: int, now_s: float) -> Verdict:
        """Accept another time when it has come twice and the trip is silent."""
        confirmed = any(
            rival == stamp_ns or _within_reach(rival, 0, stamp_ns) for rival in self._rivals
        )
        if confirmed and now_s - self._heard_s >= self.quiet_s:
            return self._begin(stamp_ns, now_s, Verdict.NEW_TRIP)
        self._rivals.append(stamp_ns)
        return self.turn_away()


def _within_reach(last_ns: int, step_ns: int, stamp_ns: int) -> bool:
    return 0 < stamp_ns - last_ns <= max(LEAST_REACH_NS, REACH_STEPS * step_ns)


K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class MatchedSet(Generic[K]):
    """Messages of one stamp.

    Attributes:
        stamp_ns: the stamp.
        values: one value per slot; not all of them if it was handed out incomplete, none if it is the
            last set that was sent again.
        verdict: what the stamp is to the trip.
    """

    stamp_ns: int
    values: Mapping[K, Any]
    verdict: Verdict


class StampMatcher(Generic[K]):
    """Collects one value per named slot for each stamp and hands out complete sets.

    Stamps are compared as integer nanoseconds, never approximately. Only the leading slot, the state of the
    plant, advances the trip: messages in the other slots with stray stamps are discarded first. Sets leave in
    the order of the trip: once a set is complete, older ones are dropped, except those of a trip that a new
    one has just interrupted.

    Attributes:
        gate: judges the stamps of sets; it counts the stray ones.
        counts: sets `matched` (handed out) and `abandoned` (given up, because a newer one was handed out or
            memory was full); messages `late` (for a stamp not newer than the last set) and `duplicate`
            (replaced one of the same slot and stamp).
    """

    def __init__(
        self,
        leading: K,
        others: Iterable[K] = (),
        max_pending: int = 16,
        gate: StampGate | None = None,
        is_complete: Callable[[Mapping[K, Any]], bool] | None = None,
    ) -> None:
        """Set up a matcher.

        Args:
            leading: the slot that advances the time of the trip.
            others: further slots.
            max_pending: incomplete sets kept; beyond it one that is least likely the next tick is given up.
            is_complete: whether the values of a stamp make a set, by default of all slots.
        """
        if max_pending < 1:
            raise ParameterError(f"matcher has room for {max_pending} sets; allowed: at least 1")
        self._leading = leading
        self._slots = tuple(dict.fromkeys((leading, *others)))
        self._max_pending = max_pending
        self.gate = gate or StampGate()
        self._is_complete = is_complete or (lambda values: len(values) == len(self._slots))
        self._pending: dict[int, dict[K, Any]] = {}
        self.counts: Counter[str] = Counter()

    @property
    def last_ns(self) -> int | None:
        """Stamp of the last set handed out."""
        return self.gate.now_ns

    def put(self, slot: K, stamp_ns: int, value: Any) -> MatchedSet[K] | None:
        """Add a value; return the set if this was the last one missing.

        The last set is returned once more, without values, when its leading slot came again.
        """
        if slot not in self._slots:
            allowed = ", ".join(map(str, self._slots))
            raise ParameterError(f"matcher has no slot {slot!r}; allowed: {allowed}")
        if not is_stamp(stamp_ns):
            self.gate.turn_away()
            return None
        if self.gate.is_late(stamp_ns):
            self.counts["late"] += 1
            if stamp_ns == self.gate.now_ns:
                is_again = slot == self._leading
                return MatchedSet(stamp_ns, {}, self.gate.judge(stamp_ns)) if is_again else None
        values = self._pending.setdefault(stamp_ns, {})
        if slot in values:
            self.counts["duplicate"] += 1
        values[slot] = value
        if self._is_complete(values):
            return self._hand_out(stamp_ns)
        if len(self._pending) > self._max_pending:
            del self._pending[min(self._pending, key=self._likelihood)]
            self.counts["abandoned"] += 1
        return None

    def _hand_out(self, stamp_ns: int) -> MatchedSet[K] | None:
        values = self._pending.pop(stamp_ns)
        verdict = self.gate.judge(stamp_ns)
        if verdict is Verdict.STRAY:
            return None
        later = verdict is Verdict.NEXT
        over = [stamp for stamp in self._pending if not later or stamp < stamp_ns]
        for other in over:
            # A beginning may be a stray stamp, then the trip before goes on with what has come of its tick.
            if self.gate.may_resume(other):
                continue
            del self._pending[other]
            self.counts["abandoned"] += 1
        self.counts["matched"] += 1
        return MatchedSet(stamp_ns, values, verdict)

    def _likelihood(self, stamp_ns: int) -> tuple[bool, bool, int]:
        """Return what orders pending sets by how likely they become the next tick."""
        distance_ns = abs(stamp_ns - self.gate.expected_ns)
        return self.gate.follows(stamp_ns), self._leading in self._pending[stamp_ns], -distance_ns

    def _candidates(self) -> list[int]:
        """Stamps of the pending sets that may be handed out as they are, of the trip if there are any.

        They have the leading slot; or it alone is missing, in a set of the trip.
        """
        led = [stamp for stamp, values in self._pending.items() if self._leading in values]
        of_trip = [stamp for stamp in led if self.gate.follows(stamp)]
        answered = [
            stamp
            for stamp, values in self._pending.items()
            if self.gate.follows(stamp) and self._is_complete({**values, self._leading: None})
        ]
        return of_trip or answered or led

    @property
    def is_waiting(self) -> bool:
        """Whether a set is there that lacks something."""
        return bool(self._candidates())

    @property
    def backlog_ns(self) -> int:
        """Time from the last set to the newest one of the trip that has the leading slot.

        0 while there is only one such set: then the plant may be waiting for the answer.
        """
        led = [
            stamp
            for stamp, values in self._pending.items()
            if self._leading in values and self.gate.follows(stamp)
        ]
        if len(led) < 2:
            return 0
        last_ns = self.gate.now_ns
        return max(led) - (min(led) if last_ns is None else last_ns)

    def missing(self) -> tuple[int, tuple[K, ...]] | None:
        """Return stamp and missing slots of the set that `take_incomplete` would hand out."""
        stamp_ns = max(self._candidates(), default=None)
        if stamp_ns is None:
            return None
        values = self._pending[stamp_ns]
        return stamp_ns, tuple(slot for slot in self._slots if slot not in values)

    def take_incomplete(self) -> MatchedSet[K] | None:
        """Hand out the newest of the sets that may be the next tick, for a fallback answer."""
        waiting = self.missing()
        return None if waiting is None else self._hand_out(waiting[0])
