"""The judge of solutions must tell good from bad whatever solver they come from."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_controller.controller import Controller, ControllerOptions, Measurements
from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import InputIndex
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.factory import SolverOptions, build_plain_solver
from iptm_controller.solvers.interior_point import InteriorPointOptions
from iptm_controller.solvers.kkt import KktChecker
from iptm_controller.solvers.result import SolveResult
from iptm_core.parameters import load_parameters
from iptm_core.state import FloatArray, LeaderPreview, LeaderState, SlopePreview, VehicleState

HORIZON = Horizon.parse("2x1+2x5")
PARAMETERS = load_parameters().values


class _Catch:
    """Keeps the problem that the controller poses."""

    name = "catch"
    compiled = False

    def __init__(self) -> None:
        self.inner = build_plain_solver(HORIZON, PARAMETERS, SolverOptions(compile_code=False))
        self.posed: tuple[ProblemData, FloatArray] | None = None

    def solve(self, data: ProblemData, guess: FloatArray) -> SolveResult:
        self.posed = (data, guess)
        return self.inner.solve(data, guess)


@pytest.fixture(scope="module")
def problem() -> tuple[ProblemData, FloatArray]:
    catch = _Catch()
    controller = Controller(PARAMETERS, ControllerOptions(horizon=HORIZON), catch)
    state = VehicleState(100.0, 1000.0, 20.0, 0.2, 500.0, 305.0, 306.0, 1e-6, 1e-6)
    leader = LeaderState(100.0, 1060.0, 19.0)
    times = np.arange(0.0, 60.0) + 100.0
    preview = LeaderPreview(100.0, times, 1060.0 + 19.0 * (times - 100.0), np.full(60, 19.0))
    road = SlopePreview(np.array([0.0, 5000.0]), np.array([0.0, 0.02]))
    controller.decide(Measurements(state, leader, preview, road))
    assert catch.posed is not None
    return catch.posed


@pytest.fixture(scope="module")
def checker() -> KktChecker:
    return KktChecker(OptimalControlProblem(HORIZON, PARAMETERS))


def solution(name: str, tolerance: float, problem: tuple[ProblemData, FloatArray]) -> FloatArray:
    options = SolverOptions(
        name=name,
        compile_code=False,
        interior_point=InteriorPointOptions(tolerance=tolerance),
    )
    return build_plain_solver(HORIZON, PARAMETERS, options).solve(*problem).variables


@pytest.mark.parametrize("name", ["riccati", "fatrop", "ipopt", "sqp_piqp"])
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
    # IPOPT widens bounds by 1e-8, which a multiplier of some hundreds makes visible.
    assert fine.worst < 1e-5 < rough.worst


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
