"""The runs of a search: an append-only table, so that an interrupted search goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from iptm_controller.strategy import strategy_by_name
from iptm_core.errors import StoreError
from iptm_core.metrics import figure_values
from iptm_core.routes import Route, build_route
from iptm_core.routes.comprehensive import RouteComposition
from iptm_reproduction.identification.unknowns import Candidate
from iptm_studies.fingerprint import code_fingerprint
from iptm_studies.run import perform_run
from iptm_studies.run_inputs import KEY_LENGTH, RunInputs, run_key
from iptm_studies.run_spec import RunSpec, canonical_json

HORIZON = "15x1"
_NAME = "candidate"


@dataclass(frozen=True)
class Evaluation:
    """What one strategy does on the trip of one candidate.

    Attributes:
        key: key of everything that the numbers depend on.
        strategy: name of the strategy.
        values: the candidate's numbers by key.
        figures: figures of the run by key.
        wall_s: wall time of the run.
    """

    key: str
    strategy: str
    values: Mapping[str, float]
    figures: Mapping[str, float]
    wall_s: float

    def to_json(self) -> str:
        """One line of the table."""
        return canonical_json(vars(self))


def inputs_of(candidate: Candidate, strategy: str) -> RunInputs:
    """Return the run of a strategy of the paper on the trip of a candidate."""
    composition, parameters = candidate.composition(_NAME), candidate.parameters()
    spec = RunSpec(
        cycle=_NAME,
        strategy=candidate.strategy(strategy_by_name(strategy)),
        horizon=HORIZON,
    )
    route = _route(composition, parameters.gap.initial_gap_m)
    return RunInputs(spec, parameters, route, code_fingerprint(), f"{_NAME}/{strategy}")


@lru_cache(maxsize=32)
def _route(composition: RouteComposition, initial_gap_m: float) -> Route:
    return build_route(composition, initial_gap_m=initial_gap_m)


def evaluate(
    task: tuple[RunInputs, Mapping[str, float]], on_progress: Callable[[], None]
) -> Evaluation:
    """Perform a run on the trip of a candidate with some values; called in a worker process."""
    inputs, values = task
    run = perform_run(inputs, on_progress)
    return Evaluation(
        run_key(inputs),
        inputs.spec.strategy.name,
        dict(values),
        figure_values(run.metrics),
        run.record.wall_time_s,
    )


class EvaluationTable:
    """Evaluations by key, in a file of one JSON object per line."""

    def __init__(self, path: Path) -> None:
        """Open a table; the file is made with the first evaluation. A cut last line is dropped.

        Raises:
            StoreError: the file cannot be read.
        """
        self.path = path
        self._entries: dict[str, Evaluation] = {}
        try:
            lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        except (OSError, UnicodeDecodeError) as error:
            raise StoreError(f"table {path} cannot be read: {error}") from error
        for line in lines:
            entry = _parsed(line)
            if entry is not None:
                self._entries[entry.key] = entry

    def __len__(self) -> int:
        """Return the number of evaluations."""
        return len(self._entries)

    def __iter__(self) -> Any:
        """Return all evaluations in the order of the file."""
        return iter(self._entries.values())

    def find(self, key: str) -> Evaluation | None:
        """Return an evaluation; None if it is not there."""
        return self._entries.get(key)

    def add(self, entry: Evaluation) -> None:
        """Append an evaluation; it is on the disk when this returns.

        Raises:
            StoreError: the file cannot be written.
        """
        self._entries[entry.key] = entry
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            cut = self.path.exists() and not self.path.read_bytes().endswith(b"\n")
            with self.path.open("a", encoding="utf-8") as file:
                file.write(
                    ("\n" if cut and self.path.stat().st_size else "") + entry.to_json() + "\n"
                )
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise StoreError(f"table {self.path} cannot be written: {error}") from error

    def by_candidate(self) -> list[tuple[Mapping[str, float], dict[str, Mapping[str, float]]]]:
        """Return the numbers of each candidate with the figures of its strategies."""
        grouped: dict[str, tuple[Mapping[str, float], dict[str, Mapping[str, float]]]] = {}
        for entry in self:
            name = hashlib.sha256(canonical_json(dict(entry.values)).encode()).hexdigest()
            grouped.setdefault(name, (entry.values, {}))[1][entry.strategy] = entry.figures
        return list(grouped.values())


def _parsed(line: str) -> Evaluation | None:
    """Read a line; None if it is cut or no evaluation."""
    try:
        entry = Evaluation(**json.loads(line))
    except (ValueError, TypeError):
        return None
    return entry if len(entry.key) == KEY_LENGTH else None
