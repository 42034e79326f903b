"""How well the strategy table determines each number: the spread of the good fits among the evaluations."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from iptm_core.errors import StoreError
from iptm_core.parameters import load_parameters, to_flat_dict
from iptm_core.routes.composition import load_composition
from iptm_core.state import FloatArray
from iptm_reproduction.identification.shipping import (
    COMPOSITION_NAME,
    EVALUATIONS_NAME,
    MISFIT,
    SET_NAME,
)
from iptm_reproduction.identification.unknowns import (
    COMPOSITION,
    Unknown,
    read_unknowns,
    shipped_unknowns,
)

GOOD_EXCESS = 0.5
"""Misfit above the best one up to which a candidate is a good fit: half a tolerance per number, squared."""
PINNED_SHARE, PARTLY_SHARE = 0.25, 0.5


@dataclass(frozen=True)
class Determined:
    """A number and what the good fits say about it.

    Attributes:
        unknown: bounds and reason.
        value: the shipped value.
        low: smallest value of a good fit.
        high: largest one.
    """

    unknown: Unknown
    value: float
    low: float
    high: float

    @property
    def share(self) -> float:
        """Part of the bounds that good fits share."""
        return (self.high - self.low) / (self.unknown.high - self.unknown.low)

    @property
    def judgement(self) -> str:
        """Whether the paper pins the number down."""
        if self.share <= PINNED_SHARE:
            return "yes"
        return "in part" if self.share <= PARTLY_SHARE else "no"


@dataclass(frozen=True)
class Spread:
    """All numbers, and the evaluations that they rest on.

    Attributes:
        numbers: in the order of the unknowns.
        values: numbers of each candidate, shape (candidates, numbers).
        misfits: shape (candidates,), the best first.
        best: smallest misfit.
        threshold: largest misfit of a good fit.
    """

    numbers: tuple[Determined, ...]
    values: FloatArray
    misfits: FloatArray
    best: float
    threshold: float

    @property
    def candidates(self) -> int:
        """Number of candidates."""
        return int(self.misfits.size)

    @property
    def good(self) -> int:
        """Number of good fits."""
        return int(np.sum(self.misfits <= self.threshold))


def shipped_values() -> dict[str, float]:
    """Return the identified value of every number by key."""
    composition = load_composition(COMPOSITION_NAME)
    values = {
        f"parameters.{key}": value
        for key, value in to_flat_dict(load_parameters(SET_NAME).values).items()
    }
    numbers = (key for key, value in composition.to_dict().items() if isinstance(value, float))
    return values | {f"{COMPOSITION}.{key}": getattr(composition, key) for key in numbers}


@cache
def determined_numbers(path: Path | None = None) -> Spread:
    """Read the evaluations beside this module, or others.

    Raises:
        StoreError: the file is missing or not as it should be.
    """
    path = path or Path(__file__).parent / EVALUATIONS_NAME
    unknowns = read_unknowns(shipped_unknowns())
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        misfits = np.array([float(row[MISFIT]) for row in rows])
        values = np.array([[float(row[entry.key]) for entry in unknowns.free] for row in rows])
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise StoreError(f"evaluations {path} cannot be read: {error}") from error
    best = float(np.min(misfits))
    good = misfits <= best + GOOD_EXCESS
    shipped = shipped_values()
    numbers = tuple(
        Determined(
            unknown,
            shipped[unknown.key],
            float(np.min(values[good, place])),
            float(np.max(values[good, place])),
        )
        for place, unknown in enumerate(unknowns.free)
    )
    return Spread(numbers, values, misfits, best, best + GOOD_EXCESS)
