"""Calls on NumPy's memory must give what the usual calls give."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from iptm_core.buffered import BufferedFunction


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
