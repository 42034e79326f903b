"""Finished runs and their figures, gathered from a store: one table, a row per run and a column per figure.

A run that has not been computed yet leaves a note in the report and is not an error.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from iptm.studies.campaign import Campaign
from iptm.studies.run import Run
from iptm.studies.run_spec import REPRODUCED_CYCLE
from iptm.studies.store import ResultStore
from iptm.studies.study import NOT_COMPUTED, SHORT_TRIP, Case
from iptm_core.errors import ScenarioError
from iptm_core.metrics import FIGURES, figure_values
from iptm_core.state import FloatArray
from iptm_reproduction.names import (
    DEGRADATION,
    OPTIMUM,
    REFERENCE,
    STUDIES,
    relative_change,
    studies_of,
)

COMMAND = "scripts/reproduce run"


class Results:
    """Runs by address, the table of their figures, and why others are missing.

    Attributes:
        figures: a row per run, a column per figure in its unit; NaN for a missing value.
        missing: why a run is not there, by address.
        cases: the runs as planned, by address.
        origin: number of different ``runs`` and of the ``cases`` that they stand for, the ``trip`` that most
            of them drive, whether that is the ``whole_cycle`` as in the paper, and ``details`` in words.
        command: what computes a study, without its name.
    """

    def __init__(
        self,
        figures: Mapping[str, Mapping[str, float]],
        missing: Mapping[str, str] | None = None,
        load: Callable[[str], Run] | None = None,
        cases: Mapping[str, Case] | None = None,
    ) -> None:
        """Take the figures of runs, the reasons for missing ones, and what reads a run, by address."""
        self.figures = pd.DataFrame.from_dict(dict(figures), orient="index")
        self.missing = {name: why for name, why in (missing or {}).items() if name not in figures}
        self.cases = cases or {}
        self.origin: dict[str, Any] = {}
        self.command = COMMAND
        self._load = cache(load) if load else None

    def __contains__(self, address: object) -> bool:
        return address in self.figures.index

    def __getitem__(self, address: str) -> Run:
        """Return all that is stored of a run, read on first use."""
        if self._load is None or address not in self:
            raise KeyError(address)
        return self._load(address)

    def find(self, address: str, figure: str) -> float | None:
        """Return a figure of a run; None if the run or the figure is missing."""
        if address not in self or figure not in self.figures:
            return None
        found = self.figures.at[address, figure]
        return None if pd.isna(found) else float(found)

    def value(self, address: str, figure: str) -> float:
        """Return a figure of a run that is known to be there."""
        return float(self.figures.at[address, figure])

    def text(self, address: str, figure: str) -> str:
        """Return a figure of a run as it stands in tables."""
        return FIGURES[figure].text(self.find(address, figure))

    def series(self, addresses: Sequence[str], figure: str) -> FloatArray:
        """Return a figure of several runs that are known to be there, shape (runs,)."""
        return np.asarray(self.figures.loc[list(addresses), figure], dtype=np.float64)

    def change(self, address: str, base: str, figure: str) -> float | None:
        """Return the relative change of a figure from a base run to a run; None if one is missing."""
        return relative_change(self.find(address, figure), self.find(base, figure))

    def share_of_saving(
        self, address: str, reference: str = REFERENCE, optimum: str = OPTIMUM
    ) -> float | None:
        """Return the part of the possible saving of degradation that a run reaches.

        Returns:
            0 for the reference, 1 for the whole-trip optimum; None if a run is missing or the optimum saves
            nothing.
        """
        value, nothing, everything = (
            self.find(run, DEGRADATION) for run in (address, reference, optimum)
        )
        if value is None or nothing is None or everything is None or nothing <= everything:
            return None
        return (nothing - value) / (nothing - everything)

    def matching(self, *patterns: str, without: str = "") -> list[str]:
        """Return the runs whose addresses match one of the patterns, by pattern, then in their order.

        A pattern without a wildcard is an address and stays, whether that run is there or not.
        """
        found = [
            address
            for pattern in patterns
            for address in (self.figures.index if "*" in pattern else (pattern,))
            if fnmatchcase(address, pattern) and not fnmatchcase(address, without)
        ]
        return list(dict.fromkeys(found))

    def lacking(self, addresses: Iterable[str]) -> tuple[str, ...]:
        """Return those of the addresses that have no run, each once, in order."""
        return tuple(dict.fromkeys(name for name in addresses if name not in self))

    def missing_text(self, lacking: Sequence[str]) -> str:
        """Return which runs are missing, and why the first one is, in words."""
        names = ", ".join(STUDIES.get(study, study) for study in studies_of(lacking))
        shown = ", ".join(lacking[:3])
        shown += f" and {len(lacking) - 3} more" if len(lacking) > 3 else ""
        reason = self.missing.get(lacking[0], NOT_COMPUTED)
        return f"missing runs of {names}: {shown} ({reason})"


def gather(store: ResultStore, campaign: Campaign) -> Results:
    """Collect the cases of a campaign that was compared with the store (``campaign.survey``).

    Raises:
        ScenarioError: the store has no runs; names their number and the command.
        StoreError: a run has disappeared from the store since the survey.
    """
    planned = [case.spec for study in campaign.studies for case in study.cases]
    small = all({**vars(spec), **SHORT_TRIP} == vars(spec) for spec in planned)
    command = f"{COMMAND} --small" if small else COMMAND
    cases = {case.address: case for case in campaign.cases if case.metrics is not None}
    missing = {case.address: case.reason for case in campaign.cases if case.metrics is None}
    if not cases:
        lacking = Counter(address.partition("/")[0] for address in missing)
        raise ScenarioError(
            f"store {store.folder} holds none of the results that the report is made of; missing are "
            f"{', '.join(f'{count} runs of {study}' for study, count in lacking.items())}. "
            f"Compute them with: {command} {' '.join(lacking)}"
        )
    figures: dict[str, Mapping[str, float]] = {}
    runs = []
    for key in sorted({case.key for case in cases.values()}):
        run = store.load(key)
        figures[key] = figure_values(run.metrics)
        runs.append(
            {
                "end": run.finished_at_utc,
                "wall_time_s": run.wall_time_s,
                "compiled": run.compiled,
                "source": run.git_revision,
                "versions": run.versions,
            }
        )
    results = Results(
        {address: figures[case.key] for address, case in cases.items()},
        missing,
        lambda address: store.load(cases[address].key),
        cases,
    )
    results.command = command
    results.origin = _origin(results, pd.DataFrame(runs))
    return results


def _origin(results: Results, runs: pd.DataFrame) -> dict[str, Any]:
    specs = {address: case.spec for address, case in results.cases.items()}
    trips = {
        address: f"{spec.cycle}, slope {spec.slope}, {results.value(address, 'duration'):.0f} s"
        for address, spec in specs.items()
    }
    trip = Counter(trips.values()).most_common(1)[0][0]
    names = dict.fromkeys(name for versions in runs.versions for name in versions)
    details = {
        "trip": trip,
        "runs": f"{len(runs)} ({len(specs)} cases)",
        "computed": f"{runs.end.min()} to {runs.end.max()}",
        "wall time of all runs, one after the other": f"{sum(runs.wall_time_s) / 3600.0:.2f} h",
        "runs without compiled problem": str(sum(~runs.compiled)),
        "source": _counted(runs.source),
    }
    details |= {
        name: _counted(versions.get(name, "unknown") for versions in runs.versions)
        for name in names
    }
    return {
        "trip": trip,
        "whole_cycle": all(
            spec.cycle == REPRODUCED_CYCLE and spec.duration_s is None
            for address, spec in specs.items()
            if trips[address] == trip
        ),
        "runs": len(runs),
        "cases": len(specs),
        "details": details,
    }


def _counted(values: Iterable[str]) -> str:
    """Return the one value, or each with its number of runs."""
    counts = Counter(values)
    if len(counts) == 1:
        return next(iter(counts))
    return ", ".join(f"{name} ({count} runs)" for name, count in counts.items())
