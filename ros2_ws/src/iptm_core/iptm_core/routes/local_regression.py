"""Local regression: a smooth curve and its slope through noisy, unevenly spaced samples (Cleveland, 1979)."""

from __future__ import annotations

import numpy as np

from iptm_core.state import FloatArray

_MOST_WIDENINGS = 12


def local_line(
    nodes: FloatArray, values: FloatArray, at: FloatArray, half_width: float
) -> tuple[FloatArray, FloatArray]:
    """Fit a straight line around each point, weighted by the tricube of the distance.

    Args:
        nodes: abscissae of the samples, shape (n,), increasing, n >= 2.
        values: the samples, shape (n,).
        at: where to evaluate, shape (m,), increasing.
        half_width: samples farther away than this have no weight; doubled where fewer than three are nearer.

    Returns:
        Values and slopes of the lines, shape (m,) each.
    """
    smooth, slopes = np.empty_like(at), np.empty_like(at)
    for index, point in enumerate(at.tolist()):
        width = half_width
        for _ in range(_MOST_WIDENINGS):
            first, last = np.searchsorted(nodes, (point - width, point + width))
            if last - first >= 3 or last - first == nodes.size:
                break
            width *= 2.0
        distance = nodes[first:last] - point
        weight = (1.0 - np.minimum(np.abs(distance) / width, 1.0) ** 3) ** 3
        total = weight.sum()
        if last - first < 2 or total <= 0.0:
            smooth[index], slopes[index] = np.interp(point, nodes, values), 0.0
            continue
        mean = (weight * distance).sum() / total
        height = (weight * values[first:last]).sum() / total
        spread = (weight * (distance - mean) ** 2).sum()
        covered = (weight * (distance - mean) * (values[first:last] - height)).sum()
        slopes[index] = covered / spread if spread > 0.0 else 0.0
        smooth[index] = height - slopes[index] * mean
    return smooth, slopes
