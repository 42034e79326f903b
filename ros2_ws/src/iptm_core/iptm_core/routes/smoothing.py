"""Noise of a logged speed: how much there is, and the drive without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iptm_core.routes.cycles import DrivingCycle
from iptm_core.state import FloatArray

NOTED_NOISE_M_S = 0.14
"""Noise from which a drive has a note: above what is found in the published cycles, 0.02 to 0.12 m/s, and
below that of a logger with 0.6 km/h."""
_MEDIAN_OF_NORMAL = 0.6745
_MOVING_M_S = 1.0


def speed_noise_m_s(cycle: DrivingCycle) -> float:
    """Return the standard deviation of white noise in the speeds of a drive, in m/s; 0 for one that stands.

    From the median of the third differences while it moves: those of noise with standard deviation s have
    sqrt(20) s, and those of a driver are small.
    """
    speeds = cycle.speeds_m_s
    thirds = np.abs(np.diff(speeds, 3))
    moving = thirds[np.minimum(speeds[3:], speeds[:-3]) > _MOVING_M_S]
    return float(np.median(moving)) / _MEDIAN_OF_NORMAL / 20.0**0.5 if moving.size else 0.0


def smoothed(cycle: DrivingCycle, width_s: float) -> DrivingCycle:
    """Return a drive whose speeds are means over a window, with the same length and distance.

    Args:
        cycle: the drive.
        width_s: of the window; it is narrower near the ends of the drive and of each stop, which stay. Some
            seconds take out noise; a window of ten also takes out what the driver did.
    """
    speeds = cycle.speeds_m_s
    reach = int(0.5 * width_s)
    if reach < 1:
        return cycle
    stands = np.concatenate(([True], speeds == 0.0, [True]))
    rows = np.arange(speeds.size)
    edges = np.flatnonzero(stands) - 1
    before = rows - edges[np.searchsorted(edges, rows, side="right") - 1]
    after = edges[np.searchsorted(edges, rows, side="left")] - rows
    inside = np.minimum(rows, rows[::-1])
    reaches = np.minimum(np.minimum(reach, inside), np.minimum(before, after))
    sums = np.concatenate(([0.0], np.cumsum(speeds)))
    means: FloatArray = (sums[rows + reaches + 1] - sums[rows - reaches]) / (2 * reaches + 1)
    means = np.where(reaches == 0, speeds, means)
    plain = replace(cycle, speeds_m_s=means)
    share = cycle.distance_m / plain.distance_m if plain.distance_m > 0.0 else 1.0
    return replace(plain, speeds_m_s=share * means)
