"""How the iteration begins again, ends, and keeps the best of what it met."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, Problem, make_scene, problem_of

from iptm_controller.horizon import Horizon
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.interface import FEASIBILITY_TOLERANCE, SolveResult, SolverOptions
from iptm_controller.solvers.riccati.backend import RiccatiBackend
from iptm_controller.solvers.riccati.step_summary import StepSummary
from iptm_core.decision_record import SolveStatus

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
