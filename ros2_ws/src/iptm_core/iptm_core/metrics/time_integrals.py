"""Integrals and means over the time of a run."""

from __future__ import annotations

import numpy as np

from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory


def integral_of_interval_means(trajectory: Trajectory, means: FloatArray) -> float:
    """Integrate a quantity recorded as its mean over the interval that ended at each row.

    Args:
        trajectory: the run, n rows.
        means: shape (n,); row 0 ends no interval and does not count.

    Returns:
        Integral over the run, in the unit of ``means`` times seconds.
    """
    return float(np.dot(means[1:], trajectory.intervals_s))


def mean_of_states(trajectory: Trajectory, states: FloatArray) -> float:
    """Average a quantity recorded at the instants, taking it as linear between them.

    Args:
        trajectory: the run, n rows.
        states: shape (n,).

    Returns:
        Mean over time; the single value of a run with one row.
    """
    if len(trajectory) == 1:
        return float(states[0])
    duration = trajectory.time_s[-1] - trajectory.time_s[0]
    return float(np.dot(0.5 * (states[1:] + states[:-1]), trajectory.intervals_s) / duration)
