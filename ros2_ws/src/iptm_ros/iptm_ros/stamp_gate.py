"""Which stamps belong to the trip.

A stamp is judged by the trip so far and by a steady clock. What follows the newest tick within reach is
taken at once; a stamp of 0 begins a new trip at once. Any other jump is taken for a stray stamp, until
the trip so far has been silent for a while and the jump has been confirmed: nothing that arrives once
can make a node deaf, and a plant whose time has really jumped is followed again after `quiet_s`.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from enum import Enum

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
