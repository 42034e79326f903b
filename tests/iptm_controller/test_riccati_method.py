"""The iteration of the Riccati method: its factorisation, its filter, its starts and its end."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, Problem, make_scene, problem_of
from tests.reference.line_search import FilterPoint, LineSearchFilter, StepSummary

from iptm_controller.horizon import Horizon
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.interface import FEASIBILITY_TOLERANCE, SolveResult, SolverOptions
from iptm_controller.solvers.riccati.backend import RiccatiBackend
from iptm_controller.solvers.riccati.recursion import (
    SMALLEST_PIVOT,
    cholesky_solve,
    modified_cholesky,
)
from iptm_core.decision_record import SolveStatus
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
def test_an_indefinite_matrix_is_made_positive_and_counted(seed: int) -> None:
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


MU = 1e-3
UPHILL = 1.0


def point(cost: float, violation: float, log_sum: float = 0.0) -> FilterPoint:
    return FilterPoint(cost, log_sum, violation, violation)


def accepts(
    search: LineSearchFilter, trial: FilterPoint, current: FilterPoint, slope: float = UPHILL
) -> bool:
    return search.accepts(trial, current, MU, slope, 1.0)


@pytest.mark.parametrize(
    ("cost", "violation", "accepted"),
    [
        (10.0, 0.5, True),  # less violation, same cost
        (20.0, 0.5, True),  # less violation, more cost
        (9.0, 2.0, True),  # more violation, less cost
        (10.0, 1.0, False),  # nothing gained
        (11.0, 1.5, False),  # worse in both
        (10.0 - 1e-6, 1.0, False),  # less than the margin
        (9.0, 1e5, False),  # violation beyond all bounds
        (math.nan, 2.0, False),
        (9.0, math.nan, False),
        (-math.inf, math.inf, False),
    ],
)
def test_either_of_the_two_has_to_improve(cost: float, violation: float, accepted: bool) -> None:
    current = point(10.0, 1.0)
    assert accepts(LineSearchFilter(current), point(cost, violation), current) is accepted


def test_logarithms_count_with_the_barrier() -> None:
    current = point(10.0, 1.0, log_sum=0.0)
    # 0.01 more of cost, but 20 more of logarithms at a barrier of 1e-3: 0.01 less in all.
    assert accepts(LineSearchFilter(current), point(10.01, 1.0, log_sum=20.0), current)
    assert not accepts(LineSearchFilter(current), point(10.01, 1.0, log_sum=5.0), current)


def test_the_search_does_not_go_round_in_circles() -> None:
    """A point left for another one is not taken again, nor one that it dominates."""
    first, second = point(10.0, 1.0), point(12.0, 0.1)
    search = LineSearchFilter(first)
    assert accepts(search, second, first)
    assert not accepts(search, first, second)
    assert not accepts(search, point(10.5, 1.5), second)
    assert accepts(search, point(9.0, 0.9), second)


def test_near_feasibility_the_cost_has_to_descend() -> None:
    """With a small violation and a steep slope a smaller violation does not justify more cost."""
    current = point(10.0, 1e-6)
    search = LineSearchFilter(current)
    assert not accepts(search, point(10.1, 1e-9), current, slope=-1.0)
    assert accepts(search, point(9.9, 2e-6), current, slope=-1.0)
    # A decrease has to be a sufficient part of what the slope promises.
    assert not accepts(search, point(10.0 - 1e-6, 1e-6), current, slope=-1.0)


def test_a_descent_step_makes_no_entry() -> None:
    current, lower = point(10.0, 1e-6), point(9.0, 1e-6)
    search = LineSearchFilter(current)
    assert accepts(search, lower, current, slope=-1.0)
    # Had the start become an entry, this would be dominated by it.
    assert accepts(search, point(10.5, 5e-7), lower, slope=UPHILL)
    other = LineSearchFilter(current)
    assert accepts(other, lower, current, slope=UPHILL)
    assert not accepts(other, point(10.5, 2e-6), lower, slope=UPHILL)


GRID = "3x1+5x5"

SUMMARY = StepSummary(
    stationarity=2e-3,
    dynamics=1e-4,
    inequalities=3e-4,
    complementarity=5e-4,
    complementarity_sum=0.1,
    z_sum=200.0,
    lam_sum=100.0,
    corrected_pivots=0.0,
    cost_slope_affine=-1.0,
    cost_slope_centring=2.0,
    log_slope_affine=0.0,
    log_slope_centring=0.0,
    primal_step_affine=0.5,
    dual_step_affine=1.0,
    s_dz_affine=-0.05,
    z_ds_affine=-0.04,
    ds_dz_affine=0.01,
)


@pytest.fixture(scope="module")
def solve() -> Callable[..., SolveResult]:
    """Solve a problem with some options changed."""
    solver = RiccatiBackend(OptimalControlProblem(Horizon.parse(GRID), PARAMETERS), SolverOptions())

    def run(problem: Problem, **changes: Any) -> SolveResult:
        solver.options = SolverOptions(**changes)
        return solver.solve(*problem)

    return run


@pytest.fixture
def far_off() -> Problem:
    """Everything outside of its limits, and a guess that knows nothing of it."""
    scene = make_scene(
        gap_m=-20.0, speed_m_s=38.0, leader_speed_m_s=5.0, cell_n_temperature_k=320.0
    )
    return problem_of(scene, GRID, "aging")


def test_kkt_error_is_relative_to_large_multipliers() -> None:
    # Mean multiplier (200 + 100) / 3 = 100: still counted as it is.
    assert SUMMARY.kkt_error(2, 1) == pytest.approx(2e-3)
    large = SUMMARY._replace(z_sum=2900.0)
    # Mean 1000: ten times the scale of 100.
    assert large.kkt_error(2, 1) == pytest.approx(3e-4)


def test_barrier_parameter_follows_what_the_predictor_reaches() -> None:
    # s'z after the step: 0.1 + 0.5 (-0.04) + 1 (-0.05) + 0.5 * 0.01 = 0.035, of a mean of 0.05.
    expected = (0.035 / 0.1) ** 3 * 0.05
    assert SUMMARY.barrier_parameter(2, 1e-5, 0.0) == pytest.approx(expected)
    blocked = SUMMARY._replace(primal_step_affine=0.0, dual_step_affine=0.0)
    assert blocked.barrier_parameter(2, 1e-5, 0.0) == pytest.approx(0.05)
    done = SUMMARY._replace(
        complementarity_sum=1e-12, s_dz_affine=0.0, z_ds_affine=0.0, ds_dz_affine=0.0
    )
    assert done.barrier_parameter(2, 1e-5, 0.0) == pytest.approx(5e-7)


def test_the_safeguard_holds_the_barrier_parameter_up_but_never_raises_it() -> None:
    assert SUMMARY.barrier_parameter(2, 1e-5, 10.0) == pytest.approx(0.02)
    assert SUMMARY.barrier_parameter(2, 1e-5, 1e3) == pytest.approx(0.05)


def test_a_step_blown_up_by_corrected_pivots_is_not_used() -> None:
    assert SUMMARY.is_usable
    assert SUMMARY._replace(corrected_pivots=2.0).is_usable
    assert not SUMMARY._replace(corrected_pivots=2.0, primal_step_affine=1e-6).is_usable
    assert SUMMARY._replace(primal_step_affine=1e-6).is_usable
    assert not SUMMARY._replace(ds_dz_affine=np.nan).is_usable


def test_a_bad_guess_is_answered_by_the_cold_start(
    solve: Callable[..., SolveResult], far_off: Problem
) -> None:
    both = solve(far_off, warm_start_iterations=20)
    cold = solve(far_off, warm_start_iterations=0)
    assert both.status is cold.status is SolveStatus.SOLVED
    assert both.objective == pytest.approx(cold.objective, rel=1e-6)
    # The iterations of both starts count, and the first has twenty at most.
    assert cold.iterations <= both.iterations <= cold.iterations + 20


def test_iterations_are_bounded_over_both_starts(
    solve: Callable[..., SolveResult], far_off: Problem
) -> None:
    for bound in (1, 5, 25):
        result = solve(far_off, max_iterations=bound)
        assert result.iterations <= bound
        assert result.status is not SolveStatus.SOLVED


def test_stopped_early_the_best_usable_iterate_is_the_answer(
    solve: Callable[..., SolveResult],
) -> None:
    """More iterations never give a worse answer, and every usable one keeps dynamics and limits."""
    data, guess = problem_of(make_scene(leader_acceleration_m_s2=-0.5), GRID, "energy_aging")
    best = solve((data, guess))
    assert best.status is SolveStatus.SOLVED
    usable = []
    for bound in range(1, best.iterations):
        result = solve((data, guess), max_iterations=bound)
        assert result.status in {SolveStatus.FEASIBLE, SolveStatus.ITERATION_LIMIT}
        assert result.status.usable is (result.infeasibility <= FEASIBILITY_TOLERANCE)
        if result.status is SolveStatus.FEASIBLE:
            usable.append(result.objective)
    assert usable
    assert usable == sorted(usable, reverse=True)
    assert usable[-1] >= best.objective - 1e-3
