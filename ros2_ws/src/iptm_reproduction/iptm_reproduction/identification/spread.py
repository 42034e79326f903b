"""How well the strategy table determines each number: what is left of its prior.

The deviations from the rows of reference and proposed strategy are taken as linear in the numbers around
the shipped candidate. Their sensitivities J (per standard deviation of the prior) come from the stored
evaluations by ridge regression: without information in the evaluations, a number is taken as without
influence, so that it is never called determined for lack of runs. With deviations of one as standard error,
the standard deviations that are left are the roots of the diagonal of (J^T J + 1)^-1: 1 where the table
carries no information, 0 where it leaves no choice.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from iptm_core.errors import StoreError
from iptm_core.parameters import load_parameters, to_flat_dict
from iptm_core.routes.comprehensive import load_composition
from iptm_core.state import FloatArray
from iptm_reproduction.identification.shipping import (
    DEVIATION,
    EVALUATIONS_NAME,
    MISFIT,
)
from iptm_reproduction.identification.unknowns import (
    COMPOSITION,
    Unknown,
    read_unknowns,
    shipped_unknowns,
)
from iptm_studies.run_spec import REPRODUCED_CYCLE, REPRODUCED_SET

GOOD_EXCESS = 0.5
"""Misfit above the best one up to which a candidate is a good fit: a deviation of 0.7 more in every row."""
RIDGE = 0.3
"""Strength of the ridge, which suppresses influences seen in a few evaluations only."""
PINNED_SHARE, PARTLY_SHARE = 1.0 / 3.0, 2.0 / 3.0


@dataclass(frozen=True)
class Determined:
    """A number with its spread over the good fits.

    Attributes:
        unknown: bounds and reason.
        value: the shipped value.
        low: smallest value of a good fit.
        high: largest one.
        share: standard deviation that the table leaves, relative to that of the prior.
    """

    unknown: Unknown
    value: float
    low: float
    high: float
    share: float

    @property
    def deviation(self) -> float:
        """Standard deviation that the table leaves."""
        return self.share * self.unknown.spread * (self.unknown.high - self.unknown.low)

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
    composition = load_composition(REPRODUCED_CYCLE)
    values = {
        f"parameters.{key}": value
        for key, value in to_flat_dict(load_parameters(REPRODUCED_SET).values).items()
    }
    numbers = (key for key, value in composition.to_dict().items() if isinstance(value, float))
    return values | {f"{COMPOSITION}.{key}": getattr(composition, key) for key in numbers}


@cache
def determined_numbers() -> Spread:
    """Read the evaluations stored with this module.

    Raises:
        StoreError: the file is missing or not as it should be.
    """
    path = Path(__file__).parent / EVALUATIONS_NAME
    unknowns = read_unknowns(shipped_unknowns())
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        misfits = np.array([float(row[MISFIT]) for row in rows])
        values = np.array([[float(row[entry.key]) for entry in unknowns.free] for row in rows])
        names = [name for name in rows[0] if name.startswith(f"{DEVIATION}.")]
        deviations = np.array([[float(row[name]) for name in names] for row in rows])
    except (OSError, IndexError, KeyError, TypeError, ValueError) as error:
        raise StoreError(f"evaluations {path} cannot be read: {error}") from error
    best = float(np.min(misfits))
    good = misfits <= best + GOOD_EXCESS
    shipped = shipped_values()
    shares = remaining_shares(
        (values - np.array([shipped[entry.key] for entry in unknowns.free]))
        / np.array([entry.spread * (entry.high - entry.low) for entry in unknowns.free]),
        deviations,
    )
    numbers = tuple(
        Determined(
            unknown,
            shipped[unknown.key],
            float(np.min(values[good, place])),
            float(np.max(values[good, place])),
            float(shares[place]),
        )
        for place, unknown in enumerate(unknowns.free)
    )
    return Spread(numbers, values, misfits, best, best + GOOD_EXCESS)


def remaining_shares(steps: FloatArray, deviations: FloatArray) -> FloatArray:
    """Return the standard deviation that rows leave to each number, relative to its prior.

    Args:
        steps: numbers of each candidate from the shipped one, in standard deviations of the prior, shape
            (candidates, numbers).
        deviations: of each candidate from each row, in tolerances, shape (candidates, rows).

    Returns:
        Shares from 0 to 1, shape (numbers,).
    """
    # A distant candidate carries less information on the local sensitivities.
    weights = 1.0 / (1.0 + np.mean(steps**2, axis=1, keepdims=True))
    center = np.sum(weights * steps, axis=0) / np.sum(weights)
    level = np.sum(weights * deviations, axis=0) / np.sum(weights)
    x, y = np.sqrt(weights) * (steps - center), np.sqrt(weights) * (deviations - level)
    count = steps.shape[1]
    sensitivities = np.linalg.solve(x.T @ x + RIDGE * np.eye(count), x.T @ y)
    left: FloatArray = np.sqrt(
        np.diag(np.linalg.inv(sensitivities @ sensitivities.T + np.eye(count)))
    )
    return left
