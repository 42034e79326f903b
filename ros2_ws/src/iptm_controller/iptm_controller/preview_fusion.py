"""Noisy previews, averaged: consecutive previews of the same seconds are estimates of the same motion.

Previews with independent errors differ in a way in which no driver changes plans:
the difference of two of them varies along the preview. A driver who brakes, or a prediction that follows the
present speed, changes the preview smoothly. The roughness of the differences gives the noise; below a
threshold previews pass unchanged, to the last bit. Above it the speeds of an instant are averaged over the
previews received so far, weighted by the inverse of their variances (Y. Bar-Shalom, X. R. Li, T. Kirubarajan,
Estimation with Applications to Tracking and Navigation, 2001, section 3.4.1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from iptm_core.state import FloatArray, LeaderPreview

FORGETTING_PER_S = 0.1
"""Share by which the weight of earlier previews, and of earlier roughness, falls in a second."""
ROUGH_M_S2 = 0.3
"""Root mean square of the rate at which differences vary along the preview, from which on they are noise.
Errors of 0.5 m/s that are correlated over 5 s reach it."""
ERROR_GROWTH_S = 5.0
"""The error of a preview is small now and reaches its standard deviation at lead times beyond this."""
LEAST_VARIANCE = 1e-3
"""Of the speed now, as a share of that at long lead times."""
ANOTHER_PLAN_M_S = 5.0
"""A preview that differs from the average by more (root mean square) begins a new average."""
_ROUNDING_S = 1e-9


@dataclass(frozen=True)
class FusionMemory:
    """What is carried from tick to tick.

    Attributes:
        preview: the newest preview as received; None before the first one.
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
        return self.roughness_m2_s4 >= ROUGH_M_S2**2


class PreviewFusion:
    """Passes consistent previews on, averages noisy ones."""

    def __init__(self) -> None:
        self.memory = FusionMemory()

    @property
    def noise(self) -> str:
        """How rough the previews are, empty if they pass unchanged."""
        if not self.memory.is_noisy:
            return ""
        return f"previews {math.sqrt(self.memory.roughness_m2_s4):.1f} m/s per s"

    def fused(self, preview: LeaderPreview) -> LeaderPreview:
        """Return a preview, averaged with those received before if they are noisy.

        Args:
            preview: well formed, not empty. One that was received before is not counted again, a different
                one of the same instant replaces it, and an earlier one begins a new trip.
        """
        memory, before = self.memory, self.memory.preview
        if before is None or preview.generated_at_s < before.generated_at_s:
            self.memory = FusionMemory(preview)
        elif preview.generated_at_s > before.generated_at_s:
            self.memory = _updated(memory, before, preview)
        elif not _are_equal(before, preview):
            self.memory = FusionMemory(preview, memory.roughness_m2_s4)
        speeds = self.memory.speeds_m_s
        if speeds is None:
            return preview
        moved = np.cumsum(0.5 * np.diff(preview.times_s) * (speeds[1:] + speeds[:-1]))
        positions = preview.positions_m[0] + np.concatenate([[0.0], moved])
        return replace(preview, positions_m=positions, speeds_m_s=speeds)


def _updated(memory: FusionMemory, before: LeaderPreview, now: LeaderPreview) -> FusionMemory:
    """Return the memory after another preview."""
    elapsed_s = now.generated_at_s - before.generated_at_s
    kept = (1.0 - FORGETTING_PER_S) ** elapsed_s
    times = now.times_s
    first, last = np.searchsorted(times, before.times_s[[0, -1]] + _ROUNDING_S * np.array([-1, 1]))
    if last - first < 2:
        return FusionMemory(now, memory.roughness_m2_s4)
    common = slice(int(first), int(last))
    difference = (now.speeds_m_s - np.interp(times, before.times_s, before.speeds_m_s))[common]
    rates = np.diff(difference) / np.diff(times[common])
    rough = memory.roughness_m2_s4
    rough += (1.0 - kept) * (float(rates @ rates) / rates.size - rough)
    begun = FusionMemory(now, rough)
    if not begun.is_noisy:
        return begun
    earlier, weights = before.speeds_m_s, _weights(before)
    if memory.speeds_m_s is not None and memory.weights is not None:
        earlier, weights = memory.speeds_m_s, memory.weights
    expected = np.interp(times, before.times_s, earlier)
    innovation = (now.speeds_m_s - expected)[common]
    if float(np.mean(innovation * innovation)) > ANOTHER_PLAN_M_S**2:
        return begun
    old = np.zeros(times.size)
    old[common] = kept * np.interp(times[common], before.times_s, weights)
    new = _weights(now)
    speeds = (old * expected + new * now.speeds_m_s) / (old + new)
    return replace(begun, speeds_m_s=speeds, weights=old + new)


def _are_equal(one: LeaderPreview, other: LeaderPreview) -> bool:
    return np.array_equal(one.times_s, other.times_s) and np.array_equal(
        one.speeds_m_s, other.speeds_m_s
    )


def _weights(preview: LeaderPreview) -> FloatArray:
    """Return the inverse variances of the speeds of one preview, 1 far ahead."""
    lead_s = np.maximum(preview.times_s - preview.generated_at_s, 0.0)
    variances: FloatArray = -np.expm1(-2.0 * lead_s / ERROR_GROWTH_S)
    return 1.0 / np.maximum(variances, LEAST_VARIANCE)
