"""Trial points that a line search accepts (Waechter and Biegler, 2006), and optimality of an iterate.

A point has a barrier objective phi and a constraint violation theta. It is not acceptable to the filter if
an earlier entry is as good in both. Entries keep cost and logarithms apart, because the barrier parameter
changes in every iteration.

The summary of a step has the predictor's estimate for the Newton step from an iterate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from iptm_controller.solvers.riccati.constants import (
    ARMIJO,
    CENTRING_EXPONENT,
    LEAST_BARRIER,
    LEAST_PRIMAL_STEP,
    MARGIN,
    MAX_VIOLATION_FACTOR,
    MIN_VIOLATION_FACTOR,
    MULTIPLIER_SCALE,
    ROUND_OFF,
    SWITCHING_SLOPE_EXPONENT,
    SWITCHING_VIOLATION_EXPONENT,
)


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


class StepSummary(NamedTuple):
    """Scalars of an iterate and of the two parts of its Newton step.

    Attributes:
        stationarity: infinity norm of the gradient of the Lagrangian (dual residual).
        dynamics: infinity norm of the residual of the dynamics.
        inequalities: infinity norm of c - s.
        complementarity: largest product s z.
        complementarity_sum: s'z.
        z_sum: sum of the multipliers of the inequality constraints.
        lam_sum: sum of the absolute multipliers of the dynamics.
        corrected_pivots: pivots of the factorisation that the inertia correction changed.
        cost_slope_affine: derivative of the cost along the affine-scaling part of the step.
        cost_slope_centring: the same along the centring part.
        log_slope_affine: derivative of the sum of ln s along the affine-scaling part.
        log_slope_centring: the same along the centring part.
        primal_step_affine: longest affine-scaling step that keeps s positive, at most 1.
        dual_step_affine: the same for z.
        s_dz_affine: s'dz of the affine-scaling step.
        z_ds_affine: z'ds of the affine-scaling step.
        ds_dz_affine: ds'dz of the affine-scaling step.
    """

    stationarity: float
    dynamics: float
    inequalities: float
    complementarity: float
    complementarity_sum: float
    z_sum: float
    lam_sum: float
    corrected_pivots: float
    cost_slope_affine: float
    cost_slope_centring: float
    log_slope_affine: float
    log_slope_centring: float
    primal_step_affine: float
    dual_step_affine: float
    s_dz_affine: float
    z_ds_affine: float
    ds_dz_affine: float

    @property
    def is_usable(self) -> bool:
        """False if corrected pivots have blown the step up: past all numbers, or past all bounds."""
        if not math.isfinite(self.cost_slope_affine + self.cost_slope_centring + self.ds_dz_affine):
            return False
        return self.corrected_pivots == 0.0 or self.primal_step_affine > LEAST_PRIMAL_STEP

    def kkt_error(self, inequality_count: int, dynamics_count: int) -> float:
        """Return the scaled optimality error for mu = 0 (Waechter and Biegler, 2006, eq. 5)."""
        mean = (self.z_sum + self.lam_sum) / (inequality_count + dynamics_count)
        dual_scale = max(MULTIPLIER_SCALE, mean) / MULTIPLIER_SCALE
        complementarity_scale = (
            max(MULTIPLIER_SCALE, self.z_sum / inequality_count) / MULTIPLIER_SCALE
        )
        return max(
            self.stationarity / dual_scale,
            self.dynamics,
            self.inequalities,
            self.complementarity / complementarity_scale,
        )

    def barrier_parameter(self, inequality_count: int, tolerance: float, safeguard: float) -> float:
        """Return the barrier parameter of the step by Mehrotra's rule.

        ``mu = sigma s'z / m`` with ``sigma = (mu_affine / mu)^3`` (Nocedal and Wright, eqs. 14.33 and 14.34):
        as much centring as the affine-scaling step is blocked.

        Args:
            inequality_count: number m of inequality constraints.
            tolerance: optimality error to reach.
            safeguard: mu does not fall below this share of the larger of dual residual and residual of
                the inequality constraints. Far from the optimum a small mu leaves the iterates at their
                bounds, where every step is short.
        """
        primal, dual = self.primal_step_affine, self.dual_step_affine
        affine_sum = (
            self.complementarity_sum
            + primal * self.z_ds_affine
            + dual * self.s_dz_affine
            + primal * dual * self.ds_dz_affine
        )
        ratio = min(max(affine_sum / self.complementarity_sum, 0.0), 1.0)
        mean = self.complementarity_sum / inequality_count
        floor = min(mean, safeguard * max(self.stationarity, self.inequalities))
        return max(ratio**CENTRING_EXPONENT * mean, floor, LEAST_BARRIER * tolerance)
