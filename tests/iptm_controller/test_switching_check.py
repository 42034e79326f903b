"""The second start where switching the compressor improves a plan: when it is tried, and what it gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import (
    PARAMETERS,
    SCENES,
    check_in_python,
    checking_solver,
    plain_solver,
    problem_of,
)

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import GlobalIndex, InputIndex, StateIndex
from iptm_controller.solvers.factory import build_solver
from iptm_controller.solvers.interface import SolveResult, SolverOptions
from iptm_controller.solvers.switching_check import TRY_EVERY
from iptm_core.decision_record import SolveStatus
from iptm_core.state import FloatArray

GRID = "3x1+5x5"
BLOCK = layout.BLOCK


def powers_w(variables: FloatArray) -> FloatArray:
    table = variables[: -layout.STATES].reshape(-1, BLOCK)
    return 1000.0 * table[:, layout.STATES + InputIndex.COMPRESSOR_POWER]


class Counting:
    """Passes problems on, keeps the guesses, and may spoil some of the answers."""

    name = "counting"

    def __init__(self, *spoil: SolveStatus | None) -> None:
        self.guesses: list[FloatArray] = []
        self.answers: list[SolveResult] = []
        self._spoil = spoil

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        del most_iterations
        self.guesses.append(guess.copy())
        answer = plain_solver(GRID).solve(data, guess)
        count = len(self.answers)
        if count < len(self._spoil) and (status := self._spoil[count]) is not None:
            answer = replace(answer, status=status)
        self.answers.append(answer)
        return answer


def with_price(data: ProblemData, price_1_k: float) -> ProblemData:
    """Return the problem with another price of a kelvin of cell N, and a quarter of it of cell 1."""
    parameters = data.parameters.copy()
    parameters[GlobalIndex.CELL_N_PRICE] = price_1_k
    parameters[GlobalIndex.CELL_1_PRICE] = 0.25 * price_1_k
    return replace(data, parameters=parameters)


def test_a_plan_without_a_better_minimum_is_kept_and_rarely_checked() -> None:
    """Nothing speaks for cooling: aging alone on a short horizon, the compressor off."""
    inner = Counting()
    data, guess = problem_of(SCENES["cruise"], GRID, "aging")
    checking = check_in_python(inner, GRID)
    for _ in range(3 * TRY_EVERY):
        result = checking.solve(data, guess)
        assert result.objective == inner.answers[0].objective
        assert powers_w(result.variables).max() < 300.0
    assert len(inner.guesses) <= 3 * TRY_EVERY + 3


def test_starts_the_compressor_where_that_pays() -> None:
    """From "off" the gradient of the gated map vanishes: the solver alone stays there."""
    data, guess = problem_of(SCENES["cruise"], GRID, "reference")
    alone = plain_solver(GRID).solve(data, guess)
    checked = checking_solver(GRID).solve(data, guess)
    assert alone.status is checked.status is SolveStatus.SOLVED
    assert powers_w(alone.variables).max() < 300.0
    assert powers_w(checked.variables).max() > 1000.0
    assert checked.objective < alone.objective - 10.0
    assert checked.iterations > alone.iterations


def test_stops_the_compressor_where_that_pays() -> None:
    """The guess cools a standing car at a price that does not pay; the solver alone goes on cooling."""
    data, guess = problem_of(SCENES["standstill"], GRID, "aging")
    data = with_price(data, 4.0)
    table = guess[: -layout.STATES].reshape(-1, BLOCK)
    table[:, layout.STATES + InputIndex.COMPRESSOR_POWER] = 0.9
    inner = Counting()
    result = check_in_python(inner, GRID).solve(data, guess)
    assert powers_w(inner.answers[0].variables)[-1] > 500.0
    assert powers_w(result.variables).max() < 1.0
    assert result.objective < inner.answers[0].objective - 0.1


@pytest.mark.parametrize(
    ("scene", "price_1_k", "gain"), [("cruise", 4.0, 0.2), ("hills", 6.0, 0.1)]
)
def test_simulated_plans_find_cooling_that_the_hamiltonian_does_not_see(
    scene: str, price_1_k: float, gain: float
) -> None:
    """Cooling pays only at the end of the horizon, in several steps at once."""
    data, guess = problem_of(SCENES[scene], GRID, "aging")
    data = with_price(data, price_1_k)
    plans = []
    for simulates in (False, True):
        options = SolverOptions(simulate_cooling=simulates)
        solver = build_solver(Horizon.parse(GRID), PARAMETERS, options)
        solver.since_second = 0
        plans.append(solver.solve(data, guess))
    without, simulated = plans
    assert simulated.objective < without.objective - gain
    powers = powers_w(simulated.variables)
    assert powers[:5].max() < 10.0
    assert powers[6:].min() > 700.0


def test_the_second_start_keeps_the_ramp() -> None:
    inner = Counting()
    data, guess = problem_of(SCENES["cruise"], GRID, "reference")
    check_in_python(inner, GRID).solve(data, guess)
    assert len(inner.guesses) == 2
    second = powers_w(inner.guesses[1])
    ramp = PARAMETERS.limits.max_compressor_rate_w_s
    assert second.max() > 500.0
    changes = np.abs(np.diff(second, prepend=0.0))
    assert (changes <= ramp * np.array([1.0, 1.0, 1.0, 1.75, 5.0, 5.0, 5.0, 5.0]) + 1e-9).all()
    table = inner.guesses[1].copy()
    held = np.append(
        table[: -layout.STATES].reshape(-1, BLOCK)[1:, StateIndex.LAST_COMPRESSOR_POWER],
        table[-layout.STATES + StateIndex.LAST_COMPRESSOR_POWER],
    )
    np.testing.assert_allclose(1000.0 * held, second)


@pytest.mark.parametrize(
    ("spoiled", "expected"),
    [
        # A first solve without a usable plan is tried again with the compressor running.
        ((SolveStatus.ITERATION_LIMIT, None), 1),
        # A second one that fails changes nothing.
        ((None, SolveStatus.NUMERICAL_ERROR), 0),
        ((None, SolveStatus.FEASIBLE), 1),
        ((SolveStatus.ITERATION_LIMIT, SolveStatus.NUMERICAL_ERROR), 0),
    ],
)
def test_the_better_usable_plan_wins(
    spoiled: tuple[SolveStatus | None, ...], expected: int
) -> None:
    inner = Counting(*spoiled)
    data, guess = problem_of(SCENES["cruise"], GRID, "reference")
    result = check_in_python(inner, GRID).solve(data, guess)
    assert len(inner.answers) == 2
    assert result.status is inner.answers[expected].status
    np.testing.assert_array_equal(result.variables, inner.answers[expected].variables)
    assert result.iterations == sum(answer.iterations for answer in inner.answers)
