"""Elementary operations on floats, NumPy arrays and CasADi expressions alike, and buffered CasADi functions.

Each physical equation is written once on top of these, so that the plant evaluates and the optimal control
problem differentiates the very same function.

The usual call of a CasADi function converts every argument to a CasADi matrix and back, checks names, and
collects statistics in a dictionary of all sub-functions: as long as half of a small solve.
`BufferedFunction` works on NumPy's own memory; `address` and `doubles` do so for code in C.
"""

from __future__ import annotations

import ctypes
import math
import struct
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from iptm_core.state import FloatArray

Scalar: TypeAlias = Any
"""A float, a NumPy array or a CasADi SX/MX/DM; operations between them broadcast as usual."""

_SYMBOLIC = (ca.SX, ca.MX, ca.DM)


def is_symbolic(*values: Scalar) -> bool:
    """True if any of the values is a CasADi expression."""
    return any(isinstance(value, _SYMBOLIC) for value in values)


def _elementary(symbolic: Any, array: Any, scalar: Any) -> Callable[[Scalar], Scalar]:
    def function(value: Scalar) -> Scalar:
        if isinstance(value, _SYMBOLIC):
            return symbolic(value)
        return array(value) if isinstance(value, np.ndarray) else scalar(value)

    return function


exp = _elementary(ca.exp, np.exp, math.exp)
sqrt = _elementary(ca.sqrt, np.sqrt, math.sqrt)
"""Square root; a negative float raises ValueError, arrays and symbols give NaN."""
sin = _elementary(ca.sin, np.sin, math.sin)
cos = _elementary(ca.cos, np.cos, math.cos)
asinh = _elementary(ca.asinh, np.arcsinh, math.asinh)
_magnitude = _elementary(ca.fabs, np.abs, abs)


def is_positive(width: Scalar) -> bool:
    """Return whether a width is positive; an expression is, but for a zero."""
    return not width.is_zero() if isinstance(width, _SYMBOLIC) else bool(width > 0.0)


def where(condition: Scalar, if_true: Scalar, if_false: Scalar) -> Scalar:
    """Element-wise choice; both branches are evaluated for arrays and symbols."""
    if is_symbolic(condition, if_true, if_false):
        return ca.if_else(condition, if_true, if_false)
    if isinstance(condition, np.ndarray):
        return np.where(condition, if_true, if_false)
    return if_true if condition else if_false


def both(first: Scalar, second: Scalar) -> Scalar:
    """Logical and of two conditions."""
    if is_symbolic(first, second):
        return ca.logic_and(first, second)
    return np.logical_and(first, second)


def maximum(first: Scalar, second: Scalar, width: Scalar = 0.0) -> Scalar:
    """Larger of two values; with ``width`` > 0 the hyperbolic approximation from above.

    The approximation exceeds the maximum by ``width / 2`` where both are equal, and by less than
    ``width**2 / (4 |first - second|)`` elsewhere.
    """
    if is_positive(width):
        difference = first - second
        return 0.5 * (first + second + sqrt(difference * difference + width * width))
    if is_symbolic(first, second):
        return ca.fmax(first, second)
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return np.maximum(first, second)
    return max(first, second)


def minimum(first: Scalar, second: Scalar, width: Scalar = 0.0) -> Scalar:
    """Smaller of two values; with ``width`` > 0 the hyperbolic approximation from below."""
    return -maximum(-first, -second, width)


def excess(value: Scalar, width: float) -> Scalar:
    """Positive part of a value; its kink is a parabola within ``width`` of zero, and it is zero below."""
    within = minimum(maximum(value + width, 0.0), 2.0 * width)
    return within * within / (4.0 * width) + maximum(value - width, 0.0)


def absolute(value: Scalar, width: Scalar = 0.0) -> Scalar:
    """Magnitude; with ``width`` > 0 the hyperbola ``sqrt(value^2 + width^2)``, at most ``width`` too high."""
    if is_positive(width):
        return sqrt(value * value + width * width)
    return _magnitude(value)


class BufferedFunction:
    """A function with arguments and results in place; one instance serves one thread.

    Attributes:
        arguments: by name; write the values of the next call into them. Zero at first.
        results: by name; overwritten by every call.
    """

    def __init__(
        self, function: ca.Function, memory: Mapping[str, FloatArray] | None = None
    ) -> None:
        """Allocate the buffers that are not given.

        Args:
            memory: arrays to use for arguments and results of these names, so that the results of one
                function can be the arguments of another without a copy.
        """
        given = memory or {}
        # CasADi's stubs describe the C++ signatures of the buffer, not the Python ones.
        self._buffer: Any
        self._buffer, self._run = function.buffer()
        self.arguments: dict[str, FloatArray] = {}
        self.results: dict[str, FloatArray] = {}
        for index in range(function.n_in()):
            name = function.name_in(index)
            self.arguments[name] = _array(given, name, function.nnz_in(index))
            self._buffer.set_arg(index, self.arguments[name].data)
        for index in range(function.n_out()):
            name = function.name_out(index)
            self.results[name] = _array(given, name, function.nnz_out(index))
            self._buffer.set_res(index, self.results[name].data)

    def __call__(self) -> None:
        """Evaluate; a `RuntimeError` means that CasADi broke off."""
        self._run()

    def stats(self) -> dict[str, Any]:
        """Return CasADi's statistics of the last call."""
        stats: dict[str, Any] = self._buffer.stats()
        return stats


def named_function(
    name: str, arguments: Mapping[str, Any], results: Mapping[str, Any], *, cse: bool = False
) -> ca.Function:
    """Return a function of symbols, by names given; with ``cse`` common subexpressions are computed once."""
    return ca.Function(
        name,
        list(arguments.values()),
        list(results.values()),
        list(arguments),
        list(results),
        {"cse": True} if cse else {},
    )


def _array(given: Mapping[str, FloatArray], name: str, size: int) -> FloatArray:
    array = given.get(name)
    if array is None:
        return np.zeros(size)
    if array.shape != (size,):
        raise ValueError(f"memory for '{name}' has shape {array.shape}, needed is ({size},)")
    return array


def address(array: FloatArray) -> int:
    """Return where the numbers of an array are: doubles, one after the other."""
    try:
        return ctypes.addressof(ctypes.c_double.from_buffer(array.data))
    except (TypeError, ValueError):  # read-only or empty
        return array.ctypes.data


def doubles(count: int) -> tuple[Any, Callable[..., None]]:
    """Return an array of C, and what writes all of its numbers at once: a structure takes thrice as long."""
    array = (ctypes.c_double * count)()
    return array, partial(struct.Struct(f"{count}d").pack_into, array, 0)
