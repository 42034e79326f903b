"""Which trial points a line search accepts: the filter of Wächter and Biegler (2006).

A point is described by cost, barrier and residual. It is dominated by an earlier point if it is no better
in either the residual or the barrier objective. Entries keep cost and logarithms apart, because the
barrier parameter changes in every iteration.
"""

from __future__ import annotations

from typing import NamedTuple

RESIDUAL_MARGIN = 1e-5
SUFFICIENT_DECREASE = 1e-4
SWITCH_SLOPE_POWER = 2.3
SWITCH_RESIDUAL_POWER = 1.1
LARGEST_GROWTH = 1e4
SMALL_RESIDUAL = 1e-4
ROUND_OFF = 1e-10


class Values(NamedTuple):
    """A point as the filter sees it.

    Attributes:
        cost: objective, slack penalties included.
        logarithms: sum of the logarithms of the distances to the limits.
        residual: sum of the absolute residuals of dynamics and limits.
        largest_residual: the largest of them.
    """

    cost: float
    logarithms: float
    residual: float
    largest_residual: float

    def barrier_objective(self, mu: float) -> float:
        """Cost with the logarithmic barrier."""
        return self.cost - mu * self.logarithms


class SearchFilter:
    """Remembers where the search has been."""

    def __init__(self, first: Values) -> None:
        reference = max(1.0, first.residual)
        self._largest = LARGEST_GROWTH * reference
        self._small = SMALL_RESIDUAL * reference
        self._entries: list[Values] = []

    def accepts(
        self, trial: Values, current: Values, mu: float, slope: float, length: float
    ) -> bool:
        """Judge a trial point; an accepted one that does not just descend makes an entry.

        Args:
            trial: the point.
            current: where the step starts.
            mu: barrier parameter.
            slope: derivative of the barrier objective along the step.
            length: length of the step, 1 for a full one.
        """
        # The negated comparison also refuses a residual that is not a number.
        if not trial.residual <= self._largest:
            return False
        there, here = trial.barrier_objective(mu), current.barrier_objective(mu)
        tolerance = ROUND_OFF * max(1.0, abs(here))
        if not all(_improves(trial, there, entry, mu, tolerance) for entry in self._entries):
            return False
        if self._descends(current, slope, length):
            return there <= here + SUFFICIENT_DECREASE * length * slope + tolerance
        accepted = _improves(trial, there, current, mu, tolerance)
        if accepted:
            self._entries.append(current)
        return accepted

    def _descends(self, current: Values, slope: float, length: float) -> bool:
        """Whether the step is one of descent, the residual being small already."""
        if slope >= 0.0 or current.residual > self._small:
            return False
        gain: float = length * (-slope) ** SWITCH_SLOPE_POWER
        return bool(gain > current.residual**SWITCH_RESIDUAL_POWER)


def _improves(trial: Values, there: float, other: Values, mu: float, tolerance: float) -> bool:
    less_residual = trial.residual <= (1.0 - RESIDUAL_MARGIN) * other.residual
    bound = other.barrier_objective(mu) - RESIDUAL_MARGIN * other.residual + tolerance
    return less_residual or there <= bound
