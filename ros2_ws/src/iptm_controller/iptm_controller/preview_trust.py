"""How far ahead previews are trusted, and noisy ones averaged.

Every new preview begins at the measured speed, so a source that is wrong about the future is right about the
present. Its quality shows in what it predicted some seconds ago for this instant.

Previews with independent errors differ in a way in which no driver changes plans: the difference of two of
them varies along the preview. A driver who brakes, or a prediction that follows the present speed, changes
the preview smoothly. The roughness of the differences gives the noise; below a threshold previews pass
unchanged, to the last bit. Above it the speeds of an instant are averaged over the previews received so far,
weighted by the inverse of their variances (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with
Applications to Tracking and Navigation, 2001, section 3.4.1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_core.state import FloatArray, LeaderPreview

LONGEST_LEAD_S = 10
"""Longest lead time at which predictions are compared with measurements."""
SMOOTHED_TICKS = 3
"""Ticks over which errors are averaged."""
SINGLE_TOLERANCE_M_S, SINGLE_GROWTH_M_S2 = 3.0, 0.4
MEAN_TOLERANCE_M_S, MEAN_GROWTH_M_S2 = 1.5, 0.2
"""Accepted excess of the predicted over the measured speed in one tick, and in the mean of some: a constant
and its growth with the lead time. Honest previews with errors of 1.5 m/s mostly stay below both."""
PRESENT_ERROR_M_S = 1.5
"""A preview that is further off the speed measured now, up or down, is not trusted at all."""
PROBATION_S = 10.0
"""Time without a new error before trust can be restored."""
CREDITED_LEAD_S = 3.0
CREDITED_SLOWDOWN_M_S = 1.0
"""A preview proves itself by a slow-down that it predicted this long ago, by at least this much."""


@dataclass(frozen=True)
class Prediction:
    """Measurement and prediction of one tick.

    Attributes:
        speeds_m_s: speeds predicted for the lead times, NaN where the preview asserts none.
    """

    tick: int
    speed_m_s: float
    speeds_m_s: tuple[float, ...]


@dataclass(frozen=True)
class TrustMemory:
    """State carried from tick to tick.

    Attributes:
        predictions: of the last seconds, oldest first.
        errors: excess of predicted over measured speeds at the lead times, as lists of one tick each,
            joined, oldest first.
        last_error_tick: tick of the last error beyond the tolerance.
        proved: a slow-down has been predicted correctly since.
    """

    predictions: tuple[Prediction, ...] = ()
    errors: tuple[float, ...] = ()
    horizon_s: float = math.inf
    last_error_tick: int = 0
    proved: bool = True


def lead_ticks(tick_s: float) -> tuple[int, ...]:
    """Return the lead times at which predictions are compared with measurements, in ticks."""
    whole = range(1, LONGEST_LEAD_S + 1)
    return tuple(dict.fromkeys(max(round(lead / tick_s), 1) for lead in whole))


FORGETTING_PER_S = 0.1
"""Share by which the weight of earlier previews, and of earlier roughness, falls in a second."""
ROUGH_M_S2 = 0.3
"""Root mean square of the rate at which differences vary along the preview, from which on they are noise.
Errors of 0.5 m/s that are correlated over 5 s reach it."""
ROUGH_M2_S4 = ROUGH_M_S2 * ROUGH_M_S2
ERROR_GROWTH_S = 5.0
"""The error of a preview is small now and reaches its standard deviation at lead times beyond this."""
LEAST_VARIANCE = 1e-3
"""Of the speed now, as a share of that at long lead times."""
ANOTHER_PLAN_M_S = 5.0
"""A preview that differs from the average by more (root mean square) begins a new average."""


@dataclass(frozen=True)
class FusionMemory:
    """State carried from tick to tick.

    Attributes:
        preview: the newest preview as received, whose positions do not count; None before the first one.
        roughness_m2_s4: running mean of the squared rate at which consecutive previews differ.
        speeds_m_s: average speeds at its nodes; None while previews pass unchanged.
        weights: inverse variances of these, in multiples of a single preview far ahead.
    """

    preview: LeaderPreview | None = None
    roughness_m2_s4: float = 0.0
    speeds_m_s: FloatArray | None = None
    weights: FloatArray | None = None

    @property
    def is_noisy(self) -> bool:
        """Whether the previews are averaged."""
        return self.roughness_m2_s4 >= ROUGH_M2_S4

    @property
    def noise(self) -> str:
        """How rough the previews are, empty if they pass unchanged."""
        if not self.is_noisy:
            return ""
        return f"previews {math.sqrt(self.roughness_m2_s4):.1f} m/s per s"
