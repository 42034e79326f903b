"""How the iteration begins again, ends, and keeps the best of what it met."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from iptm_controller.controller import Measurements
from iptm_controller.horizon import Horizon
from iptm_controller.ocp.data import ProblemData
from iptm_controller.solvers.budget import FEASIBILITY_TOLERANCE, SolveBudget
from iptm_controller.solvers.factory import SolverOptions, build_plain_solver
from iptm_controller.solvers.interior_point import InteriorPointOptions
from iptm_controller.solvers.result import SolveResult
from iptm_controller.solvers.riccati.report import Report
from iptm_core.decision_record import SolveStatus
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray

Pose = Callable[..., tuple[ProblemData, FloatArray]]
GRID = "3x1+5x5"

REPORT = Report(
    stationarity=2e-3,
    defect=1e-4,
    gap=3e-4,
    largest_product=5e-4,
    product_sum=0.1,
    multiplier_sum=200.0,
    costate_sum=100.0,
    changed_pivots=0.0,
    slope_pull=-1.0,
    slope_centring=2.0,
    log_slope_pull=0.0,
    log_slope_centring=0.0,
    primal_reach=0.5,
    dual_reach=1.0,
    s_dz=-0.05,
    z_ds=-0.04,
    ds_dz=0.01,
)


@pytest.fixture(scope="module")
def solve(parameters: ModelParameters) -> Callable[..., SolveResult]:
    def run(
        problem: tuple[ProblemData, FloatArray],
        options: InteriorPointOptions,
        budget: SolveBudget,
    ) -> SolveResult:
        chosen = SolverOptions(interior_point=options, budget=budget)
        return build_plain_solver(Horizon.parse(GRID), parameters, chosen).solve(*problem)

    return run


@pytest.fixture
def far_off(
    problem_of: Pose, make_scene: Callable[..., Measurements]
) -> tuple[ProblemData, FloatArray]:
    """Everything outside of its limits, and a guess that knows nothing of it."""
    scene = make_scene(
        gap_m=-20.0, speed_m_s=38.0, leader_speed_m_s=5.0, cell_n_temperature_k=320.0
    )
    return problem_of(scene, GRID, "aging")


def test_error_is_relative_to_large_multipliers() -> None:
    # Mean multiplier (200 + 100) / 3 = 100: still counted as it is.
    assert REPORT.error(sides=2, costates=1) == pytest.approx(2e-3)
    large = REPORT._replace(multiplier_sum=2900.0)
    # Mean 1000: ten times the scale of 100.
    assert large.error(sides=2, costates=1) == pytest.approx(3e-4)


def test_barrier_follows_what_the_step_without_it_reaches() -> None:
    # Products after the step: 0.1 + 0.5 (-0.04) + 1 (-0.05) + 0.5 * 0.01 = 0.035, of a mean of 0.05.
    expected = (0.035 / 0.1) ** 3 * 0.05
    assert REPORT.barrier(sides=2, tolerance=1e-5, caution=0.0) == pytest.approx(expected)
    blocked = REPORT._replace(primal_reach=0.0, dual_reach=0.0)
    assert blocked.barrier(sides=2, tolerance=1e-5, caution=0.0) == pytest.approx(0.05)
    done = REPORT._replace(product_sum=1e-12, s_dz=0.0, z_ds=0.0, ds_dz=0.0)
    assert done.barrier(sides=2, tolerance=1e-5, caution=0.0) == pytest.approx(5e-7)


def test_caution_holds_the_barrier_up_but_never_raises_it() -> None:
    assert REPORT.barrier(sides=2, tolerance=1e-5, caution=10.0) == pytest.approx(0.02)
    assert REPORT.barrier(sides=2, tolerance=1e-5, caution=1e3) == pytest.approx(0.05)


def test_a_step_blown_up_by_changed_pivots_leads_nowhere() -> None:
    assert REPORT.leads_somewhere
    assert REPORT._replace(changed_pivots=2.0).leads_somewhere
    assert not REPORT._replace(changed_pivots=2.0, primal_reach=1e-6).leads_somewhere
    assert REPORT._replace(primal_reach=1e-6).leads_somewhere
    assert not REPORT._replace(ds_dz=np.nan).leads_somewhere


def test_a_bad_guess_is_answered_by_the_second_start(
    solve: Callable[..., SolveResult], far_off: tuple[ProblemData, FloatArray]
) -> None:
    patient = solve(far_off, InteriorPointOptions(patience=20), SolveBudget())
    wary = solve(far_off, InteriorPointOptions(patience=0), SolveBudget())
    assert patient.status is wary.status is SolveStatus.SOLVED
    assert patient.objective == pytest.approx(wary.objective, rel=1e-6)
    # The iterations of both starts count, and the first has twenty at most.
    assert wary.iterations <= patient.iterations <= wary.iterations + 20


def test_iterations_are_bounded_over_both_starts(
    solve: Callable[..., SolveResult], far_off: tuple[ProblemData, FloatArray]
) -> None:
    for bound in (1, 5, 25):
        result = solve(far_off, InteriorPointOptions(), SolveBudget(max_iterations=bound))
        assert result.iterations <= bound
        assert result.status is not SolveStatus.SOLVED


def test_stopped_early_the_best_usable_iterate_is_the_answer(
    solve: Callable[..., SolveResult],
    problem_of: Pose,
    make_scene: Callable[..., Measurements],
) -> None:
    """More iterations never give a worse answer, and every usable one keeps dynamics and limits."""
    data, guess = problem_of(make_scene(leader_acceleration_m_s2=-0.5), GRID, "energy_aging")
    best = solve((data, guess), InteriorPointOptions(), SolveBudget())
    assert best.status is SolveStatus.SOLVED
    usable = []
    for bound in range(1, best.iterations):
        result = solve((data, guess), InteriorPointOptions(), SolveBudget(max_iterations=bound))
        assert result.status in {SolveStatus.FEASIBLE, SolveStatus.ITERATION_LIMIT}
        assert result.status.usable is (result.infeasibility <= FEASIBILITY_TOLERANCE)
        if result.status is SolveStatus.FEASIBLE:
            usable.append(result.objective)
    assert usable
    assert usable == sorted(usable, reverse=True)
    assert usable[-1] >= best.objective - 1e-3


def test_time_that_is_over_is_noticed_within_an_iteration(
    solve: Callable[..., SolveResult], far_off: tuple[ProblemData, FloatArray]
) -> None:
    result = solve(far_off, InteriorPointOptions(), SolveBudget(deadline_s=1e-9))
    assert result.status is SolveStatus.DEADLINE
    assert result.iterations == 0
    assert "time limit" in result.reason


def test_a_deadline_that_is_kept_changes_nothing(
    solve: Callable[..., SolveResult], far_off: tuple[ProblemData, FloatArray]
) -> None:
    free = solve(far_off, InteriorPointOptions(), SolveBudget())
    bound = solve(far_off, InteriorPointOptions(), SolveBudget(deadline_s=60.0))
    np.testing.assert_array_equal(free.variables, bound.variables)
    assert replace(free, time_s=0.0).iterations == bound.iterations
