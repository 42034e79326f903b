"""What checks, tables and plots read off a trajectory beyond its metrics, and the statements checked on it.

See ``checks_of_figures.py`` for what a check is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_reproduction.aging import aging_map
from iptm_reproduction.names import name_of
from iptm_reproduction.printed import Finding, graded
from iptm_reproduction.results import Results

LOW_PERCENTILE, HIGH_PERCENTILE = 50, 90
"""Up to the one, power counts as low, from the other on as high; the paper draws regions without values."""


def celsius(temperature_k: FloatArray) -> FloatArray:
    """Return temperatures in degrees Celsius."""
    shifted: FloatArray = temperature_k - CELSIUS_ZERO_K
    return shifted


def mean_cell_temperature_c(run: Trajectory) -> FloatArray:
    """Return the mean of both cells at every row in degrees Celsius, shape (n,)."""
    return 0.5 * (celsius(run.cell_1_temperature_k) + celsius(run.cell_n_temperature_k))


def battery_power_kw(run: Trajectory) -> FloatArray:
    """Return the pack power of every interval, shape (n - 1,); row 0 of a run ends no interval."""
    power: FloatArray = 1e-3 * run.battery_power_w[1:]
    return power


def traction_power_kw(run: Trajectory) -> FloatArray:
    """Return the traction power of every interval, shape (n - 1,)."""
    power: FloatArray = 1e-3 * run.traction_power_w[1:]
    return power


@dataclass(frozen=True)
class PowerRegions:
    """Bounds between low, medium and high total power: up to the one is low, from the other on high."""

    low_kw: float
    high_kw: float

    @classmethod
    def of_reference(cls, run: Trajectory) -> PowerRegions:
        """Take both bounds as percentiles of the power of the reference run."""
        low, high = np.percentile(battery_power_kw(run), [LOW_PERCENTILE, HIGH_PERCENTILE])
        return cls(float(low), float(high))

    def shares(self, run: Trajectory) -> tuple[float, float, float]:
        """Return the shares of time with low, medium and high power; they sum to one."""
        power, steps = battery_power_kw(run), run.intervals_s
        total = float(np.sum(steps))
        low = float(np.sum(steps[power <= self.low_kw])) / total
        high = float(np.sum(steps[power >= self.high_kw])) / total
        return low, 1.0 - low - high, high


def busiest_window(
    run: Trajectory, length_s: float, power_w: FloatArray | None = None
) -> tuple[int, int]:
    """Return the rows of start and end of the stretch of a trip, n rows, with the most energy drawn.

    Args:
        run: the trip.
        length_s: length of the stretch; at most the trip.
        power_w: the power that counts, shape (n,); None for traction. Negative values do not count.
    """
    power = run.traction_power_w if power_w is None else power_w
    drawn = np.maximum(power[1:], 0.0) * run.intervals_s
    energy = np.concatenate([[0.0], np.cumsum(drawn)])
    starts = np.arange(len(run))
    ends = np.searchsorted(run.time_s, run.time_s + length_s - 1e-9)
    inside = ends < len(run)
    if not np.any(inside):
        return 0, len(run) - 1
    gains = energy[ends[inside]] - energy[starts[inside]]
    start = int(np.argmax(gains))
    return start, int(ends[inside][start])


def share_while_braking(run: Trajectory) -> float | None:
    """Return the part of the compressor energy that is spent while traction feeds back; None without any."""
    energy = run.compressor_power_w[1:] * run.intervals_s
    whole = float(np.sum(energy))
    return float(np.sum(energy[run.traction_power_w[1:] < 0.0])) / whole if whole > 0.0 else None


def time_to_fall_s(times_s: FloatArray, values: FloatArray, share: float) -> float:
    """Return the time until a quantity has fallen by a share of the way to its lowest value."""
    target = values[0] - share * (values[0] - np.min(values))
    return float(times_s[int(np.argmax(values <= target))] - times_s[0])


def blocks_of(values: FloatArray, most: int) -> FloatArray:
    """Return a series, shape (n,), in about `most` blocks at most, shape (blocks, size)."""
    size = max(1, values.size // most)
    blocks: FloatArray = values[: values.size // size * size].reshape(-1, size)
    return blocks


def power_regions(results: Results, run: str, others: Sequence[str], reference: str) -> Finding:
    """Check that a run spends less time at high and more at low power than others.

    The distribution of power of ``reference`` defines low and high power.
    """
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


def lower_peaks(results: Results, run: str, others: Sequence[str], percentile: float) -> Finding:
    """Check that a high percentile of the battery power of a run lies below that of others."""
    peaks = {
        name: float(np.percentile(battery_power_kw(results[name].trajectory), percentile))
        for name in (run, *others)
    }
    return Finding(
        graded(all(peaks[run] < peaks[other] for other in others)),
        "; ".join(f"{name_of(name)} {peak:.2f} kW" for name, peak in peaks.items()),
    )


def traction_dominates(results: Results, run: str, factor: float) -> Finding:
    """Check that traction power is much larger than compressor and auxiliary power, in mean magnitude."""
    trip = results[run].trajectory
    traction = float(np.mean(np.abs(traction_power_kw(trip))))
    other = 1e-3 * float(np.mean(trip.compressor_power_w[1:] + trip.auxiliary_power_w[1:]))
    ratio = traction / other
    return Finding(
        graded(ratio >= factor, ratio > 1.0),
        f"{traction:.2f} kW traction, {other:.2f} kW compressor and auxiliaries, ratio {ratio:.1f}",
    )


def cools_off_peak(results: Results, run: str) -> Finding:
    """Check that the compressor runs less at high traction power than at low one and while braking."""
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


def settles_near(
    results: Results, run: str, printed_c: float, tolerance_k: float, last_share: float
) -> Finding:
    """Check that both cells stay near a printed temperature over the last share of a trip."""
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


def last_cell_falls_slower(results: Results, run: str, share: float) -> Finding:
    """Check that the last cell cools down by a share of its fall later than the first one."""
    trip = results[run].trajectory
    first = time_to_fall_s(trip.time_s, trip.cell_1_temperature_k, share)
    last = time_to_fall_s(trip.time_s, trip.cell_n_temperature_k, share)
    return Finding(graded(last > first), f"cell 1 {first:.0f} s, cell N {last:.0f} s")


def heats_in_demand(
    results: Results, runs: Sequence[str], length_s: float, least_rise_k: float
) -> Finding:
    """Check that the pack warms up during the stretch of highest traction demand."""
    rises, texts = [], []
    for run in runs:
        start_s, _, before_c, highest_c = _around_demand(results, run, length_s)
        rises.append(highest_c - before_c)
        texts.append(f"{name_of(run)}: {rises[-1]:+.2f} K from {start_s:.0f} s on")
    return Finding(graded(min(rises) >= least_rise_k, min(rises) > 0.0), "; ".join(texts))


def cooled_before_demand(
    results: Results, runs: Sequence[str], length_s: float, least_drop_k: float
) -> Finding:
    """Check that the pack is clearly cooler at the start of the stretch of highest demand than at first."""
    drops, texts = [], []
    for run in runs:
        start_s, initial_c, before_c, _ = _around_demand(results, run, length_s)
        drops.append(initial_c - before_c)
        texts.append(f"{name_of(run)}: {before_c:.2f} °C at {start_s:.0f} s")
    return Finding(graded(min(drops) >= least_drop_k, min(drops) > 0.0), "; ".join(texts))


def _around_demand(
    results: Results, run: str, length_s: float
) -> tuple[float, float, float, float]:
    """Return where the stretch of highest demand begins in s, and mean cell temperatures around it in °C.

    The latter are at first, where the stretch begins, and the highest in it.
    """
    trip = results[run].trajectory
    start, end = busiest_window(trip, length_s)
    mean = mean_cell_temperature_c(trip)
    found = (trip.time_s[start], mean[0], mean[start], np.max(mean[start : end + 1]))
    start_s, initial_c, before_c, highest_c = map(float, found)
    return start_s, initial_c, before_c, highest_c


def aging_falls(_: Results) -> Finding:
    """Check that degradation falls with lower current and with lower temperature, everywhere on the map."""
    found = aging_map(load_parameters().values)
    loss, temperatures = found.to_numpy(), found.index
    by_current = bool(np.all(np.diff(loss, axis=1) > 0.0))
    by_temperature = bool(np.all(np.diff(loss[:, 1:], axis=0) > 0.0))
    growth = np.log(loss[-1, -1] / loss[0, -1]) / (temperatures[-1] - temperatures[0])
    current, temperature = (
        "everywhere" if holds else "not everywhere" for holds in (by_current, by_temperature)
    )
    return Finding(
        graded(by_current and by_temperature, by_current or by_temperature),
        f"with current: {current}, with temperature: {temperature} "
        f"({100.0 * (np.exp(growth) - 1.0):.2f} % per kelvin at {found.columns[-1]:g} A)",
    )


def aging_exponential(_: Results, temperature_c: float, least_excess: float) -> Finding:
    """Check that degradation grows exponentially with current.

    ``least_excess`` is the part by which doubling the current must more than double the loss per hour.
    """
    parameters = load_parameters().values
    found, one_c_a = aging_map(parameters), parameters.cell.nominal_capacity_ah
    currents = found.columns.to_numpy()
    loss = np.array([np.interp(temperature_c, found.index, found[each]) for each in found])
    moving = currents > 0.0
    steps = np.diff(np.log(loss[moving] / currents[moving]))
    straight = bool(np.ptp(steps) <= 1e-6 * np.max(np.abs(steps)))
    one_c, two_c = np.interp([one_c_a, 2.0 * one_c_a], currents, loss)
    factor = float(two_c / one_c)
    per_c = float(np.exp(np.mean(steps) / np.diff(currents[moving])[0] * one_c_a))
    return Finding(
        graded(straight and factor >= 2.0 * (1.0 + least_excess), factor > 2.0),
        f"loss per ampere-hour times {per_c:.2f} per 1C; loss per hour from 1C to 2C times {factor:.2f}",
    )
