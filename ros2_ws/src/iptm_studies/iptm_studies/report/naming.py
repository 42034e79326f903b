"""Runs and strategies in the paper's words, for sentences, tables and legends."""

from __future__ import annotations

from collections.abc import Callable, Sequence

STRATEGY_NAMES = {
    "reference": "Reference",
    "reference_energy": "Ref + Energy",
    "reference_aging": "Ref + Aging",
    "reference_energy_aging": "Ref + Energy + Aging",
    "energy_aging": "Energy + Aging",
    "aging": "Aging (proposed)",
}
"""The paper's name of each strategy, in the order of its table."""

STRATEGY_TERMS = {
    "reference": "J1,2",
    "reference_energy": "J1-3",
    "reference_aging": "J1,2,4",
    "reference_energy_aging": "J1-4",
    "energy_aging": "J3,4",
    "aging": "J4",
}
"""Cost terms of each strategy as the paper writes them."""

_MOST_NAMES = 6


def name_of(address: str) -> str:
    """A run in words.

    Args:
        address: see `iptm_studies.report.runs`.

    Returns:
        A short name; the address itself if its study is unknown.
    """
    study, *labels = address.split("/")
    try:
        return _NAMES[study](*labels)
    except (KeyError, TypeError):
        return address


def controller_name(label: str) -> str:
    """A strategy, or a strategy with a horizon, in words."""
    return "Aging, MH 3+5" if label == "multi_horizon" else STRATEGY_NAMES.get(label, label)


def words(label: str) -> str:
    """A label of a study in words."""
    return label.replace("_degc", " °C").replace("_", " ")


def names_of(addresses: Sequence[str]) -> str:
    """Several runs in words; a long list is shortened to its ends."""
    names = [name_of(address) for address in addresses]
    if len(names) <= _MOST_NAMES:
        return ", ".join(names)
    return f"{len(names)} runs ({names[0]} to {names[-1]})"


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
}
