"""Runs and figures by what they are in the paper: addresses, keys, and both in words.

An address, such as ``prediction_horizon/10`` or ``sampling_time/3+12/5``, is the study and what varies in it.
Keys of figures are those of `iptm_core.metrics.figures`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence

from iptm_core.metrics.figures import FIGURES, NO_VALUE

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
WEIGHTED = tuple(STRATEGY_NAMES)[1:5]
"""The strategies with weights."""

STRATEGIES = tuple(f"strategies/{name}" for name in STRATEGY_NAMES)
REFERENCE, REF_ENERGY, REF_AGING, REF_ENERGY_AGING, VICE, PROPOSED = STRATEGIES
"""The benchmark of the paper, its conventional strategies, its "vice benchmark", and its proposal."""
MULTI_HORIZON = "long_horizon/3+5"
"""The proposed strategy on 3 x 1 s + 5 x 5 s: the run of the paper's headline."""
FIRST_REFERENCE = "first_composition/reference"
FIRST_MULTI_HORIZON = "first_composition/multi_horizon"
"""The runs of the headline on the composition that was used before the paper's was identified."""
OPTIMUM = "whole_trip/aging"
"""The whole trip as one problem, known in advance: what can be saved at most."""
COST_TO_GO_OPTIMUM = "cost_to_go/comprehensive/whole_trip/perfect"
"""The whole trip of the study of the cost to go as one problem."""
CHILLER_PROPOSED = "omitted_parameters/published_chiller_35_degc/aging"
CHILLER_REFERENCE = "omitted_parameters/published_chiller_35_degc/reference"
"""Proposal and reference with the published chiller map."""

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


def expanded(*patterns: str) -> tuple[str, ...]:
    """Return addresses; ``a/b|c`` stands for ``a/b`` and ``a/c``."""
    return tuple(
        "/".join(parts)
        for pattern in patterns
        for parts in itertools.product(*(part.split("|") for part in pattern.split("/")))
    )


def studies_of(addresses: Iterable[str]) -> tuple[str, ...]:
    """Return the studies of some runs, each once, in order."""
    return tuple(dict.fromkeys(address.partition("/")[0] for address in addresses))


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


COOLING = "cooling_energy"
TRACTION = "traction_energy_battery"
TOTAL = "battery_energy"
"""The printed total is labelled the integral of P_b and equals traction plus cooling to the last digit. Both
hold if traction is what the pack gives for it, with what is fed back counted as the pack receives it."""
CELL_1 = "cell_1_degradation"
CELL_N = "cell_n_degradation"
INCONSISTENCY = "inconsistency"
DEGRADATION = "total_degradation"
"""Of both cells together: what the whole-trip optimum minimises."""
CELL_N_MEAN = "cell_n_temperature_mean"
CELL_N_MAX = "cell_n_temperature_max"
MEAN_POWER = "mean_power"
SMALLEST_GAP = "smallest_gap"
SMALLEST_MARGIN = "smallest_margin"
MEAN_COP = "mean_cop"
COMPUTING_TIME = "solve_total"

TABLE_FIGURES = (COOLING, TRACTION, TOTAL, CELL_1, CELL_N, INCONSISTENCY)
"""The rows of the paper's results table, in its order."""
FOUR = (COOLING, TRACTION, CELL_1, CELL_N)
"""What most of the paper's sensitivity figures show."""
HEADLINE_FIGURES = (COMPUTING_TIME, *TABLE_FIGURES)
"""What the paper's headline comparison states."""

DASH = NO_VALUE


def relative_change(value: float | None, base: float | None) -> float | None:
    """Return the change of a figure relative to a base, None where it does not exist."""
    if value is None or base is None or base == 0.0:
        return None
    return value / base - 1.0


def change_text(change: float | None) -> str:
    """Return a relative change in percent with its sign; a dash for None."""
    return DASH if change is None else f"{100.0 * change:+.2f} %"


def label(figure: str) -> str:
    """Return the name of a figure as it stands inside a sentence."""
    text = FIGURES[figure].label
    return text[0].lower() + text[1:]


def labels(figures: Iterable[str]) -> str:
    """Return the names of several figures as they stand inside a sentence."""
    return ", ".join(map(label, figures))
