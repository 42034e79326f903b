"""The leader's own prediction: a monotone cubic through the points that it sent."""

from __future__ import annotations

import numpy as np

from iptm_core.state import FloatArray
from iptm_v2x_bridge.prediction.predictor import (
    ErrorGrowth,
    Knowledge,
    Prediction,
    PredictorName,
)

GROWTH = ErrorGrowth((0.0, 60.0), (0.3, 0.5))
"""For forty points over a minute. A sender that does not do what it says is farther off, and says so in its
next message."""
MAX_SPEED_M_S = 70.0
MAX_DEVIATION_M = 1.0
"""A leader farther from where it said that it would be by now does something else."""
MIN_AHEAD_S = 0.05
BACKWARD_TOLERANCE_M = 0.5


class ReceivedPath:
    """Follows the path prediction of the leader's newest message."""

    def predict(self, known: Knowledge, times_s: FloatArray) -> Prediction | None:
        """Return the motion up to the last point of the path; None without a plausible one."""
        last, path = known.last, known.path
        if path is None:
            return None
        ahead = path.times_s > last.time_s + MIN_AHEAD_S
        said_m = float(np.interp(last.time_s, path.times_s, path.positions_m))
        if not ahead.any() or abs(said_m - last.position_m) > MAX_DEVIATION_M:
            return None
        nodes = np.concatenate([[last.time_s], path.times_s[ahead]])
        places = np.concatenate([[last.position_m], path.positions_m[ahead]])
        steps = np.diff(places)
        if steps.min() < -BACKWARD_TOLERANCE_M:
            return None
        if np.any(steps > MAX_SPEED_M_S * np.diff(nodes) + BACKWARD_TOLERANCE_M):
            return None
        times = times_s[times_s <= nodes[-1] + 1e-9]
        positions, speeds = monotone_cubic(
            nodes, np.maximum.accumulate(places), last.speed_m_s, times
        )
        return Prediction(
            PredictorName.RECEIVED_PATH,
            times,
            positions,
            speeds,
            GROWTH.at(times - last.time_s) + last.bound_m,
        )


def monotone_cubic(
    nodes: FloatArray, values: FloatArray, first_slope: float, at: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Interpolate values that never decrease by a cubic that never does either (Fritsch and Carlson, 1980).

    Args:
        nodes: abscissae, shape (n,), increasing, n >= 2.
        values: ordinates, shape (n,), never decreasing.
        first_slope: slope at the first node, reduced where it would overshoot.
        at: where to evaluate, shape (m,), inside the nodes.

    Returns:
        Values and slopes, shape (m,) each.
    """
    widths = np.diff(nodes)
    secants = np.diff(values) / widths
    slopes = np.empty_like(nodes)
    slopes[0], slopes[-1] = first_slope, secants[-1]
    # The weighted harmonic mean of the neighbours is zero where one of them is, and never overshoots.
    left, right = secants[:-1], secants[1:]
    weight_left, weight_right = 2.0 * widths[1:] + widths[:-1], widths[1:] + 2.0 * widths[:-1]
    flat = (left <= 0.0) | (right <= 0.0)
    safe_left, safe_right = np.where(flat, 1.0, left), np.where(flat, 1.0, right)
    means = (weight_left + weight_right) / (weight_left / safe_left + weight_right / safe_right)
    slopes[1:-1] = np.where(flat, 0.0, means)
    slopes[:-1] = np.minimum(slopes[:-1], 3.0 * secants)
    slopes[1:] = np.minimum(slopes[1:], 3.0 * secants)
    index = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, secants.size - 1)
    width, share = widths[index], (at - nodes[index]) / widths[index]
    secant, start, end = secants[index], slopes[index], slopes[index + 1]
    square, cube = 3.0 * secant - 2.0 * start - end, start + end - 2.0 * secant
    rise = share * (start + share * (square + share * cube))
    slope = start + share * (2.0 * square + 3.0 * share * cube)
    return values[index] + width * rise, np.maximum(slope, 0.0)
