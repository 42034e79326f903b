"""Noise of a logged speed: how much there is, and the drive without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iptm_core.routes.cycles import DrivingCycle

NOTED_NOISE_M_S = 0.14
"""Noise from which a drive has a note: above the published cycles, 0.02 to 0.12 m/s, and below a logger with
0.6 km/h."""
_MEDIAN_OF_NORMAL = 0.6745
_MOVING_M_S = 1.0


def speed_noise_m_s(cycle: DrivingCycle) -> float:
    """Return the standard deviation of white noise in the speeds of a drive, in m/s; 0 for one that stands.

    From the median of the third differences while it moves: noise with standard deviation s gives them
    sqrt(20) s, and a driver keeps them small.
    """
    speeds = cycle.speeds_m_s
    thirds = np.abs(np.diff(speeds, 3))
    moving = thirds[np.minimum(speeds[3:], speeds[:-3]) > _MOVING_M_S]
    return float(np.median(moving)) / _MEDIAN_OF_NORMAL / 20.0**0.5 if moving.size else 0.0


def smoothed(cycle: DrivingCycle, width_s: float) -> DrivingCycle:
    """Return a drive with the speeds of parabolas fitted around them, of the same length and distance.

    Args:
        cycle: the drive.
        width_s: of the window; it is narrower near the ends of the drive and of each stop, which stay. Below
            5 s there is nothing to fit. Windows of 5, 9 and 15 s leave 70, 50 and 39 % of white noise.
    """
    speeds = cycle.speeds_m_s
    reach = int(0.5 * width_s)
    if reach < 2:
        return cycle
    stands = np.concatenate(([True], speeds == 0.0, [True]))
    rows = np.arange(speeds.size)
    edges = np.flatnonzero(stands) - 1
    before = rows - edges[np.searchsorted(edges, rows, side="right") - 1]
    after = edges[np.searchsorted(edges, rows, side="left")] - rows
    inside = np.minimum(rows, rows[::-1])
    reaches = np.minimum(np.minimum(reach, inside), np.minimum(before, after))
    fitted = speeds.copy()
    for around in range(2, reach + 1):
        here = np.flatnonzero(reaches == around)
        offsets = np.arange(-around, around + 1)
        # Weights of the middle of a parabola fitted to equidistant values (Savitzky and Golay 1964).
        weights = 3.0 * (3 * around**2 + 3 * around - 1 - 5 * offsets**2)
        weights /= (2 * around - 1) * (2 * around + 1) * (2 * around + 3)
        fitted[here] = np.maximum(speeds[here[:, None] + offsets] @ weights, 0.0)
    plain = replace(cycle, speeds_m_s=fitted)
    share = cycle.distance_m / plain.distance_m if plain.distance_m > 0.0 else 1.0
    return replace(plain, speeds_m_s=share * fitted)
