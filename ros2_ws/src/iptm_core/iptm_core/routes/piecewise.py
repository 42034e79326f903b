"""Exact integration of piecewise linear functions: speed over time, slope over position."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from iptm_core.errors import RouteError
from iptm_core.state import FloatArray


def read_only_nodes(
    nodes: ArrayLike, values: ArrayLike, what: str
) -> tuple[FloatArray, FloatArray]:
    """Copy nodes and values into read-only float arrays and check them.

    Args:
        nodes: abscissae, shape (n,), strictly increasing, n >= 1.
        values: ordinates, shape (n,).

    Returns:
        The two arrays, shape (n,) each.

    Raises:
        RouteError: wrong shape, a value that is not finite, or nodes that do not increase.
    """
    x = np.array(nodes, dtype=np.float64)
    y = np.array(values, dtype=np.float64)
    if x.ndim != 1 or y.ndim != 1 or x.size != y.size or x.size == 0:
        raise RouteError(
            f"{what}: shapes {x.shape} and {y.shape}; two equally long, non-empty rows are needed"
        )
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(y))):
        bad = int(np.flatnonzero(~(np.isfinite(x) & np.isfinite(y)))[0])
        raise RouteError(
            f"{what}: node {bad} is ({x[bad]}, {y[bad]}); only finite values are allowed"
        )
    steps = np.diff(x)
    if np.any(steps <= 0.0):
        bad = int(np.flatnonzero(steps <= 0.0)[0]) + 1
        raise RouteError(
            f"{what}: node {bad} at {x[bad]} follows {x[bad - 1]}; nodes must strictly increase"
        )
    x.setflags(write=False)
    y.setflags(write=False)
    return x, y


def cumulative_integral(nodes: FloatArray, values: FloatArray) -> FloatArray:
    """Integrate a piecewise linear function from its first node to every node.

    Args:
        nodes: abscissae, shape (n,), increasing.
        values: ordinates at the nodes, shape (n,).

    Returns:
        Integrals, shape (n,), read-only; the first is 0.
    """
    result = np.zeros_like(nodes)
    np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(nodes), out=result[1:])
    result.setflags(write=False)
    return result


def integral_at(
    x: FloatArray, nodes: FloatArray, values: FloatArray, integrals: FloatArray
) -> FloatArray:
    """Evaluate the integral between nodes, where it is an exact parabola.

    Args:
        x: points inside [nodes[0], nodes[-1]], any shape.

    Returns:
        Integral from the first node to ``x``, shape of ``x``.
    """
    if nodes.size == 1:
        return np.zeros_like(x)
    left = nodes.searchsorted(x, side="right") - 1
    left = np.minimum(np.maximum(left, 0), nodes.size - 2)
    tau = x - nodes[left]
    rate = (values[left + 1] - values[left]) / (nodes[left + 1] - nodes[left])
    result: FloatArray = integrals[left] + tau * (values[left] + 0.5 * rate * tau)
    return result
