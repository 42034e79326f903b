"""Failures of a solver are outcomes with a reason: nothing is raised, and nothing hangs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import (
    PARAMETERS,
    Problem,
    make_scene,
    plain_solver,
    problem_of,
    solver_with,
)

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.solvers.factory import build_plain_solver
from iptm_controller.solvers.interface import STATUS_TEXT, SolverBackend, SolverOptions
from iptm_core.decision_record import SolveStatus

GRID = "2x1+2x5"
KINDS = ["riccati", "ipopt"]


@pytest.fixture
def problem() -> Problem:
    return problem_of(make_scene(leader_acceleration_m_s2=-0.5), GRID, "energy_aging")


@pytest.fixture(params=KINDS)
def solver(request: pytest.FixtureRequest) -> SolverBackend:
    return plain_solver(GRID, request.param)


def test_solving_changes_neither_problem_nor_guess_nor_an_earlier_answer(
    solver: SolverBackend, problem: Problem
) -> None:
    data, guess = problem
    before = (data.initial_state.copy(), data.parameters.copy(), guess.copy())
    first = solver.solve(data, guess)
    kept = first.variables.copy()
    solver.solve(data, guess + 0.01)
    for old, new in zip(before, (data.initial_state, data.parameters, guess), strict=True):
        np.testing.assert_array_equal(old, new)
    np.testing.assert_array_equal(first.variables, kept)


@pytest.mark.parametrize("name", KINDS)
def test_iteration_limit_is_a_status(name: str) -> None:
    scene = make_scene(gap_m=10.0, speed_m_s=20.0, leader_speed_m_s=5.0)
    solver = solver_with(GRID, SolverOptions(max_iterations=1), name)
    result = solver.solve(*problem_of(scene, GRID))
    assert result.status is SolveStatus.ITERATION_LIMIT
    assert not result.status.usable
    assert name in result.reason
    assert result.infeasibility > 1e-4


def test_an_iterate_that_is_feasible_when_time_is_up_is_used(problem: Problem) -> None:
    """Started at the optimum with an iteration or two, the dynamics and limits still hold."""
    data, _ = problem
    best = plain_solver(GRID).solve(*problem)
    options = SolverOptions(max_iterations=2)
    short = build_plain_solver(Horizon.parse(GRID), PARAMETERS, options)
    result = short.solve(data, best.variables)
    assert result.status.usable
    assert result.objective == pytest.approx(best.objective, rel=0.2, abs=0.1)


def spoil(data: ProblemData, index: int, value: float) -> ProblemData:
    parameters = data.parameters.copy()
    parameters[index] = value
    return replace(data, parameters=parameters)


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("index", [0, layout.GLOBALS, layout.GLOBALS + layout.STEP_PARAMETERS, -1])
def test_data_that_are_not_finite_are_an_outcome(
    solver: SolverBackend, problem: Problem, index: int, value: float
) -> None:
    """Losses, leader, slope, reference."""
    data, guess = problem
    result = solver.solve(spoil(data, index, value), guess)
    assert result.status is SolveStatus.NUMERICAL_ERROR
    assert result.reason.startswith(STATUS_TEXT[SolveStatus.NUMERICAL_ERROR])
    assert result.variables.shape == guess.shape


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_state_and_guess_are_checked_as_well(
    solver: SolverBackend, problem: Problem, value: float
) -> None:
    data, guess = problem
    state = data.initial_state.copy()
    state[1] = value
    wrong = guess.copy()
    wrong[20] = value
    for result in (
        solver.solve(replace(data, initial_state=state), guess),
        solver.solve(data, wrong),
    ):
        assert result.status is SolveStatus.NUMERICAL_ERROR


def test_a_start_beyond_the_power_of_the_pack_ends_in_numbers(
    solver: SolverBackend, problem: Problem
) -> None:
    """The stage model bounds the power, so a wild iterate still has numbers to come back from."""
    data, guess = problem
    absurd = guess.copy()
    absurd[:-6].reshape(4, -1)[1:, 1] = 300.0
    result = solver.solve(data, absurd)
    assert np.isfinite(result.variables).all()


def test_recovers_at_once_from_a_broken_problem(solver: SolverBackend, problem: Problem) -> None:
    data, guess = problem
    expected = solver.solve(data, guess)
    solver.solve(spoil(data, 5, math.nan), guess)
    again = solver.solve(data, guess)
    assert again.status is SolveStatus.SOLVED
    np.testing.assert_array_equal(again.variables, expected.variables)


def test_a_deadline_shortens_the_iterations_and_is_reported() -> None:
    """A nanosecond is over before the first answer; from then on only the shortest bound is left."""
    options = SolverOptions(deadline_s=1e-9)
    solver = build_plain_solver(Horizon.parse(GRID), PARAMETERS, options)
    hard = problem_of(make_scene(gap_m=10.0, speed_m_s=20.0, leader_speed_m_s=5.0), GRID)
    solver.solve(*hard)
    result = solver.solve(*hard)
    assert result.iterations <= 11
    assert result.status is SolveStatus.DEADLINE
    assert result.reason.startswith("time limit reached")
