"""The method in C: bit by bit what the readable one in Python computes, without memory of its own."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from tests.iptm_controller.scenes import (
    PARAMETERS,
    SCENES,
    Problem,
    make_scene,
    plain_solver,
    problem_of,
)
from tests.reference.riccati_method import InterpretedRiccati
from tests.reference.switching_check import SwitchingCheckInPython

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import GlobalIndex, InputIndex
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.interface import SolveResult, SolverOptions
from iptm_controller.solvers.riccati.backend import RiccatiBackend
from iptm_controller.solvers.switching_check import SwitchingCheck
from iptm_core.decision_record import SolveStatus
from iptm_core.parameters import load_parameters

GRIDS = ("3x1+5x5", "7x1", "2x1+1x5+4x30t")


OTHER_CAR = {
    "body.drag_coefficient": 0.27,
    "cell.nominal_resistance_ohm": 0.0032,
    "gap.max_gap_m": 110.0,
    "limits.max_compressor_power_w": 2500.0,
    "pack.cells_per_channel": 11,
    "powertrain.wheel_radius_m": 0.33,
}


@lru_cache
def in_c(grid: str) -> RiccatiBackend:
    return RiccatiBackend(OptimalControlProblem(Horizon.parse(grid), PARAMETERS), SolverOptions())


@lru_cache
def in_python(grid: str) -> InterpretedRiccati:
    problem = OptimalControlProblem(Horizon.parse(grid), PARAMETERS)
    return InterpretedRiccati(problem, SolverOptions())


def problems(grid: str) -> Iterator[Problem]:
    """Yield ordinary problems, those with a far better guess, and some that are nearly hopeless."""
    random = np.random.default_rng(4)
    for strategy in ("aging", "energy_aging", "reference"):
        for scene in SCENES.values():
            data, guess = problem_of(scene, grid, strategy)
            yield data, guess
            yield data, plain_solver(grid).solve(data, guess).variables
            yield data, guess + random.normal(scale=0.5, size=guess.size)
    far_off = make_scene(
        gap_m=-20.0, speed_m_s=38.0, leader_speed_m_s=5.0, cell_n_temperature_k=320.0
    )
    yield problem_of(far_off, grid, "aging")


def assert_equal(one: SolveResult, other: SolveResult) -> None:
    assert (one.status, one.reason, one.iterations) == (
        other.status,
        other.reason,
        other.iterations,
    )
    for name in ("variables", "costates"):
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
    for name in ("objective", "infeasibility"):
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)


@pytest.mark.parametrize("grid", GRIDS)
def test_results_are_those_of_the_method_in_python(grid: str) -> None:
    statuses = set()
    for data, guess in problems(grid):
        one, other = in_c(grid).solve(data, guess), in_python(grid).solve(data, guess)
        assert_equal(one, other)
        statuses.add(one.status)
    assert SolveStatus.SOLVED in statuses


def test_bounds_on_the_iterations_stop_both_at_the_same_iterate() -> None:
    *_, far_off = problems("3x1+5x5")
    braking = problem_of(make_scene(leader_acceleration_m_s2=-0.5), "3x1+5x5", "energy_aging")
    statuses = set()
    for problem in (far_off, braking):
        for bound in (*range(70), 150):
            one = in_c("3x1+5x5").solve(*problem, most_iterations=bound)
            assert_equal(one, in_python("3x1+5x5").solve(*problem, most_iterations=bound))
            statuses.add(one.status)
    assert statuses == {SolveStatus.ITERATION_LIMIT, SolveStatus.FEASIBLE, SolveStatus.SOLVED}


def test_numbers_that_are_not_finite_end_both_alike() -> None:
    compiled, reference = in_c("7x1"), in_python("7x1")
    data, guess = problem_of(SCENES["cruise"], "7x1")
    for place in (0, 5, guess.size - 1):
        broken = guess.copy()
        broken[place] = np.nan
        assert_equal(compiled.solve(data, broken), reference.solve(data, broken))
    broken_data = ProblemData(data.initial_state, data.parameters.copy())
    broken_data.parameters[20] = np.inf
    one = compiled.solve(broken_data, guess)
    assert_equal(one, reference.solve(broken_data, guess))
    assert one.status is SolveStatus.NUMERICAL_ERROR


def test_a_deadline_ends_the_solve() -> None:
    problem = OptimalControlProblem(Horizon.parse("3x1+5x5"), PARAMETERS)
    solver = RiccatiBackend(problem, SolverOptions(deadline_s=1e-9))
    data, guess = problem_of(SCENES["cruise"], "3x1+5x5")
    result = solver.solve(data, guess)
    assert result.iterations == 0
    assert "time limit" in result.reason
    solver.options = SolverOptions(deadline_s=3600.0)
    assert solver.solve(data, guess).status is SolveStatus.SOLVED


def test_a_larger_bound_on_the_iterations_gets_more_memory() -> None:
    """The filter holds one entry per iteration at most."""
    problem = OptimalControlProblem(Horizon.parse("7x1"), PARAMETERS)
    solver = RiccatiBackend(problem, SolverOptions(max_iterations=2))
    *_, far_off = problems("7x1")
    assert solver.solve(*far_off).status is not SolveStatus.SOLVED
    solver.options = SolverOptions(max_iterations=400)
    assert_equal(solver.solve(*far_off), in_python("7x1").solve(*far_off))


@pytest.mark.parametrize("simulates", [False, True])
@pytest.mark.parametrize("grid", GRIDS)
def test_second_starts_are_those_of_the_check_in_python(grid: str, *, simulates: bool) -> None:
    problem = OptimalControlProblem(Horizon.parse(grid), PARAMETERS)
    inner = RiccatiBackend(problem, SolverOptions(simulate_cooling=simulates))
    compiled = SwitchingCheck(inner, problem, try_every=3)
    reference = SwitchingCheckInPython(in_python(grid), problem, compiled.numbers)
    random = np.random.default_rng(2)
    counts = set()
    for data, guess in problems(grid):
        given = replace(data, parameters=data.parameters.copy())
        given.parameters[GlobalIndex.CELL_N_PRICE] = random.uniform(0.0, 6.0)
        given.parameters[GlobalIndex.LOWEST_TEMPERATURE] += random.choice([0.0, 0.0, 4.0])
        powers = guess[: -layout.STATES].reshape(-1, layout.BLOCK)
        powers[:, layout.STATES + InputIndex.COMPRESSOR_POWER] = random.uniform(0.0, 1.5)
        assert_equal(compiled.solve(given, guess), reference.solve(given, guess))
        assert compiled.since_second == reference.since_second
        counts.add(compiled.since_second)
    assert {0, 1, 2} <= counts


def test_horizons_of_the_same_stages_share_their_code(
    cache: Path, compilations: list[list[str]]
) -> None:
    for grid in ("4x2", "9x2", "30x2"):
        problem = OptimalControlProblem(Horizon.parse(grid), PARAMETERS)
        RiccatiBackend(problem, SolverOptions())
    assert len(list(cache.glob("*.so"))) == 1
    assert sum("-shared" in command and "-c" not in command for command in compilations) == 1


def test_nothing_is_allocated(cache: Path) -> None:
    """Seen from the symbols that the library asks others for."""
    problem = OptimalControlProblem(Horizon.parse("2x3"), PARAMETERS)
    RiccatiBackend(problem, SolverOptions())
    (library,) = cache.glob("*.so")
    try:
        listed = subprocess.run(
            ["nm", "-D", "--undefined-only", library], capture_output=True, text=True, check=True
        ).stdout
    except FileNotFoundError:
        pytest.skip("no nm on this machine")
    names = {line.split()[-1].partition("@")[0] for line in listed.splitlines()}
    assert {"log", "exp"} <= names
    assert not names & {"malloc", "calloc", "realloc", "free", "printf", "exit", "abort"}


def test_other_cars_share_one_library_and_keep_their_numbers(
    cache: Path, compilations: list[list[str]]
) -> None:
    """Solved in turn; compared with the method in Python."""
    data, guess = problem_of(SCENES["cruise"], "2x3")
    of_a_tick = {*cache.glob("*.so")}
    compilations.clear()
    cars = [
        OptimalControlProblem(Horizon.parse("2x3"), load_parameters(overrides=changes).values)
        for changes in ({}, {"body.mass_kg": 1850.0}, OTHER_CAR)
    ]
    compiled = [RiccatiBackend(car, SolverOptions()) for car in cars]
    expected = [InterpretedRiccati(car, SolverOptions()).solve(data, guess) for car in cars]
    assert len({*cache.glob("*.so")} - of_a_tick) == 1
    assert sum("-c" not in command for command in compilations) == 1
    for _ in range(2):
        for solver, other in zip(compiled, expected, strict=True):
            assert_equal(solver.solve(data, guess), other)
    assert expected[0].objective != expected[2].objective
