"""Finished runs and their figures, gathered from a store: one table, a row per run and a column per figure.

A run that has not been computed yet leaves a note in the report and is not an error.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property, partial

import numpy as np
import pandas as pd

from iptm_controller.strategy import Strategy
from iptm_core.errors import ScenarioError
from iptm_core.metrics import figure_values
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes import Route
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_reproduction.names import (
    DEGRADATION,
    OPTIMUM,
    REFERENCE,
    STUDIES,
    relative_change,
    studies_of,
)
from iptm_studies.campaign import Campaign
from iptm_studies.run import Run, RunRecord
from iptm_studies.run_inputs import resolve_inputs
from iptm_studies.run_spec import REPRODUCED_CYCLE, RunSpec
from iptm_studies.store import ResultStore
from iptm_studies.study import SMALL

COMMAND = "scripts/reproduce run"


@dataclass(frozen=True)
class ReportRun:
    """One finished run: its figures by key (one without a value is left out) and what it was driven with."""

    address: str
    values: Mapping[str, float]
    parameters: ModelParameters
    route: Route
    strategy: Strategy
    load: Callable[[], Run] = field(repr=False, compare=False)

    @cached_property
    def stored(self) -> Run:
        """All that is stored of it, read on first use."""
        return self.load()

    @property
    def trajectory(self) -> Trajectory:
        """The trip."""
        return self.stored.trajectory


class Results:
    """Runs by address, the table of their figures, and why others are missing."""

    def __init__(self, runs: Iterable[ReportRun], missing: Mapping[str, str] | None = None) -> None:
        """Take runs, and the reasons for missing ones by address."""
        self.runs = {run.address: run for run in runs}
        self.missing = {
            address: why for address, why in (missing or {}).items() if address not in self.runs
        }
        self.figures = pd.DataFrame.from_dict(
            {address: dict(run.values) for address, run in self.runs.items()}, orient="index"
        )
        """A row per run, a column per figure, in the unit of each figure; NaN where there is no value."""

    def __contains__(self, address: object) -> bool:
        return address in self.runs

    def __getitem__(self, address: str) -> ReportRun:
        return self.runs[address]

    def find(self, address: str, figure: str) -> float | None:
        """Return a figure of a run; None if the run or the figure is missing."""
        run = self.runs.get(address)
        return None if run is None else run.values.get(figure)

    def value(self, address: str, figure: str) -> float:
        """Return a figure of a run that is known to be there."""
        return self.runs[address].values[figure]

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
            for address in (self.runs if "*" in pattern else (pattern,))
            if fnmatchcase(address, pattern) and not fnmatchcase(address, without)
        ]
        return list(dict.fromkeys(found))

    def lacking(self, addresses: Iterable[str]) -> tuple[str, ...]:
        """Return those of the addresses that have no run, each once, in order."""
        return tuple(dict.fromkeys(name for name in addresses if name not in self.runs))

    def missing_text(self, lacking: Sequence[str]) -> str:
        """Return which runs are missing, and why the first one is, in words."""
        names = ", ".join(STUDIES.get(study, study) for study in studies_of(lacking))
        shown = ", ".join(lacking[:3])
        shown += f" and {len(lacking) - 3} more" if len(lacking) > 3 else ""
        reason = self.missing.get(lacking[0], "not computed")
        return f"missing runs of {names}: {shown} ({reason})"


@dataclass(frozen=True)
class Origin:
    """Where the results come from: numbers of different runs and of the cases that they stand for.

    Attributes:
        trip: what most of the runs drive, in words.
        whole_cycle: whether that is the whole comprehensive cycle, as in the paper.
        details: all of that in words, times, source and versions, by title.
    """

    trip: str
    whole_cycle: bool
    runs: int
    cases: int
    details: Mapping[str, str]


@dataclass(frozen=True)
class Gathered:
    """What there is to report: the runs, their origin, and what computes a study, without its name."""

    results: Results
    origin: Origin
    command: str


def gather(store: ResultStore, campaign: Campaign) -> Gathered:
    """Collect the cases of a campaign that was compared with the store (``execution.survey``).

    Raises:
        ScenarioError: the store has no runs; names their number and the command.
        StoreError: a run has disappeared from the store since the survey.
    """
    runs: list[ReportRun] = []
    specs: dict[str, RunSpec] = {}
    missing: dict[str, str] = {}
    keys: set[str] = set()
    for state in campaign.cases:
        if state.key is None or state.spec is None or state.metrics is None:
            missing[state.address] = state.reason
            continue
        inputs = resolve_inputs(state.spec)
        runs.append(
            ReportRun(
                state.address,
                figure_values(state.metrics),
                inputs.parameters,
                inputs.route,
                state.spec.strategy,
                partial(store.load, state.key),
            )
        )
        specs[state.address] = state.spec
        keys.add(state.key)
    command = _command(campaign)
    if not runs:
        lacking = Counter(address.partition("/")[0] for address in missing)
        raise ScenarioError(
            f"store {store.folder} holds none of the results that the report is made of; missing are "
            f"{', '.join(f'{count} runs of {study}' for study, count in lacking.items())}. "
            f"Compute them with: {command} {' '.join(lacking)}"
        )
    records = [store.load(key).record for key in sorted(keys)]
    return Gathered(Results(runs, missing), _origin(runs, specs, records), command)


def _command(campaign: Campaign) -> str:
    """Return what computes a study of this campaign, without its name."""
    specs = [case.spec for study in campaign.studies for case in study.cases]
    small = all(
        (spec.cycle, spec.slope, spec.duration_s) == (SMALL.cycle, SMALL.slope, SMALL.duration_s)
        for spec in specs
    )
    return f"{COMMAND} --small" if small else COMMAND


def _origin(
    runs: Sequence[ReportRun], specs: Mapping[str, RunSpec], records: Sequence[RunRecord]
) -> Origin:
    trips = {
        run.address: f"{spec.cycle}, slope {spec.slope}, {run.values['duration']:.0f} s"
        for run, spec in zip(runs, specs.values(), strict=True)
    }
    trip = Counter(trips.values()).most_common(1)[0][0]
    ends = sorted(record.finished_at_utc for record in records)
    names = dict.fromkeys(name for record in records for name in record.versions)
    details = {
        "trip": trip,
        "runs": f"{len(records)} ({len(runs)} cases)",
        "computed": f"{ends[0]} to {ends[-1]}",
        "wall time of all runs, one after the other": (
            f"{sum(record.wall_time_s for record in records) / 3600.0:.2f} h"
        ),
        "runs without compiled problem": str(sum(not record.compiled for record in records)),
        "source": _counted(record.git_revision for record in records),
    }
    details |= {
        name: _counted(record.versions.get(name, "unknown") for record in records) for name in names
    }
    return Origin(
        trip=trip,
        whole_cycle=all(
            spec.cycle == REPRODUCED_CYCLE and spec.duration_s is None
            for address, spec in specs.items()
            if trips[address] == trip
        ),
        runs=len(records),
        cases=len(runs),
        details=details,
    )


def _counted(values: Iterable[str]) -> str:
    """Return the one value, or each with its number of runs."""
    counts = Counter(values)
    if len(counts) == 1:
        return next(iter(counts))
    return ", ".join(f"{name} ({count} runs)" for name, count in counts.items())
