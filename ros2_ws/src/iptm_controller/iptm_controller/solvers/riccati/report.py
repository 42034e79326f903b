"""What a Newton step tells about the iterate that it starts from, and about itself."""

from __future__ import annotations

import math
from typing import NamedTuple

MULTIPLIER_SCALE = 100.0
CENTRING_POWER = 3
BARRIER_FLOOR = 0.05
LEAST_REACH = 0.01


class Report(NamedTuple):
    """One entry of ``program``'s report each, in its order.

    Attributes:
        stationarity: largest entry of the Lagrangian's gradient.
        defect: largest residual of the dynamics.
        gap: largest difference of distance and distance variable.
        largest_product: largest product of distance and multiplier.
        product_sum: sum of these products.
        multiplier_sum: sum of the multipliers of the limits.
        costate_sum: sum of the absolute costates.
        changed_pivots: pivots of the factorisation that were made positive.
        slope_pull: derivative of the cost along the step without barrier.
        slope_centring: the same along the centring part.
        log_slope_pull: derivative of the logarithms along the step without barrier.
        log_slope_centring: the same along the centring part.
        primal_reach: longest step without barrier that keeps the distances positive, at most 1.
        dual_reach: the same for the multipliers.
        s_dz: distances times change of multipliers, summed.
        z_ds: multipliers times change of distances, summed.
        ds_dz: changes of both, summed.
    """

    stationarity: float
    defect: float
    gap: float
    largest_product: float
    product_sum: float
    multiplier_sum: float
    costate_sum: float
    changed_pivots: float
    slope_pull: float
    slope_centring: float
    log_slope_pull: float
    log_slope_centring: float
    primal_reach: float
    dual_reach: float
    s_dz: float
    z_ds: float
    ds_dz: float

    @property
    def leads_somewhere(self) -> bool:
        """False if changed pivots have blown the step up: past all numbers, or past all limits."""
        if not math.isfinite(self.slope_pull + self.slope_centring + self.ds_dz):
            return False
        return self.changed_pivots == 0.0 or self.primal_reach > LEAST_REACH

    def error(self, sides: int, costates: int) -> float:
        """Largest optimality error, relative to large multipliers as in IPOPT."""
        mean = (self.multiplier_sum + self.costate_sum) / (sides + costates)
        dual_scale = max(MULTIPLIER_SCALE, mean) / MULTIPLIER_SCALE
        product_scale = max(MULTIPLIER_SCALE, self.multiplier_sum / sides) / MULTIPLIER_SCALE
        return max(
            self.stationarity / dual_scale,
            self.defect,
            self.gap,
            self.largest_product / product_scale,
        )

    def barrier(self, sides: int, tolerance: float, caution: float) -> float:
        """Barrier parameter for the step: centring as much as the step without it is blocked.

        Args:
            sides: number of limits.
            tolerance: optimality error to reach.
            caution: the barrier does not fall below this share of the optimality error. Far from the
                optimum a small barrier leaves the iterates at the limits, where every step is short.
        """
        primal, dual = self.primal_reach, self.dual_reach
        reached = (
            self.product_sum + primal * self.z_ds + dual * self.s_dz + primal * dual * self.ds_dz
        )
        share = min(max(reached / self.product_sum, 0.0), 1.0)
        mean = self.product_sum / sides
        held = min(mean, caution * max(self.stationarity, self.gap))
        return max(share**CENTRING_POWER * mean, held, BARRIER_FLOOR * tolerance)
