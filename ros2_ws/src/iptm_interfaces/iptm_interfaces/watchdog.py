"""Notice silence on the steady clock: trip time stands still exactly when something hangs."""

from __future__ import annotations

import time
from collections.abc import Callable

from iptm_core.errors import ParameterError
from iptm_interfaces.suite_node import SuiteNode

_CHECKS_PER_TIMEOUT = 5.0


class Watchdog:
    """Calls back once when nothing has fed it for a while; feeding arms it again.

    It starts unarmed, so that the wait for the first message is not taken for a failure.
    """

    def __init__(
        self,
        timeout_s: float,
        on_silence: Callable[[float], None],
        steady_time_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Set up a watchdog; see `attach` for the timer.

        Args:
            timeout_s: permitted silence, positive.
            on_silence: called once per silence with its length so far in seconds.
            steady_time_s: clock in seconds, replaceable in tests.
        """
        if not timeout_s > 0.0:
            raise ParameterError(f"watchdog timeout is {timeout_s} s; allowed: above 0")
        self.timeout_s = timeout_s
        self._on_silence = on_silence
        self._steady_time_s = steady_time_s
        self._fed_s: float | None = None
        self._reported = False

    def feed(self) -> None:
        """Note a sign of life."""
        self._fed_s = self._steady_time_s()
        self._reported = False

    def disarm(self) -> None:
        """Expect nothing any more until it is fed again."""
        self._fed_s = None
        self._reported = False

    @property
    def is_silent(self) -> bool:
        """Whether the present silence has been reported."""
        return self._reported

    def check(self) -> None:
        """Report the silence if it has become too long."""
        if self._fed_s is None or self._reported:
            return
        silence_s = self._steady_time_s() - self._fed_s
        if silence_s > self.timeout_s:
            self._reported = True
            self._on_silence(silence_s)

    def attach(self, node: SuiteNode) -> Watchdog:
        """Check regularly on a timer of the node; return the watchdog itself.

        From now on only such silence counts in which the node itself was running.
        """
        self._steady_time_s = node.awake.now_s
        node.every(self.timeout_s / _CHECKS_PER_TIMEOUT, self.check)
        return self
