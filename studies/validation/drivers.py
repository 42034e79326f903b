"""Lead vehicles: coverage of the 99 % bounds of the predicted position."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from studies.validation.lead_vehicle import (
    LEADS_S,
    LEVELS,
    ONE_CURVE,
    Coverage,
    LeadBound,
    LeadBounds,
    Observations,
    coverage,
    fit_bound,
    left_out_coverage,
    observations,
)
from studies.validation.measurements import Drive, Driver
from studies.validation.outcome import Comparison, Curve, Figure, Outcome

from iptm.parts import render_page

NAMES = {
    Driver.ADAPTIVE_CRUISE_CONTROL: "OpenACC, adaptive cruise control",
    Driver.PROVING_GROUND: "OpenACC, human drivers and platoon leaders",
    Driver.ROAD: "i3 trips",
}
LOWEST_PERCENT, HIGHEST_PERCENT = 98.5, 99.7
STATED_PERCENT = 99.0
LEAD_OF_WIDTH = 2
LEAST_GAIN_PERCENT = 10.0
LEFT_OUT_DRIVES = 30
"""With fewer drives than this, a fit without a fifth of them hardly represents the shipped bound."""


def compare_drivers(
    drives: Sequence[Drive], bounds: LeadBounds, report: Callable[[str], None]
) -> Outcome | None:
    """Compare the bounds with the runs that were not fitted, None without such runs.

    Human drivers are few: where the fitted runs are among the data, each fifth of them is left out of a fit.
    """
    figures: list[Figure] = []
    comparisons = []
    for driver, name in NAMES.items():
        bound = bounds.of(driver)
        seen = [observations(drive) for drive in drives if drive.driver is driver]
        seen = [one for one in seen if len(one.speed_m_s) > 0]
        if bound is None or not seen:
            continue
        report(f"coverage, {name}")
        others = [one for one in seen if one.drive.run not in bound.fitted_on]
        fitted = [one for one in seen if one.drive.run in bound.fitted_on]
        one_curve: Coverage | None = None
        if len(fitted) >= LEFT_OUT_DRIVES and driver is Driver.PROVING_GROUND:
            kept = left_out_coverage(seen, driver)
            one_curve = left_out_coverage(seen, driver, speeds=ONE_CURVE, accelerations=ONE_CURVE)
            part = f"{name}, {len(seen)} drives, left out"
        elif others:
            kept = coverage(others, bound)
            if len(fitted) >= len(others):
                constant = fit_bound(fitted, driver, speeds=ONE_CURVE, accelerations=ONE_CURVE)
                one_curve = coverage(others, constant)
            part = f"{name}, {len(others)} drives not fitted"
        else:
            continue
        figures += _coverage_figures(driver, part, kept)
        if one_curve is not None:
            figures.append(_width_figure(driver, part, kept, one_curve))
        if others:
            comparisons.append(_picture(name, driver, others, bound))
    if not figures:
        return None
    return Outcome(
        title="Lead vehicles: bounds of the predicted position",
        text=render_page(Path(__file__).parent, "drivers.md.j2", levels=LEVELS.values()),
        figures=tuple(figures),
        comparisons=tuple(comparisons),
    )


def _coverage_figures(driver: Driver, part: str, kept: Coverage) -> list[Figure]:
    shares = 100.0 * kept.share()
    if driver is not Driver.PROVING_GROUND:
        return [
            Figure(
                f"kept at {lead_s:g} s", part, float(share), "%", LOWEST_PERCENT, HIGHEST_PERCENT
            )
            for lead_s, share in zip(LEADS_S, shares, strict=True)
        ]
    low, high = kept.interval()
    figures = []
    for index, lead_s in enumerate(LEADS_S):
        lowest, highest = 100.0 * float(low[index]), 100.0 * float(high[index])
        label = f"{part} ({shares[index]:.2f} %, 95 % interval {lowest:.2f} to {highest:.2f})"
        # Positive as long as the stated level lies inside the interval.
        inside = min(STATED_PERCENT - lowest, highest - STATED_PERCENT)
        figures.append(
            Figure(f"99 % inside the interval at {lead_s:g} s, by", label, inside, "%", 0.0)
        )
    return figures


def _width_figure(driver: Driver, part: str, kept: Coverage, one_curve: Coverage) -> Figure:
    widths = kept.mean_width_m()[LEAD_OF_WIDTH], one_curve.mean_width_m()[LEAD_OF_WIDTH]
    shares = (100.0 * kept.share()[LEAD_OF_WIDTH], 100.0 * one_curve.share()[LEAD_OF_WIDTH])
    gain = float(100.0 * (1.0 - widths[0] / widths[1]))
    label = f"{part} (kept {shares[0]:.2f} % and {shares[1]:.2f} %)"
    lowest = None if driver is Driver.ROAD else LEAST_GAIN_PERCENT
    return Figure("mean bound at 3 s, tighter than one curve by", label, gain, "%", lowest)


def _picture(
    name: str, driver: Driver, seen: Sequence[Observations], bound: LeadBound
) -> Comparison:
    curves = []
    for one in seen:
        limit = bound.at(LEAD_OF_WIDTH, one.speed_m_s, one.acceleration_m_s2)
        shortfall = one.shortfall_m[:, LEAD_OF_WIDTH]
        known = np.isfinite(shortfall)
        if known.any():
            outside = 100.0 * float(np.mean(shortfall[known] > limit[known]))
            minutes = np.arange(len(limit)) / 60.0
            curves.append(Curve(one.drive.name, outside, minutes, shortfall, limit))
    return Comparison(
        f"drivers_{driver}",
        f"{name}: shortfall after 3 s (measured) and its bound (model)",
        "time in motion in min",
        "m",
        "share outside in %",
        tuple(curves),
    )
