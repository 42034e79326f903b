"""Checks of statements about powers over the time of a trip, and the timing of the cooling."""

from __future__ import annotations

import numpy as np

from iptm_reproduction.check import Check, Finding, graded
from iptm_reproduction.quantities import (
    HIGH_PERCENTILE,
    LOW_PERCENTILE,
    PowerRegions,
    battery_power_kw,
    traction_power_kw,
)
from iptm_reproduction.runs import Results, name_of, names_of


def power_regions(run: str, others: tuple[str, ...], reference: str) -> Check:
    """Check that a run spends less time at high and more at low power than others.

    Args:
        run: the run.
        others: the runs to compare with.
        reference: the run whose distribution of power says what is low and what is high.
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
