"""Performs what a campaign needs and the store does not have."""

from __future__ import annotations

import time
from collections.abc import Callable

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from iptm.studies.campaign import Campaign, admit
from iptm.studies.run import Run, perform_run
from iptm.studies.run_spec import RunKind
from iptm.studies.store import ResultStore
from iptm.studies.study import Case
from iptm.studies.workers import Failed, OnProgress, perform_all

LIMIT_S = {RunKind.CLOSED_LOOP: 300.0, RunKind.WHOLE_TRIP: 3600.0}
"""Longest time without progress. In a closed loop it is the compiler that takes longest."""


def execute(
    campaign: Campaign,
    store: ResultStore,
    workers: int,
    display: ProgressDisplay,
    perform: Callable[[Case, OnProgress], Run] = perform_run,
    limit_s: Callable[[Case], float] = lambda inputs: LIMIT_S[inputs.spec.kind],
) -> int:
    """Perform all missing runs of a campaign, the longest first.

    Each run is stored as soon as it is done, so that an interrupted campaign goes on where it stopped. A
    run that fails, or makes no progress for ``limit_s``, is noted and does not stop the others.

    Returns:
        The number of runs performed; the other runs of the campaign were found in the store.

    Raises:
        StoreError: the store cannot be written.
    """
    expected_s = campaign.expected.of
    waiting: list[Case] = []
    open_runs: dict[str, Case] = {}
    computed = 0

    def plan() -> None:
        for inputs in admit(campaign, store):
            waiting.append(inputs)
            open_runs[inputs.key] = inputs
            display.planned(inputs, expected_s(inputs))
        waiting.sort(key=expected_s, reverse=True)
        # Of those in progress, half of the work is done on average.
        left_s = sum(map(expected_s, open_runs.values())) + sum(map(expected_s, waiting))
        display.remaining(0.5 * left_s / workers)

    plan()
    for inputs, outcome in perform_all(perform, waiting, workers, limit_s):
        if isinstance(outcome, Failed):
            campaign.fail(inputs.key, outcome.cause)
            store.note_failure(inputs.key, outcome.cause)
        else:
            store.save(outcome)
            campaign.finish(outcome)
            computed += 1
        del open_runs[inputs.key]
        display.ended(inputs, outcome)
        plan()
    return computed


class ProgressDisplay:
    """A bar, and a line per run; the bar counts expected time, as runs differ in length."""

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
        self._done: list[str] = []
        self._began = time.perf_counter()

    def planned(self, inputs: Case, expected_s: float) -> None:
        """A run has to be performed."""
        self._expected_s[inputs.key] = expected_s
        self._show()

    def ended(self, inputs: Case, outcome: Run | Failed) -> None:
        """A run was performed and stored, or failed."""
        self._done.append(inputs.key)
        self._show()
        if isinstance(outcome, Failed):
            text, style = f"FAILED: {outcome.cause}", "bold red"
        else:
            decisions = outcome.metrics.decisions
            fallbacks = decisions.fallbacks if decisions is not None else 0
            remark = f", {fallbacks} fallbacks" if fallbacks else ""
            text, style = f"({clock_text(outcome.wall_time_s)}{remark})", ""
        clock = clock_text(time.perf_counter() - self._began)
        self.bar.console.print(
            f"[{len(self._done)}/{len(self._expected_s)}] {inputs.address}  {text}, at {clock}",
            style=style,
            highlight=False,
            markup=False,
            soft_wrap=True,
        )

    def remaining(self, seconds: float) -> None:
        """Expected wall time until the end."""
        self.bar.update(self._task, left=f"{clock_text(seconds)} left" if seconds else "")

    def _show(self) -> None:
        self.bar.update(
            self._task,
            total=sum(self._expected_s.values()),
            completed=sum(self._expected_s[key] for key in self._done),
            runs=f"{len(self._done)}/{len(self._expected_s)}",
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
