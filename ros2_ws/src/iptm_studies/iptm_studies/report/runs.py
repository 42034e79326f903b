"""Finished runs as the report sees them: addressed by what they are in the paper, not by how they are stored.

A run has the address of its case in the shipped studies, such as ``strategies/aging``,
``prediction_horizon/10`` or ``sampling_time/3+12/5``: the study, then what varies in it. Rules, tables and
plots ask for addresses only, so that a run that has not been computed yet is a gap in the report and not an
error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from iptm_controller.strategy import Strategy
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes import Route
from iptm_core.trajectory import Trajectory
from iptm_studies.whole_trip import WholeTripRecord

STUDIES = {
    "strategies": "Strategies",
    "weighting": "Weights",
    "prediction_horizon": "Prediction horizon",
    "sampling_time": "Multi-horizon sampling time",
    "long_horizon": "Multi-horizon length",
    "imperfect_previews": "Imperfect previews",
    "omitted_parameters": "Omitted parameters",
    "discretisation": "Long steps against fine steps",
    "weighting_scale": "Scale of the weights",
    "whole_trip": "Whole trip as one problem",
}
"""Names of the studies that addresses begin with, and their titles."""

PROPOSED_RUN = "strategies/aging"
HEADLINE_RUN = "long_horizon/3+5"
REFERENCE_RUN = "strategies/reference"
OPTIMUM_RUN = "whole_trip/aging"
"""The whole trip as one problem, known in advance: what can be saved at most."""


@dataclass(frozen=True)
class ReportRun:
    """One finished run.

    Attributes:
        address: what it is in the paper.
        measures: its figures by key, see `iptm_studies.report.measures`.
        parameters: the model it was driven with.
        route: leader and slope.
        strategy: cost terms with their weights.
        load: reads its trajectory; called at most once.
        whole_trip: how a whole trip was solved; None for a closed loop.
    """

    address: str
    measures: Mapping[str, float]
    parameters: ModelParameters
    route: Route
    strategy: Strategy
    load: Callable[[], Trajectory] = field(repr=False, compare=False)
    whole_trip: WholeTripRecord | None = None

    @cached_property
    def trajectory(self) -> Trajectory:
        """The trip, read on first use."""
        return self.load()


@dataclass(frozen=True)
class Gap:
    """A run that the report would need and does not have.

    Attributes:
        address: its address.
        study: the study that computes it.
        reason: why it is missing: not computed, failed, or damaged.
    """

    address: str
    study: str
    reason: str


class Results:
    """Runs by address, and why others are missing."""

    def __init__(self, runs: Iterable[ReportRun], gaps: Iterable[Gap] = ()) -> None:
        self._runs = {run.address: run for run in runs}
        self._gaps = {gap.address: gap for gap in gaps}

    def __contains__(self, address: object) -> bool:
        return address in self._runs

    def __getitem__(self, address: str) -> ReportRun:
        return self._runs[address]

    def __iter__(self) -> Iterator[ReportRun]:
        return iter(self._runs.values())

    def get(self, address: str) -> ReportRun | None:
        """The run, or None."""
        return self._runs.get(address)

    def measure(self, address: str, key: str) -> float | None:
        """A figure of a run; None if the run or the figure is missing."""
        run = self._runs.get(address)
        return None if run is None else run.measures.get(key)

    def study(self, name: str) -> list[ReportRun]:
        """Runs of a study in the order in which they were given."""
        return [run for run in self if run.address.partition("/")[0] == name]

    def missing(self, addresses: Iterable[str]) -> tuple[str, ...]:
        """Those of the addresses that have no run, each once, in order."""
        return tuple(dict.fromkeys(name for name in addresses if name not in self._runs))

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Every run that was asked for and is missing."""
        return tuple(gap for gap in self._gaps.values() if gap.address not in self._runs)

    def why(self, address: str) -> str:
        """Why a run is missing, in words."""
        gap = self._gaps.get(address)
        return "not computed" if gap is None else gap.reason
