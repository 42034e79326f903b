"""A trip that is driven over and over: its figures once the temperature of the pack repeats.

A repetition begins with the motion and the temperatures with which the one before ended, and with the charge
of the trip: the pack has been charged. Where it ends as warm as it began, its figures hold for every one that
follows, and no end of a trip is left to correct. Figures are linear in the drifts of both cells over a
repetition, near none: between repetitions that drift differently, they are interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

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
        drifts_k: by how much both cells are warmer at the end.
    """

    energy_per_distance_j_m: float
    capacity_loss: float
    cell_losses: Mapping[str, float]
    drifts_k: tuple[float, float]

    @classmethod
    def of(
        cls, metrics: RunMetrics, drifts_k: tuple[float, float], start_kinetic_energy_j: float
    ) -> Repetition:
        """Return the figures of a repetition from its metrics."""
        motion_j = metrics.final_kinetic_energy_j - start_kinetic_energy_j
        energy_j = metrics.battery_energy_j - motion_j
        return cls(
            energy_j / metrics.distance_m if metrics.distance_m > 0.0 else math.nan,
            metrics.degradation,
            metrics.cell_losses,
            drifts_k,
        )

    @property
    def drift_k(self) -> float:
        """By how much the mean of both cells is warmer at the end."""
        return 0.5 * sum(self.drifts_k)


@dataclass(frozen=True)
class Repeated:
    """Figures of a repetition without drift.

    Attributes:
        energy_error: relative error of the energy: half of what drifts of the last repetitions matter, or
            of what the beginning of cycles that do not close does.
        aging_error: the same of the capacity loss.
        repetitions: how many were driven.
    """

    energy_per_distance_j_m: float
    capacity_loss: float
    cell_losses: Mapping[str, float]
    energy_error: float
    aging_error: float
    repetitions: int


NOTED_DRIFT_K = 0.01
"""Differences of drifts that are noise of the control rather than the way to where it settles."""
REMEMBERED = 2
"""Differences of repetitions that are used, one for each cell."""


def settling_weights(tiles: Sequence[Repetition]) -> FloatArray:
    """Return the weights of repetitions whose weighted drifts are least, shape (n,), of sum 1.

    These are the weights of Anderson's acceleration of the repetitions as an iteration to a fixed point: the
    last repetition, less what its drifts have in common with the last changes of the drifts (least squares,
    with `NOTED_DRIFT_K` as the regularization).
    """
    drifts_k = np.array([each.drifts_k for each in tiles])
    steps_k = np.diff(drifts_k, axis=0)[-REMEMBERED:]
    weights = np.zeros(len(tiles))
    weights[-1] = 1.0
    if len(steps_k):
        normal = steps_k @ steps_k.T + NOTED_DRIFT_K**2 * np.eye(len(steps_k))
        shares = np.linalg.solve(normal, steps_k @ drifts_k[-1])
        weights[-len(shares) :] -= shares
        weights[-len(shares) - 1 : -1] += shares
    return weights


def without_drift(tiles: Sequence[Repetition], driven: int) -> Repeated:
    """Return the figures of repetitions of any temperatures where these would not change.

    Args:
        tiles: one or more, in the order of driving.
        driven: how many were driven for them.
    """
    last = np.zeros(len(tiles))
    last[-1] = 1.0
    return _mixed(tiles, last, settling_weights(tiles), driven)


def over_noise(tiles: Sequence[Repetition], driven: int) -> Repeated:
    """Return the mean figures of repetitions that differ by the noise of the control only.

    Args:
        tiles: two or more.
        driven: how many were driven for them.

    Returns:
        Figures whose errors are the standard errors of the means.
    """
    count = len(tiles)
    weights = np.full(count, 1.0 / count)
    found = _mixed(tiles, weights, weights, driven)
    energies = [each.energy_per_distance_j_m / found.energy_per_distance_j_m for each in tiles]
    losses = [each.capacity_loss / found.capacity_loss for each in tiles if found.capacity_loss]
    energy_error, aging_error = (
        float(np.std(each, ddof=1)) / math.sqrt(count) if each else math.nan
        for each in (energies, losses)
    )
    return replace(found, energy_error=energy_error, aging_error=aging_error)


def over_cycles(tiles: Sequence[Repetition], driven: int) -> Repeated:
    """Return the mean figures of consecutive repetitions at whose bounds the pack is equally warm.

    They belong to a thermostat, which cools in some repetitions and not in others. What drift is left over
    is taken out by the difference of those that cool the pack and those that warm it.
    """
    first, last = closed_stretch(tiles)
    both_k = np.array([each.drifts_k for each in tiles])
    drifts_k = both_k.mean(axis=1)
    chosen = np.zeros(len(tiles))
    chosen[first:last] = 1.0 / (last - first)
    cooled, warmed = chosen * (drifts_k < 0.0), chosen * (drifts_k >= 0.0)
    if not cooled.any() or not warmed.any():
        return without_drift(tiles, driven)
    cooled, warmed = cooled / cooled.sum(), warmed / warmed.sum()
    apart_k = float((warmed - cooled) @ drifts_k)
    left_over_k = float(np.abs(chosen @ both_k).max())
    found = chosen - float(chosen @ drifts_k) / apart_k * (warmed - cooled)
    return _mixed(tiles, found - left_over_k / apart_k * (warmed - cooled), found, driven)


def over_open_cycles(tiles: Sequence[Repetition], driven: int) -> Repeated:
    """Return the figures of repetitions whose cycles do not close.

    Where they begin decides on their mean: the error is half of the range that later beginnings give.
    """
    found = over_cycles(tiles, driven)
    later = [over_cycles(tiles[first:], driven) for first in range(max(len(tiles) // 2, 1))]
    energies = [each.energy_per_distance_j_m / found.energy_per_distance_j_m for each in later]
    losses = [each.capacity_loss / found.capacity_loss for each in later if found.capacity_loss]
    return replace(
        found,
        energy_error=max(found.energy_error, 0.5 * float(np.ptp(energies))),
        aging_error=max(found.aging_error, 0.5 * float(np.ptp(losses or [0.0]))),
    )


def closed_stretch(tiles: Sequence[Repetition]) -> tuple[int, int]:
    """Return the bounds of the consecutive repetitions whose drifts of both cells add up to the least, each.

    Only stretches with repetitions that cool the pack and with others that warm it count; without any, all.
    """
    bounds_k = np.cumsum([(0.0, 0.0), *(each.drifts_k for each in tiles)], axis=0)
    best, least_k = (0, len(tiles)), math.inf
    for first in range(len(tiles)):
        for last in range(first + 2, len(tiles) + 1):
            signs = {each.drift_k < 0.0 for each in tiles[first:last]}
            apart_k = float(np.abs(bounds_k[last] - bounds_k[first]).max()) / (last - first)
            if len(signs) > 1 and apart_k < least_k:
                best, least_k = (first, last), apart_k
    return best


def _mixed(
    tiles: Sequence[Repetition], plain: FloatArray, corrected: FloatArray, driven: int
) -> Repeated:
    """Return figures of repetitions with weights; the error is half of the difference to others."""
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
