"""Checks of statements about powers and cell temperatures over the time of a trip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from iptm_reproduction.check import Check, Finding, graded
from iptm_reproduction.quantities import (
    HIGH_PERCENTILE,
    LOW_PERCENTILE,
    PowerRegions,
    battery_power_kw,
    busiest_window,
    celsius,
    mean_cell_temperature_c,
    time_to_fall_s,
    traction_power_kw,
)
from iptm_reproduction.runs import ReportRun, Results, name_of, names_of


def power_regions(run: str, others: tuple[str, ...], reference: str) -> Check:
    """Check that a run spends less time at high and more at low power than others.

    Args:
        run: the run.
        others: the runs to compare with.
        reference: the run whose distribution of power defines low and high power.
    """

    def judge(results: Results) -> Finding:
        regions = PowerRegions.of_reference(results[reference].trajectory)
        shares = {name: regions.shares(results[name].trajectory) for name in (run, *others)}
        low, _, high = shares[run]
        less_high = all(high < shares[other][2] for other in others)
        more_low = all(low > shares[other][0] for other in others)
        found = "; ".join(
            f"{name_of(name)}: low {100.0 * share[0]:.2f} %, high {100.0 * share[2]:.2f} % of the time"
            for name, share in shares.items()
        )
        return Finding(
            graded(less_high and more_low, less_high or more_low),
            f"{found} (bounds {regions.low_kw:.2f} and {regions.high_kw:.2f} kW)",
        )

    return Check(
        f"Low power is up to percentile {LOW_PERCENTILE:g}, high power from percentile {HIGH_PERCENTILE:g} "
        f"of the battery power of {name_of(reference)}. Reproduced if {name_of(run)} spends less time at "
        f"high and more at low power than {names_of(others)}; in sign only if one of the two holds against "
        "each.",
        (run, *others, reference),
        judge,
    )


def lower_peaks(run: str, others: tuple[str, ...], percentile: float) -> Check:
    """Check that a high percentile of the battery power of a run lies below that of others."""

    def judge(results: Results) -> Finding:
        peaks = {
            name: float(np.percentile(battery_power_kw(results[name].trajectory), percentile))
            for name in (run, *others)
        }
        return Finding(
            graded(all(peaks[run] < peaks[other] for other in others)),
            "; ".join(f"{name_of(name)} {peak:.2f} kW" for name, peak in peaks.items()),
        )

    return Check(
        f"Reproduced if percentile {percentile:g} of the battery power of {name_of(run)} lies below that of "
        f"{names_of(others)}.",
        (run, *others),
        judge,
    )


def traction_dominates(run: str, factor: float) -> Check:
    """Check that traction power is much larger than compressor and auxiliary power, in mean magnitude."""

    def judge(results: Results) -> Finding:
        trip = results[run].trajectory
        traction = float(np.mean(np.abs(traction_power_kw(trip))))
        other = 1e-3 * float(np.mean(trip.compressor_power_w[1:] + trip.auxiliary_power_w[1:]))
        ratio = traction / other
        return Finding(
            graded(ratio >= factor, ratio > 1.0),
            f"{traction:.2f} kW traction, {other:.2f} kW compressor and auxiliaries, ratio {ratio:.1f}",
        )

    return Check(
        f"Mean magnitude of the traction power of {name_of(run)} over that of compressor plus auxiliaries: "
        f"reproduced from a ratio of {factor:g} on, in sign only above 1.",
        (run,),
        judge,
    )


def cools_off_peak(run: str) -> Check:
    """Check that the compressor runs less at high traction power than at low one and while braking."""

    def judge(results: Results) -> Finding:
        trip = results[run].trajectory
        traction, compressor = traction_power_kw(trip), trip.compressor_power_w[1:]
        low, high = np.percentile(traction, [LOW_PERCENTILE, HIGH_PERCENTILE])
        means = {
            name: float(np.mean(compressor[rows])) if np.any(rows) else float("nan")
            for name, rows in (
                (f"above {high:.1f} kW traction", traction > high),
                (f"up to {low:.1f} kW", traction <= low),
                ("braking", traction < 0.0),
            )
        }
        at_high, at_low, braking = means.values()
        below = (at_high < at_low, at_high < braking)
        return Finding(
            graded(all(below), any(below)),
            "; ".join(f"{name}: {value:.0f} W" for name, value in means.items()),
        )

    return Check(
        f"Reproduced if the mean compressor power of {name_of(run)} above percentile {HIGH_PERCENTILE:g} of "
        f"its traction power is below that up to percentile {LOW_PERCENTILE:g} and below that while braking; "
        "in sign only if below one of them.",
        (run,),
        judge,
    )


def settles_near(run: str, printed_c: float, tolerance_k: float, last_share: float) -> Check:
    """Check that both cells stay near a printed temperature over the last share of a trip."""

    def judge(results: Results) -> Finding:
        trip = results[run].trajectory
        rows = slice(int((1.0 - last_share) * len(trip)), None)
        start = float(celsius(trip.cell_1_temperature_k)[0])
        mean_1 = float(np.mean(celsius(trip.cell_1_temperature_k)[rows]))
        mean_n = float(np.mean(celsius(trip.cell_n_temperature_k)[rows]))
        mean = 0.5 * (mean_1 + mean_n)
        return Finding(
            graded(
                abs(mean - printed_c) <= tolerance_k,
                min(printed_c, start) <= mean <= max(printed_c, start),
            ),
            f"{mean:.2f} °C (cell 1 {mean_1:.2f}, cell N {mean_n:.2f} °C)",
            f"{printed_c:g} °C",
        )

    return Check(
        f"Mean temperature of both cells of {name_of(run)} over the last {100.0 * last_share:g} % of the "
        f"trip: reproduced within {tolerance_k:g} K of the printed value, in sign only if between that and "
        "the start.",
        (run,),
        judge,
    )


def last_cell_falls_slower(run: str, share: float) -> Check:
    """Check that the last cell cools down by a share of its fall later than the first one."""

    def judge(results: Results) -> Finding:
        trip = results[run].trajectory
        first = time_to_fall_s(trip.time_s, trip.cell_1_temperature_k, share)
        last = time_to_fall_s(trip.time_s, trip.cell_n_temperature_k, share)
        return Finding(graded(last > first), f"cell 1 {first:.0f} s, cell N {last:.0f} s")

    return Check(
        f"Reproduced if cell N of {name_of(run)} takes longer than cell 1 to fall by {100.0 * share:.0f} % "
        "of the way from its start to its lowest temperature.",
        (run,),
        judge,
    )


@dataclass(frozen=True)
class _Demand:
    """The stretch of a trip that draws most traction energy, with mean cell temperatures around it.

    Attributes:
        start_s: where it begins.
        initial_c: temperature at the start of the trip.
        before_c: temperature where the stretch begins.
        highest_c: highest temperature in the stretch.
    """

    start_s: float
    initial_c: float
    before_c: float
    highest_c: float

    @classmethod
    def of(cls, run: ReportRun, length_s: float) -> _Demand:
        start, end = busiest_window(run.trajectory, length_s)
        mean = mean_cell_temperature_c(run.trajectory)
        return cls(
            start_s=float(run.trajectory.time_s[start]),
            initial_c=float(mean[0]),
            before_c=float(mean[start]),
            highest_c=float(np.max(mean[start : end + 1])),
        )


def heats_in_demand(runs: tuple[str, ...], length_s: float, least_rise_k: float) -> Check:
    """Check that the pack warms up during the stretch of highest traction demand."""
    return _around_demand(
        f"In the {length_s:g} s of each run that draw most traction energy (the composition of the printed "
        "cycle is not given, so the stretch is found, not fixed), the mean of both cells rises above its "
        f"value at the start of the stretch: reproduced from {least_rise_k:g} K on in every run, in sign "
        "only if it rises at all.",
        runs,
        length_s,
        least_rise_k,
        lambda demand: demand.highest_c - demand.before_c,
        lambda demand: (
            f"{demand.highest_c - demand.before_c:+.2f} K from {demand.start_s:.0f} s on"
        ),
    )


def cooled_before_demand(runs: tuple[str, ...], length_s: float, least_drop_k: float) -> Check:
    """Check that the pack is clearly cooler at the start of the stretch of highest demand than at first."""
    return _around_demand(
        f"At the start of the {length_s:g} s that draw most traction energy, the mean of both cells is below "
        f"its initial value: reproduced from {least_drop_k:g} K on in every run, in sign only if it is lower "
        "at all.",
        runs,
        length_s,
        least_drop_k,
        lambda demand: demand.initial_c - demand.before_c,
        lambda demand: f"{demand.before_c:.2f} °C at {demand.start_s:.0f} s",
    )


def _around_demand(
    rule: str,
    runs: tuple[str, ...],
    length_s: float,
    least_k: float,
    change_k: Callable[[_Demand], float],
    text: Callable[[_Demand], str],
) -> Check:
    """Check that a temperature changes enough in or before the stretch of highest demand of every run."""

    def judge(results: Results) -> Finding:
        found = {run: _Demand.of(results[run], length_s) for run in runs}
        least = min(map(change_k, found.values()))
        return Finding(
            graded(least >= least_k, least > 0.0),
            "; ".join(f"{name_of(run)}: {text(demand)}" for run, demand in found.items()),
        )

    return Check(rule, runs, judge)
