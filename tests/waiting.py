"""Waiting for a condition, with a timeout for a busy machine and a report of missing nodes and messages."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

POLL_S = 0.01
PATIENCE_S = 120.0
"""Far above what anything takes here that is not broken."""


def wait_until(
    condition: Callable[[], object],
    timeout_s: float = PATIENCE_S,
    what: str = "condition",
    pause: Callable[[float], object] = time.sleep,
    found: Callable[[], str] = str,
) -> None:
    """Wait until a condition is true; fail the test, naming it, if that takes too long.

    A condition that looks up a message that has not arrived yet does not hold.

    Args:
        condition: is evaluated between pauses.
        timeout_s: wall time.
        what: is waited for.
        pause: waits for a time in s, or does the work meanwhile.
        found: describes what there is instead, after a timeout.
    """
    deadline_s = time.monotonic() + timeout_s
    while True:
        missing = ""
        try:
            if condition():
                return
        except LookupError as error:
            missing = f" ({error!r})"
        if time.monotonic() > deadline_s:
            pytest.fail(f"timed out after {timeout_s} s waiting for: {what}{missing}\n{found()}")
        pause(POLL_S)
