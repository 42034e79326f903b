"""How much a solve may cost, and how closely a usable answer keeps the limits."""

from __future__ import annotations

from dataclasses import dataclass

FEASIBILITY_TOLERANCE = 1e-4
"""Largest violation of a row or bound that a usable iterate may have, scaled units."""


@dataclass(frozen=True)
class SolveBudget:
    """How long a solve may take.

    Attributes:
        max_iterations: bound on the iterations.
        deadline_s: bound on the wall time, 0 for none. With a bound the iterations depend on the
            machine's pace, so runs are no longer exactly repeatable.
    """

    max_iterations: int = 150
    deadline_s: float = 0.0
