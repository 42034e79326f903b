"""Runs and strategies in the paper's words, for sentences, tables and legends."""

from __future__ import annotations

from collections.abc import Sequence

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
    strategy = STRATEGY_NAMES.get(labels[-1], labels[-1]) if labels else ""
    if study == "strategies":
        return strategy
    if study == "weighting":
        return f"{STRATEGY_NAMES.get(labels[0], labels[0])} weight {labels[1]}"
    if study == "prediction_horizon":
        return f"horizon {labels[0]} s"
    if study == "sampling_time":
        return f"MH {labels[0]}, {labels[1]} s"
    if study == "long_horizon":
        return f"MH {labels[0]}+{labels[1]}"
    if study in {"previews", "parameters"}:
        return f"{strategy}, {labels[0].replace('_', ' ')}"
    if study == "whole_trip":
        return "whole-trip optimum"
    return address


def names_of(addresses: Sequence[str]) -> str:
    """Several runs in words; a long list is shortened to its ends."""
    names = [name_of(address) for address in addresses]
    if len(names) <= _MOST_NAMES:
        return ", ".join(names)
    return f"{len(names)} runs ({names[0]} to {names[-1]})"
