"""Shows where a playback stands: a bar on a terminal, a line every few seconds elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable

from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

LINE_PERIOD_S = 5.0
_BAR_WIDTH = 60


class PlaybackProgress:
    """Progress of one playback; lines that others print meanwhile appear above its bar.

    Args:
        console: where to show it.
        start_s: offset into the bag at which the part begins.
        end_s: offset at which it ends.
        steady_s: steady time of the computer.
    """

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
        """Show where the playback stands; call it a few times a second.

        Args:
            at_s: offset into the bag.
            rate: playback speed over recorded speed.
            is_paused: whether it stands still.
        """
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
