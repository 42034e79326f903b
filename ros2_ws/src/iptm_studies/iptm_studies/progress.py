"""What the user sees while a campaign is computed: a bar with the time left, and a line per run."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from iptm_studies.run import Run
from iptm_studies.run_inputs import RunInputs


@contextmanager
def progress_display(console: Console) -> Iterator[ProgressDisplay]:
    """Show the progress of what is computed inside the block."""
    display = ProgressDisplay(console)
    with display.bar:
        yield display


class ProgressDisplay:
    """Observer of ``execute``. The bar counts expected time, not runs, as they differ in length."""

    def __init__(self, console: Console) -> None:
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
        self._expected_s: dict[str, float] = {}
        self._done = 0
        self._done_s = 0.0
        self._began = time.perf_counter()

    def planned(self, inputs: RunInputs, expected_s: float) -> None:
        """A run has to be performed."""
        self._expected_s[inputs.key] = expected_s
        self._show()

    def finished(self, inputs: RunInputs, run: Run) -> None:
        """A run was performed and stored."""
        fallbacks = run.metrics.decisions.fallbacks if run.metrics.decisions is not None else 0
        remark = f", {fallbacks} fallbacks" if fallbacks else ""
        self._ended(inputs, f"({clock_text(run.record.wall_time_s)}{remark})")

    def failed(self, inputs: RunInputs, cause: str) -> None:
        """A run failed."""
        self._ended(inputs, f"FAILED: {cause}", style="bold red")

    def remaining(self, seconds: float) -> None:
        """Expected wall time until the end."""
        left = f"{clock_text(seconds)} left" if self._done < len(self._expected_s) else ""
        self.bar.update(self._task, left=left)

    def _ended(self, inputs: RunInputs, text: str, style: str = "") -> None:
        self._done += 1
        self._done_s += self._expected_s[inputs.key]
        self._show()
        clock = clock_text(time.perf_counter() - self._began)
        self.bar.console.print(
            f"[{self._done}/{len(self._expected_s)}] {inputs.address}  {text}, at {clock}",
            style=style,
            highlight=False,
            markup=False,
            soft_wrap=True,
        )

    def _show(self) -> None:
        self.bar.update(
            self._task,
            total=sum(self._expected_s.values()),
            completed=self._done_s,
            runs=f"{self._done}/{len(self._expected_s)}",
        )


def clock_text(seconds: float) -> str:
    """Return seconds as ``45 s``, ``3:20 min`` or ``1:05 h``."""
    whole = round(seconds)
    if whole < 90:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 90:
        return f"{minutes}:{rest:02d} min"
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d} h"
