"""How far a lead vehicle may fall behind its predicted position: 99 % bounds over speed and acceleration.

The prediction lets the present acceleration decay with a time constant of 4 s down to standstill, as the
`history` predictor of the V2X bridge does. The bound is a table over speed and acceleration of the last
second for each lead time, bilinear between its nodes, fitted by quantile regression.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from studies.validation.circuit import hats
from studies.validation.measurements import Drive, Driver

from iptm.parts import FloatArray, held_out, predicted_distance_m, quantile_regression

LEADS_S = (1.0, 2.0, 3.0, 5.0, 10.0)
SMALLEST_SPEED_M_S = 0.5
"""A standing vehicle cannot fall behind: it is not counted."""
SPEEDS_M_S = (0.0, 5.0, 10.0, 18.0, 30.0)
ACCELERATIONS_M_S2 = (-1.0, 0.0, 0.6)
LEVELS = {
    Driver.ADAPTIVE_CRUISE_CONTROL: 0.993,
    Driver.PROVING_GROUND: 0.991,
    Driver.ROAD: 0.993,
}
"""Levels of the fits: with these, runs that are left out of a fit keep about 99 %."""
ONE_CURVE = (0.0,)
"""Nodes of a bound that is the same in all states, for comparison."""
MOST_SAMPLES = 6000
FOLDS = 5


@dataclass(frozen=True)
class LeadBound:
    """Bound of one kind of driver.

    Attributes:
        driver: whose drives they are.
        fitted_on: names of the runs.
        level: level of the quantile regression.
        leads_s: times since the observation.
        speeds_m_s: nodes of the speed.
        accelerations_m_s2: nodes of the acceleration.
        bounds_m: bounds; for each lead time the nodes of speed, for each of these the accelerations.
    """

    driver: str
    fitted_on: tuple[str, ...]
    level: float
    leads_s: tuple[float, ...]
    speeds_m_s: tuple[float, ...]
    accelerations_m_s2: tuple[float, ...]
    bounds_m: tuple[tuple[float, ...], ...]

    def at(self, lead: int, speed_m_s: FloatArray, acceleration_m_s2: FloatArray) -> FloatArray:
        """Return the bounds at a lead time, by its index, for states of shape (n,)."""
        weights = _weights(speed_m_s, acceleration_m_s2, self.speeds_m_s, self.accelerations_m_s2)
        limits: FloatArray = np.maximum(weights @ np.array(self.bounds_m[lead]), 0.0)
        return limits


@dataclass(frozen=True)
class LeadBounds:
    """Bounds of all kinds of drivers."""

    groups: tuple[LeadBound, ...]

    def of(self, driver: Driver) -> LeadBound | None:
        """Return the bound of one kind of driver, None if it was not fitted."""
        return next((group for group in self.groups if group.driver == driver.value), None)


@dataclass(frozen=True, eq=False)
class Observations:
    """States of a drive and how far the vehicle then fell behind; arrays of shape (n,) and (n, leads)."""

    drive: Drive
    speed_m_s: FloatArray
    acceleration_m_s2: FloatArray
    shortfall_m: FloatArray


def _weights(
    speed_m_s: FloatArray,
    acceleration_m_s2: FloatArray,
    speeds: Sequence[float],
    accelerations: Sequence[float],
) -> FloatArray:
    products = hats(speed_m_s, speeds)[:, :, None] * hats(acceleration_m_s2, accelerations)[:, None]
    return products.reshape(len(speed_m_s), len(speeds) * len(accelerations))


def observations(drive: Drive) -> Observations:
    """Return one state per second of a drive, with the distance by which it fell behind the prediction.

    A state without a recorded second before it is left out, and the shortfall is NaN across gaps and
    beyond the end.
    """
    speed = drive.speed_m_s
    second = round(1.0 / drive.step_s)
    at = np.arange(2 * second, len(speed) - 1, second)
    known = np.isfinite(speed)
    steps = np.where(known[1:] & known[:-1], 0.5 * (speed[1:] + speed[:-1]) * drive.step_s, 0.0)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    unknown = np.concatenate([[0], np.cumsum(~(known[1:] & known[:-1]))])
    here, before = speed[at], speed[at - second]
    acceleration = here - before
    shortfall = np.full((len(at), len(LEADS_S)), np.nan)
    for index, lead_s in enumerate(LEADS_S):
        after = at + round(lead_s / drive.step_s)
        inside = np.flatnonzero(after < len(speed))
        inside = inside[unknown[after[inside]] == unknown[at[inside]]]
        moved = travelled[after[inside]] - travelled[at[inside]]
        expected = predicted_distance_m(here[inside], acceleration[inside], lead_s)
        shortfall[inside, index] = expected - moved
    counted = np.isfinite(acceleration) & (here > SMALLEST_SPEED_M_S)
    return Observations(drive, here[counted], acceleration[counted], shortfall[counted])


def fit_bound(
    seen: Sequence[Observations],
    driver: Driver,
    *,
    speeds: tuple[float, ...] = SPEEDS_M_S,
    accelerations: tuple[float, ...] = ACCELERATIONS_M_S2,
) -> LeadBound:
    """Fit the bound of one kind of driver to all of the observations given."""
    level = LEVELS[driver]
    speed = np.concatenate([one.speed_m_s for one in seen])
    acceleration = np.concatenate([one.acceleration_m_s2 for one in seen])
    shortfall = np.concatenate([one.shortfall_m for one in seen])
    every = max(len(speed) // MOST_SAMPLES, 1)
    weights = _weights(speed, acceleration, speeds, accelerations)[::every]
    bounds = []
    for index in range(len(LEADS_S)):
        values = shortfall[::every, index]
        known = np.isfinite(values)
        found = quantile_regression(weights[known], values[known], level)
        bounds.append(tuple(max(float(value), 0.0) for value in found))
    runs = tuple(sorted({one.drive.run for one in seen}))
    return LeadBound(driver.value, runs, level, LEADS_S, speeds, accelerations, tuple(bounds))


def fit_bounds(drives: Sequence[Drive], report: Callable[[str], None]) -> LeadBounds:
    """Fit the bounds of all kinds of drivers, on two thirds of the runs.

    People drove few of the runs on proving grounds: their bound is fitted to all of them, and is tried by
    leaving runs out of fits of its own.
    """
    groups = []
    every_third = held_out([drive.run for drive in drives])
    for driver in Driver:
        own = [drive for drive in drives if drive.driver is driver]
        if not own:
            continue
        report(f"bounds of {driver}")
        kept_back = set() if driver is Driver.PROVING_GROUND else every_third
        seen = [observations(drive) for drive in own if drive.run not in kept_back]
        groups.append(fit_bound(seen, driver))
    return LeadBounds(tuple(groups))


@dataclass(frozen=True, eq=False)
class Coverage:
    """How often a bound was kept.

    Attributes:
        kept: observations within the bound, per drive and lead time, shape (drives, leads).
        counted: observations, same shape.
        widths_m: sum of the bounds, same shape.
    """

    kept: FloatArray
    counted: FloatArray
    widths_m: FloatArray

    def share(self) -> FloatArray:
        """Return the share of observations within the bound, per lead time."""
        return np.asarray(self.kept.sum(axis=0) / np.maximum(self.counted.sum(axis=0), 1.0))

    def mean_width_m(self) -> FloatArray:
        """Return the mean bound per lead time."""
        return np.asarray(self.widths_m.sum(axis=0) / np.maximum(self.counted.sum(axis=0), 1.0))

    def interval(self, draws: int = 2000) -> tuple[FloatArray, FloatArray]:
        """Return the 95 % interval of the share by a bootstrap over drives, with a fixed seed."""
        generator = np.random.default_rng(20261123)
        size = len(self.kept)
        chosen = generator.integers(0, size, (draws, size))
        shares = self.kept[chosen].sum(axis=1) / np.maximum(self.counted[chosen].sum(axis=1), 1.0)
        low, high = np.quantile(shares, [0.025, 0.975], axis=0)
        return low, high

    @staticmethod
    def joined(parts: Sequence[Coverage]) -> Coverage:
        """Return several coverages as one."""
        return Coverage(
            np.vstack([part.kept for part in parts]),
            np.vstack([part.counted for part in parts]),
            np.vstack([part.widths_m for part in parts]),
        )


def coverage(seen: Sequence[Observations], bound: LeadBound) -> Coverage:
    """Compare a bound with observations."""
    shape = (len(seen), len(LEADS_S))
    kept, counted, widths = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for row, one in enumerate(seen):
        for lead in range(len(LEADS_S)):
            known = np.isfinite(one.shortfall_m[:, lead])
            limit = bound.at(lead, one.speed_m_s[known], one.acceleration_m_s2[known])
            kept[row, lead] = np.sum(one.shortfall_m[known, lead] <= limit)
            counted[row, lead] = known.sum()
            widths[row, lead] = limit.sum()
    return Coverage(kept, counted, widths)


def left_out_coverage(
    seen: Sequence[Observations],
    driver: Driver,
    *,
    speeds: tuple[float, ...] = SPEEDS_M_S,
    accelerations: tuple[float, ...] = ACCELERATIONS_M_S2,
) -> Coverage:
    """Return the coverage on runs that were left out, in five folds over the runs."""
    runs = sorted({one.drive.run for one in seen})
    parts = []
    for fold in range(min(FOLDS, len(runs))):
        out = set(runs[fold::FOLDS])
        fitted = fit_bound(
            [one for one in seen if one.drive.run not in out],
            driver,
            speeds=speeds,
            accelerations=accelerations,
        )
        parts.append(coverage([one for one in seen if one.drive.run in out], fitted))
    return Coverage.joined(parts)
