"""Trip time by the steady clock: lateness against a fixed schedule, and the times between two ticks."""

from __future__ import annotations

import time
from collections.abc import Callable

from iptm_core.state import NS_PER_S


class Schedule:
    """Counts the missed slots of a periodic activity.

    Missed slots are skipped: after a delay the activity continues with the next slot, so that
    subscribers get no burst.

    Attributes:
        overruns: slots missed so far.
        worst_lateness_s: longest delay of a call behind its slot.
    """

    def __init__(
        self, period_s: float, steady_time_s: Callable[[], float] = time.monotonic
    ) -> None:
        """Set up a schedule whose first slot lies one period ahead of now."""
        self._period_s = period_s
        self._steady_time_s = steady_time_s
        self._next_s = steady_time_s() + period_s
        self.overruns = 0
        self.worst_lateness_s = 0.0

    def begin_again(self) -> None:
        """Restart one period ahead of now, after an intended pause."""
        self._next_s = self._steady_time_s() + self._period_s

    def keep(self) -> None:
        """Note that the activity runs now."""
        lateness_s = self._steady_time_s() - self._next_s
        missed = max(0, int(lateness_s // self._period_s))
        self.overruns += missed
        self.worst_lateness_s = max(self.worst_lateness_s, lateness_s)
        self._next_s += (missed + 1) * self._period_s


class TimeBetweenTicks:
    """Trip time that has passed since the last tick, and never reaches the next one."""

    def __init__(
        self,
        period_s: float,
        rate_factor: float = 1.0,
        steady_time_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Set up a time that has not begun."""
        self._last_ns = round(period_s * NS_PER_S) - 1
        self._rate_factor = rate_factor
        self._steady_time_s = steady_time_s
        self._tick_ns = 0
        self._began_s = 0.0
        self._taken_ns = self._last_ns

    def begin(self, tick_ns: int) -> None:
        """Begin at a tick, which is being published now."""
        self._tick_ns, self._began_s, self._taken_ns = tick_ns, self._steady_time_s(), 0

    def end(self) -> None:
        """Give no more times before the next beginning."""
        self._taken_ns = self._last_ns

    def take_ns(self) -> int | None:
        """Return the present trip time; None where it is not later than what was taken before."""
        passed_ns = round((self._steady_time_s() - self._began_s) * self._rate_factor * NS_PER_S)
        passed_ns = min(passed_ns, self._last_ns)
        if passed_ns <= self._taken_ns:
            return None
        self._taken_ns = passed_ns
        return self._tick_ns + passed_ns
