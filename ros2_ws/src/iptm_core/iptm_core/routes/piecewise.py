"""Exact integration of piecewise linear functions: speed over time, slope over position."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from iptm_core.errors import RouteError
from iptm_core.state import FloatArray


def refuse_where(wrong: NDArray[np.bool_], message: Callable[[int], str]) -> None:
    """Raise a `RouteError` for the first index at which something is wrong."""
    if wrong.any():
        raise RouteError(message(int(np.argmax(wrong))))


def read_only_nodes(
    nodes: ArrayLike, values: ArrayLike, what: str
) -> tuple[FloatArray, FloatArray]:
    """Copy nodes and values, shape (n,) each, into read-only arrays.

    Other shapes, n = 0, values that are not finite and nodes that do not increase are refused.
    """
    x = np.array(nodes, dtype=np.float64)
    y = np.array(values, dtype=np.float64)
    if x.ndim != 1 or y.ndim != 1 or x.size != y.size or x.size == 0:
        raise RouteError(
            f"{what}: shapes {x.shape} and {y.shape}; two equally long, non-empty rows are needed"
        )
    refuse_where(
        ~(np.isfinite(x) & np.isfinite(y)),
        lambda k: f"{what}: node {k} is ({x[k]}, {y[k]}); only finite values are allowed",
    )
    refuse_where(
        np.diff(x) <= 0.0,
        lambda k: (
            f"{what}: node {k + 1} at {x[k + 1]} follows {x[k]}; nodes must strictly increase"
        ),
    )
    x.setflags(write=False)
    y.setflags(write=False)
    return x, y


def cumulative_integral(nodes: FloatArray, values: FloatArray) -> FloatArray:
    """Integrate a piecewise linear function from its first node to every node, shape (n,), read-only."""
    result = np.zeros_like(nodes)
    np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(nodes), out=result[1:])
    result.setflags(write=False)
    return result


def integral_at(
    x: FloatArray, nodes: FloatArray, values: FloatArray, integrals: FloatArray
) -> FloatArray:
    """Return the integral from the first node to points between the nodes, shape of ``x``."""
    if nodes.size == 1:
        return np.zeros_like(x)
    left = nodes.searchsorted(x, side="right") - 1
    left = np.minimum(np.maximum(left, 0), nodes.size - 2)
    tau = x - nodes[left]
    rate = (values[left + 1] - values[left]) / (nodes[left + 1] - nodes[left])
    result: FloatArray = integrals[left] + tau * (values[left] + 0.5 * rate * tau)
    return result
