"""Optimality of an iterate, and the predictor's estimate for the Newton step from it."""

from __future__ import annotations

import math
from typing import NamedTuple

MULTIPLIER_SCALE = 100.0  # s_max of IPOPT
CENTRING_EXPONENT = 3
LEAST_BARRIER = 0.05
LEAST_PRIMAL_STEP = 0.01


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
