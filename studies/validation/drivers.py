"""How far a lead vehicle may fall behind its predicted position: 99 % bounds over speed and acceleration.

The prediction lets the present acceleration decay with a time constant of 4 s down to standstill, as the
`history` predictor of the V2X bridge does. The bound is a table over speed and acceleration of the last
second for each lead time, bilinear between its nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from studies.validation.excerpts import Drive, Driver
from studies.validation.outcome import Comparison, Curve, Figure, Outcome

from iptm_core.markdown import render_page
from iptm_core.state import FloatArray
from iptm_drives.predictor_training import predicted_distance_m

NAMES = {
    Driver.ADAPTIVE_CRUISE_CONTROL: "OpenACC, adaptive cruise control",
    Driver.ROAD: "i3 trips",
}
LOWEST_PERCENT, HIGHEST_PERCENT = 98.5, 99.7
LEADS_S = (1.0, 2.0, 3.0, 5.0, 10.0)
SHOWN_LEAD = 2
"""Index of the lead time in the pictures."""
SMALLEST_SPEED_M_S = 0.5
"""A standing vehicle cannot fall behind: it is not counted."""


@dataclass(frozen=True)
class LeadBound:
    """Bound of one kind of driver.

    Attributes:
        driver: whose drives they are.
        fitted_on: names of the runs.
        level: level of the quantile regression; with it, runs that are left out of a fit keep about 99 %.
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
        speeds = hats(speed_m_s, self.speeds_m_s)
        accelerations = hats(acceleration_m_s2, self.accelerations_m_s2)
        weights = (speeds[:, :, None] * accelerations[:, None]).reshape(len(speed_m_s), -1)
        limits: FloatArray = np.maximum(weights @ np.array(self.bounds_m[lead]), 0.0)
        return limits


@dataclass(frozen=True)
class LeadBounds:
    """Bounds of all kinds of drivers."""

    groups: tuple[LeadBound, ...]


@dataclass(frozen=True, eq=False)
class Observations:
    """States of a drive and how far the vehicle then fell behind; arrays of shape (n,) and (n, leads)."""

    name: str
    speed_m_s: FloatArray
    acceleration_m_s2: FloatArray
    shortfall_m: FloatArray


def hats(values: FloatArray, nodes: Sequence[float]) -> FloatArray:
    """Return the weights of the nodes in a linear interpolation, constant outside; shape (n, nodes)."""
    return np.column_stack([np.interp(values, nodes, row) for row in np.eye(len(nodes))])


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
    return Observations(drive.name, here[counted], acceleration[counted], shortfall[counted])


def kept_percent(seen: Sequence[Observations], bound: LeadBound) -> list[float]:
    """Return the share of observations within a bound, by lead time."""
    shares = []
    for lead in range(len(LEADS_S)):
        kept = counted = 0
        for one in seen:
            known = np.isfinite(one.shortfall_m[:, lead])
            limit = bound.at(lead, one.speed_m_s[known], one.acceleration_m_s2[known])
            kept += int(np.sum(one.shortfall_m[known, lead] <= limit))
            counted += int(known.sum())
        shares.append(100.0 * kept / counted)
    return shares


def compare_drivers(drives: Sequence[Drive], bounds: LeadBounds) -> Outcome:
    """Compare the bounds with the runs that were not fitted."""
    figures: list[Figure] = []
    comparisons = []
    for driver, name in NAMES.items():
        bound = next(group for group in bounds.groups if group.driver == driver)
        others = [one for one in drives if one.driver is driver and one.run not in bound.fitted_on]
        seen = [one for one in map(observations, others) if len(one.speed_m_s) > 0]
        part = f"{name}, {len(seen)} drives not fitted"
        figures += [
            Figure(f"kept at {lead_s:g} s", part, share, "%", LOWEST_PERCENT, HIGHEST_PERCENT)
            for lead_s, share in zip(LEADS_S, kept_percent(seen, bound), strict=True)
        ]
        comparisons.append(_picture(name, driver, seen, bound))
    return Outcome(
        title="Lead vehicles: bounds of the predicted position",
        text=render_page(
            Path(__file__).parent, "drivers.md.j2", levels=[one.level for one in bounds.groups]
        ),
        figures=tuple(figures),
        comparisons=tuple(comparisons),
    )


def _picture(
    name: str, driver: Driver, seen: Sequence[Observations], bound: LeadBound
) -> Comparison:
    curves = []
    for one in seen:
        limit = bound.at(SHOWN_LEAD, one.speed_m_s, one.acceleration_m_s2)
        shortfall = one.shortfall_m[:, SHOWN_LEAD]
        known = np.isfinite(shortfall)
        if known.any():
            outside = 100.0 * float(np.mean(shortfall[known] > limit[known]))
            minutes = np.arange(len(limit)) / 60.0
            curves.append(Curve(one.name, outside, minutes, shortfall, limit))
    return Comparison(
        f"drivers_{driver}",
        f"{name}: shortfall after 3 s (measured) and its bound (model)",
        "time in motion in min",
        "m",
        "share outside in %",
        tuple(curves),
    )
