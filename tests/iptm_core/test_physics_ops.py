"""Elementary operations are the same on every kind of number; functions in memory of their own."""

from __future__ import annotations

import math
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.physics import ops
from iptm_core.physics.ops import BufferedFunction

Agree = Callable[..., None]
POINTS = np.linspace(-7.0, 9.0, 33)
REALS = st.floats(-1e6, 1e6)
WIDTHS = st.floats(1e-3, 1e3)


@pytest.mark.parametrize(
    "function",
    [
        lambda x: ops.exp(0.3 * x),
        lambda x: ops.sqrt(x * x + 1.0),
        ops.sin,
        ops.cos,
        ops.absolute,
        lambda x: ops.absolute(x, 0.5),
        lambda x: ops.maximum(x, 2.0 - x),
        lambda x: ops.maximum(2.0 - x, x, 0.5),
        lambda x: ops.where(x > 1.0, x * x, -x),
        lambda x: ops.where(ops.both(x > 0.0, x < 3.0), 1.0 + x, 0.0 * x),
    ],
)
def test_every_operation_on_every_kind_of_number(
    agree_in_all_backends: Agree, function: Callable[..., float]
) -> None:
    agree_in_all_backends(function, POINTS)


def test_exact_values() -> None:
    assert ops.exp(0.0) == 1.0
    assert ops.sqrt(9.0) == 3.0
    assert ops.sin(math.pi / 6.0) == pytest.approx(0.5, rel=1e-15)
    assert ops.cos(math.pi / 3.0) == pytest.approx(0.5, rel=1e-15)
    assert ops.maximum(2.0, -3.0) == 2.0
    assert ops.absolute(-3.0) == 3.0
    assert ops.absolute(3.0, 4.0) == 5.0
    assert ops.where(condition=True, if_true=1.0, if_false=2.0) == 1.0


def test_what_counts_as_symbolic() -> None:
    assert ops.is_symbolic(1.0, ca.SX.sym("x"))
    assert ops.is_symbolic(ca.MX.sym("x"))
    assert ops.is_symbolic(ca.DM(1.0))
    assert not ops.is_symbolic(1.0, np.zeros(2), 3)


def test_the_square_root_of_a_negative_number() -> None:
    with pytest.raises(ValueError, match=r"math domain error|expected a nonnegative input"):
        ops.sqrt(-1.0)
    with np.errstate(invalid="ignore"):
        assert np.isnan(ops.sqrt(np.array([-1.0]))).all()
    assert math.isnan(float(ops.sqrt(ca.DM(-1.0))))


@given(first=REALS, second=REALS, width=WIDTHS)
def test_the_smooth_maximum_lies_above_by_at_most_half_its_width(
    first: float, second: float, width: float
) -> None:
    exact, smooth = ops.maximum(first, second), ops.maximum(first, second, width)
    round_off = 4e-16 * (abs(first) + abs(second) + width)
    assert -round_off <= smooth - exact <= 0.5 * width + round_off
    if first != second:
        assert smooth - exact <= width * width / (4.0 * abs(first - second)) + round_off


@given(value=REALS, width=WIDTHS)
def test_the_smooth_magnitude_lies_above_by_at_most_its_width(value: float, width: float) -> None:
    error = ops.absolute(value, width) - abs(value)
    assert -4e-16 * abs(value) <= error <= width + 4e-16 * abs(value)


def test_results_are_those_of_the_usual_call_every_time() -> None:
    x, p = ca.MX.sym("x", 3), ca.MX.sym("p", 2)
    function = ca.Function("f", [x, p], [ca.sumsqr(x) * p[0], x + p[1]], ["x", "p"], ["a", "b"])
    buffered = BufferedFunction(function)
    for seed in range(3):
        values = np.random.default_rng(seed)
        buffered.arguments["x"][:] = values.normal(size=3)
        buffered.arguments["p"][:] = values.normal(size=2)
        buffered()
        expected = function(buffered.arguments["x"], buffered.arguments["p"])
        assert buffered.results["a"] == pytest.approx(float(expected[0]), abs=0.0)
        np.testing.assert_array_equal(buffered.results["b"], expected[1].full().ravel())


def test_two_instances_of_one_function_do_not_share_memory() -> None:
    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [2.0 * x], ["x"], ["y"])
    first, second = BufferedFunction(function), BufferedFunction(function)
    first.arguments["x"][:] = 1.0
    second.arguments["x"][:] = 5.0
    first()
    second()
    assert (first.results["y"][0], second.results["y"][0]) == (2.0, 10.0)
