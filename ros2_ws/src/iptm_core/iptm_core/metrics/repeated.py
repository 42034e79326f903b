"""A trip that is driven over and over: its figures once the temperature of the pack repeats.

A repetition begins with the motion and the temperatures with which the one before ended, and with the charge
of the trip: the pack has been charged. Where it ends as warm as it began, its figures hold for every one that
follows, and no end of a trip is left to correct. Figures are linear in the drift of the temperature over a
repetition, near none: between repetitions that cool the pack and others that warm it, they are interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.state import FloatArray


@dataclass(frozen=True)
class Repetition:
    """Figures of one repetition.

    Attributes:
        energy_per_distance_j_m: battery energy, less what the motion at the end holds more than at the start.
        capacity_loss: of both cells together.
        cell_losses: by the laws of measured cells, by name.
        start_k: mean temperature of both cells.
        drift_k: by how much they are warmer at the end.
    """

    energy_per_distance_j_m: float
    capacity_loss: float
    cell_losses: Mapping[str, float]
    start_k: float
    drift_k: float

    @classmethod
    def of(cls, metrics: RunMetrics, start_k: float, start_kinetic_energy_j: float) -> Repetition:
        """Return the figures of a repetition from its metrics."""
        motion_j = metrics.final_kinetic_energy_j - start_kinetic_energy_j
        energy_j = metrics.battery_energy_j - motion_j
        return cls(
            energy_j / metrics.distance_m if metrics.distance_m > 0.0 else math.nan,
            metrics.degradation,
            metrics.cell_losses,
            start_k,
            metrics.final_temperature_k - start_k,
        )


@dataclass(frozen=True)
class Repeated:
    """Figures of a repetition without drift.

    Attributes:
        energy_error: relative error of the energy: half of what the last repetitions were corrected by.
        aging_error: the same of the capacity loss.
        repetitions: how many were driven.
    """

    energy_per_distance_j_m: float
    capacity_loss: float
    cell_losses: Mapping[str, float]
    energy_error: float
    aging_error: float
    repetitions: int


SMALL_DRIFT_K, NEAR_K, FADING = 0.07, 1.0, 0.7
"""Drifts below the first count alike, as do temperatures nearer than the second; earlier ones count less."""
SAME_DRIFT_K = 1e-9
"""Drifts that differ by rounding alone show no line."""


def without_drift(tiles: Sequence[Repetition], driven: int) -> Repeated:
    """Return the figures of repetitions of any temperatures where it would not change.

    A line through the figures over the drift is read at no drift. Small drifts, temperatures near to the last
    one, and late repetitions count most.

    Args:
        tiles: one or more, in the order of driving.
        driven: how many were driven for them.
    """
    drifts_k = np.array([each.drift_k for each in tiles])
    apart_k = np.array([each.start_k - tiles[-1].start_k for each in tiles])
    weights = FADING ** np.arange(len(tiles))[::-1] / (drifts_k**2 + SMALL_DRIFT_K**2)
    weights /= 1.0 + (apart_k / NEAR_K) ** 2
    weights /= weights.sum()
    mean_k = float(weights @ drifts_k)
    spread_k2 = float(weights @ (drifts_k - mean_k) ** 2)
    has_line = spread_k2 > SAME_DRIFT_K**2
    slopes = weights * (drifts_k - mean_k) / spread_k2 if has_line else 0.0 * weights
    return _mixed(tiles, weights, weights - mean_k * slopes, driven)


def over_cycles(tiles: Sequence[Repetition], driven: int) -> Repeated:
    """Return the mean figures of consecutive repetitions at whose bounds the pack is equally warm.

    They belong to a thermostat, which cools in some repetitions and not in others. What drift is left over
    is taken out by the difference of those that cool the pack and those that warm it.
    """
    first, last = closed_stretch(tiles)
    drifts_k = np.array([each.drift_k for each in tiles])
    chosen = np.zeros(len(tiles))
    chosen[first:last] = 1.0 / (last - first)
    cooled, warmed = chosen * (drifts_k < 0.0), chosen * (drifts_k >= 0.0)
    if not cooled.any() or not warmed.any():
        return without_drift(tiles, driven)
    cooled, warmed = cooled / cooled.sum(), warmed / warmed.sum()
    apart_k = float((warmed - cooled) @ drifts_k)
    share = float(chosen @ drifts_k) / apart_k
    return _mixed(tiles, chosen, chosen - share * (warmed - cooled), driven)


def closed_stretch(tiles: Sequence[Repetition]) -> tuple[int, int]:
    """Return the bounds of the consecutive repetitions whose drifts add up to the least, per repetition.

    Only stretches with repetitions that cool the pack and with others that warm it count; without any, all.
    """
    bounds_k = np.concatenate(([0.0], np.cumsum([each.drift_k for each in tiles])))
    best, least_k = (0, len(tiles)), math.inf
    for first in range(len(tiles)):
        for last in range(first + 2, len(tiles) + 1):
            signs = {each.drift_k < 0.0 for each in tiles[first:last]}
            apart_k = abs(bounds_k[last] - bounds_k[first]) / (last - first)
            if len(signs) > 1 and apart_k < least_k:
                best, least_k = (first, last), apart_k
    return best


def _mixed(
    tiles: Sequence[Repetition], plain: FloatArray, corrected: FloatArray, driven: int
) -> Repeated:
    """Return figures of repetitions with weights; the error is half of what the correction changes."""
    energies = np.array([each.energy_per_distance_j_m for each in tiles])
    losses = np.array([each.capacity_loss for each in tiles])
    names = set.intersection(*(set(each.cell_losses) for each in tiles))
    energy_j_m, lost = float(corrected @ energies), float(corrected @ losses)
    return Repeated(
        energy_j_m,
        lost,
        {
            name: float(corrected @ [each.cell_losses[name] for each in tiles])
            for name in tiles[0].cell_losses
            if name in names
        },
        0.5 * abs(1.0 - float(plain @ energies) / energy_j_m),
        0.5 * abs(1.0 - float(plain @ losses) / lost) if lost else math.nan,
        driven,
    )
