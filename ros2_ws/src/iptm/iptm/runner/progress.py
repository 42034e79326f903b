"""Shows how far a run is: a bar on a terminal, a line every few seconds elsewhere."""

from __future__ import annotations

import math
import time
from pathlib import Path

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from iptm.runner.monitor import Snapshot
from iptm_core.decision_record import Rung
from iptm_core.units import KM_H_PER_M_S

LINE_PERIOD_S = 5.0
_BAR_WIDTH = 60


class Progress:
    """Display of the progress of a run: this one shows nothing, its subclasses do."""

    def waiting(self, reason: str) -> None:
        """Show what the start waits for."""

    def running(self, snapshot: Snapshot, wall_s: float) -> None:
        """Show the state of the run, `wall_s` after its first state."""

    def close(self) -> None:
        """Leave the terminal as it was."""


def make_progress(console: Console, duration_s: float, file: Path | None = None) -> Progress:
    """Return what suits the console, for a trip of a length; a file takes its place."""
    if file is not None:
        return FileProgress(file)
    shown = BarProgress if console.is_terminal else LineProgress
    return shown(console, duration_s)


class FileProgress(Progress):
    """Trip time in a file that exists once the trip has begun, for a program that drives several runs."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def running(self, snapshot: Snapshot, wall_s: float) -> None:  # noqa: ARG002
        """Write the trip time in s."""
        new = self._path.with_suffix(".new")
        new.write_text(f"{snapshot.time_s!r}\n", encoding="utf-8")
        new.replace(self._path)


def read_progress(path: Path) -> float | None:
    """Return the trip time in s that `FileProgress` wrote, None before the trip has begun."""
    try:
        return float(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None


class BarProgress(Progress):
    """A bar with the state of the run below it, redrawn in place."""

    def __init__(self, console: Console, duration_s: float) -> None:
        self._duration_s = duration_s
        # Refreshed by hand: a thread of its own would compete with the nodes.
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._live.start()

    def waiting(self, reason: str) -> None:
        """Show what the start waits for."""
        self._show(Text(f"starting: {reason}", style="dim"))

    def running(self, snapshot: Snapshot, wall_s: float) -> None:
        """Draw the state of the run."""
        bar = Table.grid(padding=(0, 2))
        bar.add_row(
            ProgressBar(self._duration_s, snapshot.time_s, width=_BAR_WIDTH),
            f"{_share(snapshot, self._duration_s):.0%}",
            f"{snapshot.time_s:.0f} of {self._duration_s:.0f} s",
        )
        rung = snapshot.rung
        details = Table.grid(padding=(0, 3))
        details.add_row(
            f"[bold]{_speed_up(snapshot, wall_s):.0f}[/] x real time",
            f"remaining [bold]{_remaining(snapshot, wall_s, self._duration_s)}[/]",
            f"speed [bold]{KM_H_PER_M_S * snapshot.speed_m_s:.1f}[/] km/h",
            f"gap [bold]{_gap(snapshot)}[/]",
        )
        details.add_row(
            f"solve [bold]{_milliseconds(snapshot)}[/]",
            f"iterations [bold]{snapshot.iterations}[/]",
            f"cells [bold]{snapshot.cell_1_temperature_c:.1f}[/] /"
            f" [bold]{snapshot.cell_n_temperature_c:.1f}[/] °C",
            "" if rung is Rung.OPTIMAL else f"[bold yellow]{_words(rung)}[/]",
        )
        self._show(Group(bar, details))

    def close(self) -> None:
        """Remove the bar."""
        self._live.stop()

    def _show(self, content: Text | Group) -> None:
        self._live.update(content, refresh=True)


class LineProgress(Progress):
    """A plain line now and then, for logs and pipes."""

    def __init__(self, console: Console, duration_s: float) -> None:
        self._console = console
        self._duration_s = duration_s
        self._reason = ""
        self._has_begun = False
        self._last_s = -math.inf

    def waiting(self, reason: str) -> None:
        """Print what the start waits for, when that changes and not too often."""
        if reason != self._reason and self._is_due():
            self._reason = reason
            self._print(f"starting: {reason}")

    def running(self, snapshot: Snapshot, wall_s: float) -> None:
        """Print the state of the run when the trip has begun, and then now and again."""
        if not self._is_due() and self._has_begun:
            return
        self._has_begun = True
        rung = snapshot.rung
        fallback = "" if rung is Rung.OPTIMAL else f", {_words(rung)}"
        self._print(
            f"{snapshot.time_s:.0f} of {self._duration_s:.0f} s"
            f" ({_share(snapshot, self._duration_s):.0%}),"
            f" {_speed_up(snapshot, wall_s):.0f} x real time,"
            f" remaining {_remaining(snapshot, wall_s, self._duration_s)},"
            f" speed {KM_H_PER_M_S * snapshot.speed_m_s:.1f} km/h, gap {_gap(snapshot)},"
            f" cells {snapshot.cell_1_temperature_c:.1f}/{snapshot.cell_n_temperature_c:.1f} °C,"
            f" solve {_milliseconds(snapshot)}, {snapshot.iterations} iterations{fallback}"
        )

    def _is_due(self) -> bool:
        now_s = time.monotonic()
        if now_s - self._last_s < LINE_PERIOD_S:
            return False
        self._last_s = now_s
        return True

    def _print(self, line: str) -> None:
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)


def _share(snapshot: Snapshot, duration_s: float) -> float:
    return min(snapshot.time_s / duration_s, 1.0)


def _speed_up(snapshot: Snapshot, wall_s: float) -> float:
    return snapshot.time_s / wall_s if wall_s > 0.0 else 0.0


def _remaining(snapshot: Snapshot, wall_s: float, duration_s: float) -> str:
    speed_up = _speed_up(snapshot, wall_s)
    if speed_up <= 0.0:
        return "?"
    minutes, seconds = divmod(math.ceil((duration_s - snapshot.time_s) / speed_up), 60)
    return f"{minutes}:{seconds:02d} min" if minutes else f"{seconds} s"


def _gap(snapshot: Snapshot) -> str:
    return "unknown" if math.isnan(snapshot.gap_m) else f"{snapshot.gap_m:.1f} m"


def _milliseconds(snapshot: Snapshot) -> str:
    known = math.isfinite(snapshot.solve_time_s)
    return f"{1e3 * snapshot.solve_time_s:.1f} ms" if known else "none"


def _words(rung: Rung) -> str:
    return rung.name.lower().replace("_", " ")
