"""What the user sees while a campaign is computed: a bar with the time left, and a line per run."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from iptm_studies.campaign import PlannedRun
from iptm_studies.expected_time import clock_text
from iptm_studies.stored_run import StoredRun


@contextmanager
def progress_display(console: Console) -> Iterator[ProgressDisplay]:
    """Show the progress of what is computed inside the block."""
    display = ProgressDisplay(console)
    with display.bar:
        yield display


class ProgressDisplay:
    """Observer of ``execute``. The bar counts expected time, not runs, as they differ in length."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self.bar = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=None),
            TaskProgressColumn(),
            TextColumn("{task.fields[runs]}"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            console=console,
        )
        self._task = self.bar.add_task("runs", total=None, runs="", left="")
        self._total_s = self._done_s = 0.0
        self._total = self._done = 0
        self._began = time.perf_counter()

    def planned(self, run: PlannedRun, expected_s: float) -> None:
        """A run has to be performed."""
        del run
        self._total += 1
        self._total_s += expected_s
        self._show()

    def finished(self, run: PlannedRun, expected_s: float, stored: StoredRun) -> None:
        """A run was performed and stored."""
        self._count(expected_s)
        fallbacks = (
            stored.metrics.decisions.fallbacks if stored.metrics.decisions is not None else 0
        )
        remark = f", {fallbacks} fallbacks" if fallbacks else ""
        took = clock_text(stored.record.wall.total_s)
        self._line(f"{run.address}  ({took}{remark})")

    def failed(self, run: PlannedRun, expected_s: float, cause: str) -> None:
        """A run failed."""
        self._count(expected_s)
        self._line(f"{run.address}  FAILED: {cause}", style="bold red")

    def remaining(self, seconds: float) -> None:
        """Expected wall time until the end."""
        left = f"{clock_text(seconds)} left" if self._done < self._total else ""
        self.bar.update(self._task, left=left)

    def _count(self, expected_s: float) -> None:
        self._done += 1
        self._done_s += expected_s
        self._show()

    def _show(self) -> None:
        self.bar.update(
            self._task,
            total=self._total_s,
            completed=self._done_s,
            runs=f"{self._done}/{self._total}",
        )

    def _line(self, text: str, style: str = "") -> None:
        clock = clock_text(time.perf_counter() - self._began)
        self.bar.console.print(
            f"[{self._done}/{self._total}] {text}, at {clock}",
            style=style,
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
