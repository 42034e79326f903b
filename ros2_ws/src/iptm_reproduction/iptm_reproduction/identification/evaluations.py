"""The runs of a search in an append-only table, and how far they are from the paper's strategy table.

Every printed number gives a deviation in units of the tolerance for reproduced: of an absolute row, the
logarithm of found over printed against `ABSOLUTE_TOLERANCE`; of a relative change, the difference against the
tolerance of the verdicts. Large deviations count linearly (Huber), so that one row that cannot be met does
not decide the fit. What the paper prints elsewhere plays no part: it is what the fit is tested on.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from iptm.studies.run import perform_run
from iptm.studies.run_spec import RunSpec, canonical_json
from iptm.studies.study import KEY_LENGTH, Case, planned_run
from iptm_controller.strategy import strategy_by_name
from iptm_core.errors import StoreError
from iptm_core.metrics import figure_values
from iptm_reproduction.identification.unknowns import PARAMETERS, Candidate
from iptm_reproduction.names import REFERENCE, STRATEGY_NAMES, TABLE_FIGURES
from iptm_reproduction.printed import (
    CHANGE_SHARE,
    accepted_deviation,
    printed_change,
    printed_value,
)

HORIZON = "15x1"
ABSOLUTE_TOLERANCE = CHANGE_SHARE
"""Unit of the deviation of an absolute figure, in its logarithm: the tolerance of the verdicts."""
HUBER = 1.5
"""Deviation from which on the loss grows linearly."""
_NAME = "candidate"

Figures = Mapping[str, float]
"""Figures of a run by key."""
Task = tuple[Case, Mapping[str, float]]
"""A run, and the numbers of the candidate whose trip it drives."""


@dataclass(frozen=True)
class Evaluation:
    """What one strategy does on the trip of a candidate; ``key`` covers all that its figures depend on."""

    key: str
    strategy: str
    values: Mapping[str, float]
    figures: Figures
    wall_s: float


def planned(candidate: Candidate, strategy: str) -> Case:
    """Return the run of a strategy of the paper on the trip of a candidate."""
    spec = RunSpec(
        cycle=_NAME,
        parameter_set=candidate.unknowns.base_set,
        overrides=tuple(candidate.section(PARAMETERS).items()),
        strategy=candidate.strategy(strategy_by_name(strategy)),
        horizon=HORIZON,
    )
    return planned_run(spec, f"{_NAME}/{strategy}", candidate.composition(_NAME))


def evaluate(task: Task, on_progress: Callable[[], None]) -> Evaluation:
    """Perform a run; called in a worker process."""
    inputs, values = task
    run = perform_run(inputs, on_progress)
    figures, wall_s = figure_values(run.metrics), run.wall_time_s
    return Evaluation(inputs.key, inputs.spec.strategy.name, dict(values), figures, wall_s)


class EvaluationTable:
    """Evaluations by key, in a file of one JSON object per line."""

    def __init__(self, path: Path) -> None:
        """Open a table; the file is made with the first evaluation. A cut last line is dropped.

        Raises:
            StoreError: the file cannot be read.
        """
        self.path = path
        try:
            text = path.read_text(encoding="utf-8") if path.exists() else ""
        except (OSError, UnicodeDecodeError) as error:
            raise StoreError(f"table {path} cannot be read: {error}") from error
        self._line_end = "\n" if text and not text.endswith("\n") else ""
        self.entries: dict[str, Evaluation] = {}
        for line in text.splitlines():
            try:
                entry = Evaluation(**json.loads(line))
            except (ValueError, TypeError):
                continue
            if len(entry.key) == KEY_LENGTH:
                self.entries[entry.key] = entry

    def add(self, entry: Evaluation) -> None:
        """Append an evaluation; it is on the disk when this returns.

        Raises:
            StoreError: the file cannot be written.
        """
        self.entries[entry.key] = entry
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a", encoding="utf-8") as file:
                file.write(f"{self._line_end}{canonical_json(vars(entry))}\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise StoreError(f"table {self.path} cannot be written: {error}") from error
        self._line_end = ""

    def by_candidate(self) -> list[tuple[Mapping[str, float], dict[str, Figures]]]:
        """Return the numbers of each candidate with the figures of its strategies."""
        grouped: dict[str, tuple[Mapping[str, float], dict[str, Figures]]] = {}
        for entry in self.entries.values():
            same = grouped.setdefault(canonical_json(dict(entry.values)), (entry.values, {}))
            same[1][entry.strategy] = entry.figures
        return list(grouped.values())


def deviations(runs: Mapping[str, Figures]) -> dict[tuple[str, str], float]:
    """Return the deviations from every number of the table that the runs give, by strategy and figure.

    The reference must be among the runs. Relative rows come from the others.
    """
    reference = runs["reference"]
    found: dict[tuple[str, str], float] = {}
    for name in STRATEGY_NAMES:
        if name not in runs:
            continue
        for figure in TABLE_FIGURES:
            printed = printed_value(REFERENCE, figure)
            if name != "reference":
                change = runs[name][figure] / reference[figure] - 1.0
                wanted = printed_change(f"strategies/{name}", figure)
                found[name, figure] = (change - wanted) / accepted_deviation(wanted)
            elif printed is not None:
                found[name, figure] = math.log(reference[figure] / printed) / ABSOLUTE_TOLERANCE
    return found


def misfit(runs: Mapping[str, Figures]) -> float:
    """Return the mean loss over the numbers of the table that the runs give; 1 is a deviation of one."""
    losses = [huber(value) for value in deviations(runs).values()]
    return sum(losses) / len(losses)


def huber(deviation: float) -> float:
    """Return the square of a small deviation, and the tangent of that beyond `HUBER`."""
    size = abs(deviation)
    return size * size if size <= HUBER else HUBER * (2.0 * size - HUBER)
