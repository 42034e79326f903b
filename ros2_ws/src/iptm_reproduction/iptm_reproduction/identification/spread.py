"""How well the strategy table determines each number: what is left of its prior.

The deviations from the rows of reference and proposed strategy are taken as linear in the numbers around
the shipped candidate. Their sensitivities J (per standard deviation of the prior) come from the stored
evaluations by ridge regression: without information in the evaluations, a number is taken as without
influence, so that it is never called determined for lack of runs. With deviations of one as standard error,
the standard deviations that are left are the roots of the diagonal of (J^T J + 1)^-1: 1 where the table
carries no information, 0 where it leaves no choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from iptm.studies.run_spec import REPRODUCED_CYCLE, REPRODUCED_SET
from iptm_core.errors import StoreError
from iptm_core.parameters import load_parameters, to_flat_dict
from iptm_core.routes.comprehensive import load_composition
from iptm_core.state import FloatArray
from iptm_reproduction.identification.shipping import DEVIATION, EVALUATIONS_NAME, MISFIT
from iptm_reproduction.identification.unknowns import (
    COMPOSITION,
    PARAMETERS,
    read_unknowns,
    shipped_unknowns,
)

GOOD_EXCESS = 0.5
"""Misfit above the best one up to which a candidate is a good fit: a deviation of 0.7 more in every row."""
RIDGE = 0.3
"""Strength of the ridge, which suppresses influences seen in a few evaluations only."""
PINNED_SHARE, PARTLY_SHARE = 1.0 / 3.0, 2.0 / 3.0


@dataclass(frozen=True)
class Spread:
    """All numbers, and the evaluations that they rest on.

    Attributes:
        numbers: a row per unknown, in their order: ``key``, ``unit``, bounds ``lowest`` and ``highest``,
            shipped ``value``, range of the good fits from ``low`` to ``high``, ``share`` of the prior's
            standard deviation that the table leaves, that ``deviation`` itself, and ``pinned_down``.
        values: numbers of each candidate, shape (candidates, numbers).
        misfits: shape (candidates,), the best first.
        threshold: largest misfit of a good fit.
    """

    numbers: pd.DataFrame
    values: FloatArray
    misfits: FloatArray
    threshold: float

    @property
    def good(self) -> NDArray[np.bool_]:
        """Which candidates are good fits, shape (candidates,)."""
        return np.asarray(self.misfits <= self.threshold)


def shipped_values() -> dict[str, float]:
    """Return the identified value of every number by key."""
    sections = {
        PARAMETERS: to_flat_dict(load_parameters(REPRODUCED_SET).values),
        COMPOSITION: vars(load_composition(REPRODUCED_CYCLE)),
    }
    return {
        f"{section}.{key}": value
        for section, values in sections.items()
        for key, value in values.items()
        if isinstance(value, float)
    }


@cache
def determined_numbers() -> Spread:
    """Read the evaluations stored with this module.

    Raises:
        StoreError: the file is missing or not as it should be.
    """
    path = Path(__file__).parent / EVALUATIONS_NAME
    unknowns = read_unknowns(shipped_unknowns())
    free = unknowns.free
    try:
        table = pd.read_csv(path, dtype=float, float_precision="round_trip")
        misfits = table[MISFIT].to_numpy()
        values = table[list(free.index)].to_numpy()
        threshold = float(misfits.min()) + GOOD_EXCESS
    except (OSError, KeyError, ValueError) as error:
        raise StoreError(f"evaluations {path} cannot be read: {error}") from error
    known = shipped_values()
    shipped = np.array([known[key] for key in free.index])
    prior = unknowns.deviations
    deviations = table.filter(regex=rf"^{DEVIATION}\.").to_numpy()
    shares = remaining_shares((values - shipped) / prior, deviations)
    fits = values[misfits <= threshold]
    numbers = pd.DataFrame(
        {
            "key": list(free.index),
            "unit": list(free["unit"]),
            "lowest": list(free["low"]),
            "highest": list(free["high"]),
            "value": shipped,
            "low": fits.min(axis=0),
            "high": fits.max(axis=0),
            "share": shares,
            "deviation": shares * prior,
            "pinned_down": np.select(
                [shares <= PINNED_SHARE, shares <= PARTLY_SHARE], ["yes", "in part"], "no"
            ),
        }
    )
    return Spread(numbers, values, misfits, threshold)


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
