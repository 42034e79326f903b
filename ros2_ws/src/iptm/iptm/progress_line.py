"""One line about a drive in memory that goes on: how far it has come, and the time that is left."""

from __future__ import annotations

import sys
import time
from contextlib import AbstractContextManager

_EVERY_S = 0.5
_QUIET_S = 2.0


class ProgressLine(AbstractContextManager["ProgressLine"]):
    """A line on standard error, on terminals and in notebooks only; use it as a context manager.

    A drive that is over in two seconds shows nothing.
    """

    def __init__(self, name: str, steps: int) -> None:
        self._name, self._steps = name, steps
        self._is_shown = sys.stderr.isatty() or "ipykernel" in sys.modules
        self._began_s = self._shown_s = time.monotonic()
        self._first_s = self._began_s
        self._done = self._width = 0
        self._write(f"{name}: setting up; a problem of a new kind is compiled once ...")

    def __exit__(self, *error: object) -> None:
        """Clear the line."""
        self._write("")

    def step(self, *_: object) -> None:
        """Count one step."""
        now_s = time.monotonic()
        if not self._done:
            self._first_s = now_s
        self._done += 1
        if now_s - self._began_s < _QUIET_S or now_s - self._shown_s < _EVERY_S:
            return
        self._shown_s = now_s
        left_s = (now_s - self._first_s) / self._done * (self._steps - self._done)
        percent = 100.0 * self._done / self._steps
        self._write(f"{self._name}: {percent:.0f} %, {max(left_s, 0.0):.0f} s left")

    def _write(self, text: str) -> None:
        if self._is_shown:
            sys.stderr.write(f"\r{text:<{self._width}}\r{text}")
            sys.stderr.flush()
            self._width = len(text)
