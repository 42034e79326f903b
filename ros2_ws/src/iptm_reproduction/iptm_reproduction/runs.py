"""Finished runs as the report sees them: addressed by what they are in the paper, not by how they are stored.

A run has the address of its case in the shipped studies, such as ``strategies/aging``,
``prediction_horizon/10`` or ``sampling_time/3+12/5``: the study, then what varies in it. Checks, tables and
plots ask for addresses only, so that a run that has not been computed yet leaves a note in the report and is
no error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from iptm_controller.strategy import Strategy
from iptm_core.decision_record import DecisionSeries
from iptm_core.metrics.figures import Figure
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes import Route
from iptm_core.trajectory import Trajectory
from iptm_reproduction.figures import relative_change
from iptm_studies.channel_record import ChannelRecord
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
    "first_composition": "This project's own composition",
    "full_channel": "The full channel",
    "cost_to_go": "The cost to go",
    "cold_days": "Cold days",
}
"""Names of the studies that addresses begin with, and their titles."""

STRATEGY_NAMES = {
    "reference": "Reference",
    "reference_energy": "Ref + Energy",
    "reference_aging": "Ref + Aging",
    "reference_energy_aging": "Ref + Energy + Aging",
    "energy_aging": "Energy + Aging",
    "aging": "Aging (proposed)",
}
"""The paper's name of each strategy, in the order of its table."""

STRATEGIES = tuple(f"strategies/{name}" for name in STRATEGY_NAMES)
REFERENCE, REF_ENERGY, REF_AGING, REF_ENERGY_AGING, VICE, PROPOSED = STRATEGIES
"""The benchmark of the paper, its conventional strategies, its "vice benchmark", and its proposal."""
MULTI_HORIZON = "long_horizon/3+5"
"""The proposed strategy on 3 x 1 s + 5 x 5 s: the run of the paper's headline."""
FIRST_REFERENCE, FIRST_AGING, FIRST_MULTI_HORIZON = (
    f"first_composition/{name}" for name in ("reference", "aging", "multi_horizon")
)
"""The runs of the headline on the composition that was used before the paper's was identified."""
OPTIMUM = "whole_trip/aging"
"""The whole trip as one problem, known in advance: what can be saved at most."""

WEIGHTED = ("reference_energy", "reference_aging", "reference_energy_aging", "energy_aging")
"""The strategies with weights."""
WEIGHT_NUMBERS = (1, 2, 3, 4)
HORIZONS_S = (5, 10, 15, 20)
SPLITS = ("3+12", "5+10", "8+7", "10+5", "12+3")
LONG_STEPS_S = (2, 5, 8, 10, 15)
SHORT_STEP_COUNTS = (3, 5)
LONG_STEP_COUNTS = (5, 10, 12, 15, 20)

DEFAULT_CONTROLLER = "multi_horizon_cost_to_go"
"""The project's default, the proposal with the cost to go, as it stands in addresses."""

_MOST_NAMES = 6
_MULTI_HORIZON_NAMES = {
    "multi_horizon": "Aging, MH 3+5",
    "whole_trip": "whole-trip optimum",
    DEFAULT_CONTROLLER: "Aging and cost to go, MH 3+5",
    "long_horizon_cost_to_go": "Aging and cost to go, MH 3+12 and 8 × 15 s",
    "thermal_phase_cost_to_go": "Aging and cost to go, MH 3+5 and 10 × 30 s thermal",
}


def weighted(*strategies: str) -> tuple[str, ...]:
    """Return the runs of strategies with their weights, in the order in which the paper prints them."""
    return tuple(f"weighting/{name}/{number}" for name in strategies for number in WEIGHT_NUMBERS)


def horizons(*lengths_s: int) -> tuple[str, ...]:
    """Return the runs on single horizons."""
    return tuple(f"prediction_horizon/{length}" for length in lengths_s)


def sampled(*splits: str) -> tuple[str, ...]:
    """Return the runs of splits of 15 steps by the sampling time of the long ones."""
    return tuple(f"sampling_time/{split}/{step}" for split in splits for step in LONG_STEPS_S)


def lengthened(*short_steps: int) -> tuple[str, ...]:
    """Return the runs on numbers of short steps by the number of long ones."""
    return tuple(
        f"long_horizon/{short}+{long}" for short in short_steps for long in LONG_STEP_COUNTS
    )


def channel_run(controller: str, plant: str = "full_channel") -> str:
    """Return the run of a controller on a plant with all cells of a channel, or with two."""
    return f"full_channel/{plant}/{controller}"


def cost_to_go_run(controller: str, trip: str = "comprehensive") -> str:
    """Return the run of a controller in the study of the cost to go, or of its whole-trip optimum."""
    return f"cost_to_go/{trip}/{controller}/perfect"


def warm_run(trip: str, slope: str) -> str:
    """Return the warm run, without temperature limits, that the cold days of a trip are compared with."""
    return f"cold_days/{trip}/{slope}/without_limits"


COST_TO_GO_OPTIMUM = cost_to_go_run("whole_trip")
"""The whole trip of that study as one problem."""


def channel_controllers(results: Results) -> tuple[str, ...]:
    """Return the controllers that drove a plant with all cells, in the order of the study."""
    runs = [run.address.split("/") for run in results.study("full_channel")]
    return tuple(name for _, plant, name in runs if plant == "full_channel")


def name_of(address: str) -> str:
    """Return a run in words; the address itself if its study is unknown."""
    study, *parts = address.split("/")
    try:
        return _NAMES[study](*parts)
    except (KeyError, TypeError):
        return address


def names_of(addresses: Sequence[str]) -> str:
    """Return several runs in words; a long list is shortened to its ends."""
    names = [name_of(address) for address in addresses]
    if len(names) <= _MOST_NAMES:
        return ", ".join(names)
    return f"{len(names)} runs ({names[0]} to {names[-1]})"


def controller_name(part: str) -> str:
    """Return a strategy, or a strategy with a horizon, in words."""
    return _MULTI_HORIZON_NAMES.get(part, STRATEGY_NAMES.get(part, part))


def words(part: str) -> str:
    """Return a part of an address in words."""
    return part.replace("_degc", " °C").replace("_", " ")


def _grid_name(length: str, grid: str) -> str:
    return f"{length} s, {'1 s steps' if grid == 'fine' else f'MH {grid}'}"


def _length_name(grid: str, strategy: str = "") -> str:
    return f"SH {grid} {controller_name(strategy)}" if strategy else f"MH {grid}"


_NAMES: dict[str, Callable[..., str]] = {
    "strategies": controller_name,
    "weighting": lambda strategy, number: f"{controller_name(strategy)} weight {number}",
    "weighting_scale": lambda scale, ratio: f"lambda_P {scale}, ratio {ratio}",
    "prediction_horizon": lambda length: f"horizon {length} s",
    "sampling_time": lambda split, step: f"MH {split}, {step} s",
    "long_horizon": _length_name,
    "imperfect_previews": lambda preview, name: f"{controller_name(name)}, {words(preview)}",
    "omitted_parameters": lambda variation, name: f"{controller_name(name)}, {words(variation)}",
    "discretisation": _grid_name,
    "whole_trip": lambda _: "whole-trip optimum",
    "first_composition": lambda name: f"{controller_name(name)}, own composition",
    "full_channel": lambda plant, name: f"{controller_name(name)}, {words(plant)}",
    "cost_to_go": lambda trip, name, preview: (
        f"{controller_name(name)}, {words(trip)}, {words(preview)}"
    ),
    "cold_days": lambda trip, slope, day: f"{words(trip)}, {words(slope)} slope, {words(day)}",
}


@dataclass(frozen=True)
class ReportRun:
    """One finished run.

    Attributes:
        address: what it is in the paper.
        values: its figures by key, see `iptm_core.metrics.figures`; a figure without a value is left out.
        parameters: the model it was driven with.
        route: leader and slope.
        strategy: cost terms with their weights.
        load: reads its trajectory; called at most once.
        whole_trip: how a whole trip was solved; None for a closed loop.
        channel: what all cells of a coolant channel went through; None where the plant has but two.
        load_decisions: reads its decisions, None for a whole trip; called at most once.
    """

    address: str
    values: Mapping[str, float]
    parameters: ModelParameters
    route: Route
    strategy: Strategy
    load: Callable[[], Trajectory] = field(repr=False, compare=False)
    whole_trip: WholeTripRecord | None = None
    channel: ChannelRecord | None = None
    load_decisions: Callable[[], DecisionSeries | None] = field(
        default=lambda: None, repr=False, compare=False
    )

    @cached_property
    def trajectory(self) -> Trajectory:
        """The trip, read on first use."""
        return self.load()

    @cached_property
    def decisions(self) -> DecisionSeries | None:
        """How its decisions came about, read on first use."""
        return self.load_decisions()


@dataclass(frozen=True)
class MissingRun:
    """A run that the report would need and does not have.

    Attributes:
        address: its address.
        reason: why it is missing: not computed, failed, or damaged.
    """

    address: str
    reason: str

    @property
    def study(self) -> str:
        """The study that computes it."""
        return self.address.partition("/")[0]


class Results:
    """Runs by address, and why others are missing."""

    def __init__(self, runs: Iterable[ReportRun], missing: Iterable[MissingRun] = ()) -> None:
        self._runs = {run.address: run for run in runs}
        self._missing = {run.address: run for run in missing}

    def __contains__(self, address: object) -> bool:
        return address in self._runs

    def __getitem__(self, address: str) -> ReportRun:
        return self._runs[address]

    def __iter__(self) -> Iterator[ReportRun]:
        return iter(self._runs.values())

    def get(self, address: str) -> ReportRun | None:
        """Return the run, or None."""
        return self._runs.get(address)

    def find(self, address: str, figure: Figure) -> float | None:
        """Return a figure of a run; None if the run or the figure is missing."""
        run = self._runs.get(address)
        return None if run is None else run.values.get(figure.key)

    def value(self, address: str, figure: Figure) -> float:
        """Return a figure of a run that is known to be there."""
        return self._runs[address].values[figure.key]

    def change(self, address: str, base: str, figure: Figure) -> float | None:
        """Return the relative change of a figure from a base run to a run; None if one is missing."""
        return relative_change(self.find(address, figure), self.find(base, figure))

    def study(self, name: str) -> list[ReportRun]:
        """Return the runs of a study in the order in which they were given."""
        return [run for run in self if run.address.partition("/")[0] == name]

    def strategies(self) -> dict[str, ReportRun]:
        """Return the runs of the strategy table that are there, by strategy."""
        pairs = zip(STRATEGY_NAMES, STRATEGIES, strict=True)
        return {name: self[run] for name, run in pairs if run in self}

    def lacking(self, addresses: Iterable[str]) -> tuple[str, ...]:
        """Return those of the addresses that have no run, each once, in order."""
        return tuple(dict.fromkeys(name for name in addresses if name not in self._runs))

    @property
    def missing(self) -> tuple[MissingRun, ...]:
        """Every run that was asked for and is missing."""
        return tuple(run for run in self._missing.values() if run.address not in self._runs)

    def missing_text(self, lacking: Sequence[str]) -> str:
        """Return which runs are missing, and why the first one is, in words."""
        names = ", ".join(STUDIES.get(study, study) for study in studies_of(lacking))
        shown = ", ".join(lacking[:3])
        shown += f" and {len(lacking) - 3} more" if len(lacking) > 3 else ""
        first = self._missing.get(lacking[0])
        return f"missing runs of {names}: {shown} ({'not computed' if first is None else first.reason})"


def studies_of(addresses: Iterable[str]) -> tuple[str, ...]:
    """Return the studies of some runs, each once, in order."""
    return tuple(dict.fromkeys(address.partition("/")[0] for address in addresses))
