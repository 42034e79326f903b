"""How a vehicle followed: its headway, and for how long and how far it was below s_min."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from iptm_core.metrics.constraints import GAP_TOLERANCE_M
from iptm_core.state import FloatArray

MOVING_M_S = 5.0
"""Headways count above this speed."""


@dataclass(frozen=True)
class Following:
    """How a vehicle followed; NaN where no leader was measured.

    Attributes:
        mean_headway_s: gap over speed, mean of the rows above `MOVING_M_S`.
        headway_s: the median of these.
        below_s: time below s_min in all.
        longest_below_s: from the first to the last row of the longest stretch below s_min.
        smallest_margin_m: smallest gap less s_min.
    """

    mean_headway_s: float = math.nan
    headway_s: float = math.nan
    below_s: float = math.nan
    longest_below_s: float = math.nan
    smallest_margin_m: float = math.nan

    @classmethod
    def of(
        cls, time_s: FloatArray, speed_m_s: FloatArray, gap_m: FloatArray, margin_m: FloatArray
    ) -> Following:
        """Work out how a vehicle followed.

        Args:
            margin_m: gap less s_min; as the gap, NaN in rows without a leader.
        """
        known = np.isfinite(margin_m)
        if not known.any():
            return cls()
        moving = known & (speed_m_s > MOVING_M_S)
        headways_s = gap_m[moving] / speed_m_s[moving] if moving.any() else np.array([math.nan])
        # A row below the limit counts for the interval that it ends.
        lasted_s = np.diff(time_s, prepend=time_s[:1])
        below = known & (margin_m < -GAP_TOLERANCE_M)
        longest_s, began_s = 0.0, math.inf
        for is_below, now_s in zip(below.tolist(), time_s.tolist(), strict=True):
            began_s = min(began_s, now_s) if is_below else math.inf
            longest_s = max(longest_s, now_s - began_s)
        return cls(
            float(headways_s.mean()),
            float(np.median(headways_s)),
            float(lasted_s[below].sum()),
            longest_s,
            float(margin_m[known].min()),
        )

    @property
    def text(self) -> str:
        """Headway and time below s_min in a line; empty without a leader."""
        if not math.isfinite(self.smallest_margin_m):
            return ""
        below = "never below s_min"
        if self.below_s > 0.0:
            below = (
                f"below s_min for {self.below_s:.0f} s, {self.longest_below_s:.0f} s in a row, by up to "
                f"{-self.smallest_margin_m:.1f} m"
            )
        headway = f"headway {self.mean_headway_s:.2f} s mean, {self.headway_s:.2f} s median, "
        return f"{headway if math.isfinite(self.headway_s) else ''}{below}"
