"""What checks, tables and plots read off a trajectory beyond its metrics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory

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


def thinned(run: Trajectory, values: FloatArray, most: int) -> tuple[FloatArray, FloatArray]:
    """Return times and means of blocks of a series, shape (n,), so that there are about `most` at most."""
    block = max(1, len(run) // most)
    whole = len(run) // block * block
    times: FloatArray = run.time_s[:whole].reshape(-1, block).mean(axis=1)
    means: FloatArray = np.asarray(values)[:whole].reshape(-1, block).mean(axis=1)
    return times, means
