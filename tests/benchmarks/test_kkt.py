"""The judge of solutions separates good from bad ones of any solver."""

from __future__ import annotations

import pytest
from benchmarks.contenders import OTHER_SOLVER_NAMES, build_other_solver
from benchmarks.kkt import KktChecker
from benchmarks.record_problems import record_problems

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import InputIndex
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.factory import build_plain_solver
from iptm_controller.solvers.interface import SolverOptions
from iptm_core.parameters import load_parameters
from iptm_core.state import FloatArray

HORIZON = Horizon.parse("2x1+2x5")
PARAMETERS = load_parameters().values
PROBLEM = OptimalControlProblem(HORIZON, PARAMETERS)


@pytest.fixture(scope="module")
def problem() -> tuple[ProblemData, FloatArray]:
    return record_problems("us06", "aging", "2x1+2x5", first_tick=60, count=3).problem(2)


@pytest.fixture(scope="module")
def checker() -> KktChecker:
    return KktChecker(PROBLEM)


def solution(name: str, tolerance: float, problem: tuple[ProblemData, FloatArray]) -> FloatArray:
    options = SolverOptions(name=name, compile_code=False, tolerance=tolerance)
    if name in OTHER_SOLVER_NAMES:
        return build_other_solver(PROBLEM, options).solve(*problem).variables
    return build_plain_solver(HORIZON, PARAMETERS, options).solve(*problem).variables


@pytest.mark.parametrize("name", ["riccati", "ipopt", "fatrop", "sqp_piqp"])
def test_solutions_of_every_kind_of_solver_pass(
    name: str, problem: tuple[ProblemData, FloatArray], checker: KktChecker
) -> None:
    data, guess = problem
    if name.startswith("sqp"):
        guess = solution("ipopt", 1e-2, problem)  # SQP needs a start nearer than a cold one
    residual = checker.residual(data, solution(name, 1e-6, (data, guess)))
    assert residual.worst < 2e-4, residual


def test_a_tighter_solution_has_a_smaller_residual(
    problem: tuple[ProblemData, FloatArray], checker: KktChecker
) -> None:
    rough = checker.residual(problem[0], solution("ipopt", 1e-3, problem))
    fine = checker.residual(problem[0], solution("ipopt", 1e-8, problem))
    # IPOPT widens bounds by 1e-8, which the multipliers of the soft limits make visible.
    assert fine.worst < 1e-4
    assert fine.stationarity < 0.2 * rough.stationarity


def test_the_guess_is_not_optimal(
    problem: tuple[ProblemData, FloatArray], checker: KktChecker
) -> None:
    assert checker.residual(*problem).worst > 1e-2


def test_a_needless_slack_is_feasible_but_not_optimal(
    problem: tuple[ProblemData, FloatArray], checker: KktChecker
) -> None:
    changed = solution("ipopt", 1e-8, problem).copy()
    changed[layout.STATES + InputIndex.TEMPERATURE_EXCESS] += 0.1
    residual = checker.residual(problem[0], changed)
    assert residual.feasibility < 1e-6
    assert residual.optimality > 0.1


def test_broken_dynamics_and_another_start_are_infeasible(
    problem: tuple[ProblemData, FloatArray], checker: KktChecker
) -> None:
    good = solution("ipopt", 1e-8, problem)
    jumped, elsewhere = good.copy(), good.copy()
    jumped[layout.STATES + layout.INPUTS] += 0.01
    elsewhere[1] += 0.02
    assert checker.residual(problem[0], jumped).feasibility == pytest.approx(0.01, rel=0.1)
    assert checker.residual(problem[0], elsewhere).feasibility == pytest.approx(0.02, rel=0.1)
