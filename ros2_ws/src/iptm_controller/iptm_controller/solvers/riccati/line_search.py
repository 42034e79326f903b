"""Which trial points a line search accepts: the filter of Waechter and Biegler (2006), section 2.3.

A point has a barrier objective phi and a constraint violation theta. It is not acceptable to the filter if an
earlier entry is as good in both. Entries keep cost and logarithms apart, because the barrier parameter
changes in every iteration. Constants have the values of that paper, with its symbols.
"""

from __future__ import annotations

from typing import NamedTuple

MARGIN = 1e-5  # gamma_theta and gamma_phi
ARMIJO = 1e-4  # eta_phi
SWITCHING_SLOPE_EXPONENT = 2.3  # s_phi
SWITCHING_VIOLATION_EXPONENT = 1.1  # s_theta
MAX_VIOLATION_FACTOR = 1e4  # theta_max relative to the first point
MIN_VIOLATION_FACTOR = 1e-4  # theta_min relative to the first point
ROUND_OFF = 1e-10


class FilterPoint(NamedTuple):
    """An iterate as the filter sees it.

    Attributes:
        cost: objective, penalties of the soft limits included.
        log_sum: sum of ln s.
        violation: theta, 1-norm of the residuals of dynamics and inequality constraints.
        largest_violation: their infinity norm.
    """

    cost: float
    log_sum: float
    violation: float
    largest_violation: float

    def barrier_objective(self, mu: float) -> float:
        """Return phi, the cost with the logarithmic barrier (Nocedal and Wright, eq. 19.4)."""
        return self.cost - mu * self.log_sum


class LineSearchFilter:
    """Points that no later iterate may be dominated by."""

    def __init__(self, first: FilterPoint) -> None:
        reference = max(1.0, first.violation)
        self._max_violation = MAX_VIOLATION_FACTOR * reference
        self._min_violation = MIN_VIOLATION_FACTOR * reference
        self._entries: list[FilterPoint] = []

    def accepts(
        self, trial: FilterPoint, current: FilterPoint, mu: float, slope: float, length: float
    ) -> bool:
        """Judge a trial point; the filter is augmented unless the step is one of descent (eq. 22).

        Args:
            slope: derivative of the barrier objective along the step.
            length: step length, 1 for a full step.
        """
        # The negated comparison also refuses a violation that is not a number.
        if not trial.violation <= self._max_violation:
            return False
        phi, phi_now = trial.barrier_objective(mu), current.barrier_objective(mu)
        tolerance = ROUND_OFF * max(1.0, abs(phi_now))
        if not all(_improves(trial, phi, entry, mu, tolerance) for entry in self._entries):
            return False
        if self._is_descent_step(current, slope, length):
            # Armijo condition (eq. 20).
            return phi <= phi_now + ARMIJO * length * slope + tolerance
        accepted = _improves(trial, phi, current, mu, tolerance)
        if accepted:
            self._entries.append(current)
        return accepted

    def _is_descent_step(self, current: FilterPoint, slope: float, length: float) -> bool:
        """Return whether the violation is small and the switching condition holds (eq. 19)."""
        if slope >= 0.0 or current.violation > self._min_violation:
            return False
        gain: float = length * (-slope) ** SWITCHING_SLOPE_EXPONENT
        return bool(gain > current.violation**SWITCHING_VIOLATION_EXPONENT)


def _improves(
    trial: FilterPoint, phi: float, other: FilterPoint, mu: float, tolerance: float
) -> bool:
    """Return whether the violation or the barrier objective decreases sufficiently (eq. 18)."""
    less_violation = trial.violation <= (1.0 - MARGIN) * other.violation
    bound = other.barrier_objective(mu) - MARGIN * other.violation + tolerance
    return less_violation or phi <= bound
