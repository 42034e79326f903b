"""Elementary operations on floats, NumPy arrays and CasADi expressions alike.

Each physical equation is written once on top of these, so that the plant evaluates and the optimal
control problem differentiates the very same function.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

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


def maximum(first: Scalar, second: Scalar, width: float = 0.0) -> Scalar:
    """Larger of two values; with ``width`` > 0 the hyperbolic approximation from above.

    The approximation exceeds the maximum by ``width / 2`` where both are equal, and by less than
    ``width**2 / (4 |first - second|)`` elsewhere.
    """
    if width > 0.0:
        difference = first - second
        return 0.5 * (first + second + sqrt(difference * difference + width * width))
    if is_symbolic(first, second):
        return ca.fmax(first, second)
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return np.maximum(first, second)
    return max(first, second)


def minimum(first: Scalar, second: Scalar, width: float = 0.0) -> Scalar:
    """Smaller of two values; with ``width`` > 0 the hyperbolic approximation from below."""
    return -maximum(-first, -second, width)


def excess(value: Scalar, width: float) -> Scalar:
    """Positive part of a value; its kink is a parabola within ``width`` of zero, and it is zero below."""
    within = minimum(maximum(value + width, 0.0), 2.0 * width)
    return within * within / (4.0 * width) + maximum(value - width, 0.0)


def absolute(value: Scalar, width: float = 0.0) -> Scalar:
    """Magnitude; with ``width`` > 0 the hyperbola ``sqrt(value^2 + width^2)``, at most ``width`` too high."""
    if width > 0.0:
        return sqrt(value * value + width * width)
    return _magnitude(value)
