"""Lateness against a fixed schedule on the steady clock."""

from __future__ import annotations

import time
from collections.abc import Callable


class Schedule:
    """Counts what a periodic activity missed, judged by when it should have run.

    A slot that is missed is not made up for: after a delay the activity goes on with the next slot, so
    that nobody downstream is hit by a burst.

    Attributes:
        overruns: slots missed so far.
        worst_lateness_s: longest delay of a call behind its slot.
    """

    def __init__(
        self, period_s: float, steady_time_s: Callable[[], float] = time.monotonic
    ) -> None:
        """Set up a schedule whose first slot lies one period ahead of now.

        Args:
            period_s: time between slots.
            steady_time_s: clock in seconds, replaceable in tests.
        """
        self._period_s = period_s
        self._steady_time_s = steady_time_s
        self._next_s = steady_time_s() + period_s
        self.overruns = 0
        self.worst_lateness_s = 0.0

    def keep(self) -> None:
        """Note that the activity runs now."""
        lateness_s = self._steady_time_s() - self._next_s
        missed = max(0, int(lateness_s // self._period_s))
        self.overruns += missed
        self.worst_lateness_s = max(self.worst_lateness_s, lateness_s)
        self._next_s += (missed + 1) * self._period_s
