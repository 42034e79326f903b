"""The factorisation behind the recursion: exact where it may be, positive where it must be."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from iptm_controller.solvers.riccati.recursion import (
    SMALLEST_PIVOT,
    cholesky_solve,
    modified_cholesky,
)
from iptm_core.state import FloatArray

SIZE = 5


def factor(
    matrix: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray, float, FloatArray]:
    symbol = ca.SX.sym("A", SIZE, SIZE)
    b = ca.SX.sym("b", *right.shape)
    lower, pivots, corrected = modified_cholesky(symbol)
    run = ca.Function(
        "run", [symbol, b], [lower, pivots, corrected, cholesky_solve(lower, pivots, b)]
    )
    results = run(matrix, right)
    return (results[0].full(), results[1].full().ravel(), float(results[2]), results[3].full())


def random_symmetric(seed: int) -> FloatArray:
    root = np.random.default_rng(seed).normal(size=(SIZE, SIZE))
    matrix: FloatArray = 0.5 * (root + root.T)
    return matrix


@pytest.mark.parametrize("seed", range(5))
def test_a_positive_matrix_is_factorised_as_it_is(seed: int) -> None:
    root = random_symmetric(seed)
    matrix = root @ root + 0.1 * np.eye(SIZE)
    right = np.random.default_rng(seed + 100).normal(size=(SIZE, 3))
    lower, pivots, corrected, solution = factor(matrix, right)
    assert corrected == 0.0
    np.testing.assert_allclose(lower @ np.diag(pivots) @ lower.T, matrix, atol=1e-10)
    np.testing.assert_array_equal(np.triu(lower, 1), 0.0)
    np.testing.assert_allclose(matrix @ solution, right, atol=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_an_indefinite_matrix_is_made_positive_and_said_so(seed: int) -> None:
    matrix = random_symmetric(seed) - 0.5 * np.eye(SIZE)
    assert np.linalg.eigvalsh(matrix).min() < 0.0
    right = np.ones((SIZE, 1))
    lower, pivots, corrected, solution = factor(matrix, right)
    assert corrected >= 1.0
    assert pivots.min() >= SMALLEST_PIVOT
    made = lower @ np.diag(pivots) @ lower.T
    assert np.linalg.eigvalsh(made).min() > 0.0
    np.testing.assert_allclose(made @ solution, right, rtol=1e-6, atol=1e-6)


def test_as_many_pivots_are_corrected_as_there_are_negative_ones() -> None:
    _, pivots, corrected, _ = factor(np.diag([1.0, -2.0, 3.0, -0.5, 0.0]), np.ones((SIZE, 1)))
    assert corrected == 3.0
    np.testing.assert_allclose(pivots, [1.0, 2.0, 3.0, 0.5, SMALLEST_PIVOT])
