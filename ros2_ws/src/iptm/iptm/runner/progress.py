"""Shows how far a run is: a bar on a terminal, a line every few seconds elsewhere."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from iptm_core.decision_record import Rung
from iptm_core.program import print_error
from iptm_core.units import KM_H_PER_M_S

if TYPE_CHECKING:
    from iptm.runner.monitor import Snapshot

PROGRAM = "iptm run"
LINE_PERIOD_S = 5.0
_BAR_WIDTH = 60


class Progress:
    """Display of the progress of a run: this one shows nothing, its subclasses do."""

    def waiting(self, reason: str) -> None:
        """Show what the start waits for."""

    def running(self, snapshot: Snapshot, wall_s: float) -> None:
        """Show the state of the run, `wall_s` after its first state."""

    def failed(self, reason: str) -> None:
        """Show why the run does not come to its end, before its processes are ended."""

    def close(self) -> None:
        """Leave the terminal as it was."""


class ConsoleProgress(Progress):
    """The state of the run: below a bar on a terminal, elsewhere a line now and then, for logs and pipes."""

    def __init__(self, console: Console, duration_s: float) -> None:
        self._console, self._duration_s = console, duration_s
        self._reason, self._has_begun, self._last_s = "", False, -math.inf
        self._live: Live | None = None
        if console.is_terminal:
            # Refreshed by hand: a thread of its own would compete with the nodes.
            self._live = Live(console=console, auto_refresh=False, transient=True)
            self._live.start()

    def waiting(self, reason: str) -> None:
        """Show what the start waits for; as a line when that changes, and not too often."""
        if self._live is not None:
            self._live.update(Text(f"starting: {reason}", style="dim"), refresh=True)
        elif reason != self._reason and self._is_due():
            self._reason = reason
            self._print(f"starting: {reason}")

    def running(self, snapshot: Snapshot, wall_s: float) -> None:
        """Show the state of the run; as a line when the trip has begun, and then now and again."""
        if self._live is not None:
            bar = Table.grid()
            bar.add_row(ProgressBar(self._duration_s, snapshot.time_s, width=_BAR_WIDTH))
            self._live.update(Group(bar, Text(self._state(snapshot, wall_s))), refresh=True)
        elif self._is_due() or not self._has_begun:
            self._has_begun = True
            self._print(self._state(snapshot, wall_s))

    def failed(self, reason: str) -> None:
        """Print it as an error below the display."""
        self.close()
        print_error(PROGRAM, reason)

    def close(self) -> None:
        """Remove the bar."""
        if self._live is not None:
            self._live.stop()

    def _state(self, snapshot: Snapshot, wall_s: float) -> str:
        rung = snapshot.rung
        fallback = "" if rung is Rung.OPTIMAL else f", {rung.name.lower().replace('_', ' ')}"
        gap = "unknown" if math.isnan(snapshot.gap_m) else f"{snapshot.gap_m:.1f} m"
        known = math.isfinite(snapshot.solve_time_s)
        solve = f"{1e3 * snapshot.solve_time_s:.1f} ms" if known else "none"
        speed_up = snapshot.time_s / wall_s if wall_s > 0.0 else 0.0
        return (
            f"{snapshot.time_s:.0f} of {self._duration_s:.0f} s"
            f" ({min(snapshot.time_s / self._duration_s, 1.0):.0%}), {speed_up:.0f} x real time,"
            f" remaining {_remaining(self._duration_s - snapshot.time_s, speed_up)},"
            f" speed {KM_H_PER_M_S * snapshot.speed_m_s:.1f} km/h, gap {gap},"
            f" cells {snapshot.cell_1_temperature_c:.1f}/{snapshot.cell_n_temperature_c:.1f} °C,"
            f" solve {solve}, {snapshot.iterations} iterations{fallback}"
        )

    def _is_due(self) -> bool:
        now_s = time.monotonic()
        if now_s - self._last_s < LINE_PERIOD_S:
            return False
        self._last_s = now_s
        return True

    def _print(self, line: str) -> None:
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)


def _remaining(left_s: float, speed_up: float) -> str:
    if speed_up <= 0.0:
        return "?"
    minutes, seconds = divmod(math.ceil(left_s / speed_up), 60)
    return f"{minutes}:{seconds:02d} min" if minutes else f"{seconds} s"
