"""Playback position and its controls (pause, rate, seek, single step); free of ROS."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from enum import Enum

from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

LINE_PERIOD_S = 5.0
_BAR_WIDTH = 60


class PlaybackProgress:
    """Progress of one playback; lines that others print meanwhile appear above its bar."""

    def __init__(
        self,
        console: Console,
        start_s: float,
        end_s: float,
        steady_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._console = console
        self._start_s = start_s
        self._end_s = end_s
        self._steady_s = steady_s
        self._next_line_s = steady_s() + LINE_PERIOD_S
        self._live: Live | None = None
        if console.is_terminal:
            # Refreshed by hand: a thread of its own would compete with the playback.
            self._live = Live(console=console, auto_refresh=False, transient=True)
            self._live.start()

    def show(self, at_s: float, rate: float, *, is_paused: bool) -> None:
        """Show where the playback stands; call it a few times a second."""
        at_s = min(max(at_s, self._start_s), self._end_s)
        place = f"{at_s:.1f} of {self._end_s:.1f} s"
        if self._live is not None:
            bar = Table.grid(padding=(0, 2))
            # A part of no length is played at once.
            length_s = (self._end_s - self._start_s) or 1.0
            bar.add_row(
                ProgressBar(length_s, at_s - self._start_s, width=_BAR_WIDTH),
                place,
                "paused" if is_paused else f"{rate:g} x recorded speed",
            )
            self._live.update(bar, refresh=True)
        elif not is_paused and self._steady_s() >= self._next_line_s:
            self._next_line_s = self._steady_s() + LINE_PERIOD_S
            self._console.print(f"at {place}", markup=False, highlight=False, soft_wrap=True)

    def close(self) -> None:
        """Leave the terminal as it was; a second call is free."""
        if self._live is not None:
            self._live.stop()


# Longest single wait: others overflow the clock of the operating system.
_LONGEST_WAIT_S = 3600.0


class WaitOutcome(Enum):
    """Why a wait ended."""

    DUE = "the message is to be played now"
    EARLY = "it is not, but the time that was given is over"
    SOUGHT = "a seek was requested"
    STOPPED = "a stop was requested"


class PlaybackControl:
    """Clock of a playback, in recorded time; one thread waits on it, any other may change it.

    Args:
        position_ns: recorded time at which to begin.
        rate: recorded time that passes in a second.
        is_paused: begin paused.
        steady_s: steady time of the computer.
    """

    def __init__(
        self,
        position_ns: int,
        rate: float,
        *,
        is_paused: bool = False,
        steady_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._condition = threading.Condition()
        self._steady_s = steady_s
        self._anchor_s = steady_s()
        self._anchor_ns = position_ns
        self._rate = rate
        self._is_paused = is_paused
        self._sought_ns: int | None = None
        self._steps = 0
        self._is_stopped = False

    @property
    def is_paused(self) -> bool:
        """Whether recorded time stands still."""
        return self._is_paused

    @property
    def is_stopped(self) -> bool:
        """Whether the end was asked for."""
        return self._is_stopped

    @property
    def rate(self) -> float:
        """Recorded time that passes in a second while not paused."""
        return self._rate

    @property
    def position_ns(self) -> int:
        """Recorded time now."""
        with self._condition:
            return self._position_ns()

    def begin(self, position_ns: int) -> None:
        """Set the start position of a playback, without waking the waiting thread."""
        with self._condition:
            self._move_to(position_ns)

    def pause(self, *, is_paused: bool) -> None:
        """Let recorded time stand still, or go on."""
        with self._condition:
            self._move_to(self._position_ns())
            self._is_paused = is_paused
            self._steps = 0
            self._condition.notify_all()

    def set_rate(self, rate: float) -> None:
        """Go on with another rate."""
        with self._condition:
            self._move_to(self._position_ns())
            self._rate = rate
            self._condition.notify_all()

    def seek(self, position_ns: int) -> None:
        """Request another position and wake the waiting thread."""
        with self._condition:
            self._sought_ns = position_ns
            self._steps = 0
            self._condition.notify_all()

    def take_sought(self) -> int | None:
        """Return the position asked for, once."""
        with self._condition:
            sought_ns, self._sought_ns = self._sought_ns, None
            return sought_ns

    def step(self) -> bool:
        """Ask for the next message of a paused playback; return False if it is not paused."""
        with self._condition:
            if self._is_paused:
                self._steps += 1
                self._condition.notify_all()
            return self._is_paused

    def stop(self) -> None:
        """Ask for the end."""
        with self._condition:
            self._is_stopped = True
            self._condition.notify_all()

    def sleep(self, seconds: float) -> bool:
        """Sleep regardless of seeks; return True when stopped."""
        with self._condition:
            return self._condition.wait_for(lambda: self._is_stopped, min(seconds, _LONGEST_WAIT_S))

    def wait(self, due_ns: int, longest_s: float | None = None) -> WaitOutcome:
        """Wait until something of a recorded time is due.

        Args:
            due_ns: recorded time.
            longest_s: time of the computer after which to return in any case; None for no limit.
        """
        with self._condition:
            limit_s = None if longest_s is None else self._steady_s() + longest_s
            while True:
                if self._is_stopped:
                    return WaitOutcome.STOPPED
                if self._sought_ns is not None:
                    return WaitOutcome.SOUGHT
                left_s = _LONGEST_WAIT_S
                if not self._is_paused:
                    left_s = (due_ns - self._position_ns()) * 1e-9 / self._rate
                    if left_s <= 0.0:
                        return WaitOutcome.DUE
                elif self._steps:
                    self._steps -= 1
                    self._move_to(max(due_ns, self._position_ns()))
                    return WaitOutcome.DUE
                if limit_s is not None:
                    early_s = limit_s - self._steady_s()
                    if early_s <= 0.0:
                        return WaitOutcome.EARLY
                    left_s = min(left_s, early_s)
                self._condition.wait(min(left_s, _LONGEST_WAIT_S))

    def _position_ns(self) -> int:
        if self._is_paused:
            return self._anchor_ns
        passed_s = self._steady_s() - self._anchor_s
        return self._anchor_ns + round(passed_s * self._rate * 1e9)

    def _move_to(self, position_ns: int) -> None:
        self._anchor_s = self._steady_s()
        self._anchor_ns = position_ns
