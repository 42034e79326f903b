"""The second start with the compressor on: when it is tried, and what it is worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import (
    PARAMETERS,
    SCENES,
    plain_solver,
    probing_solver,
    problem_of,
)

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.solvers.cooling_probe import OFF_BELOW_W, PROBE_EVERY, CoolingProbe
from iptm_controller.solvers.interface import SolveResult
from iptm_core.decision_record import SolveStatus
from iptm_core.state import FloatArray

GRID = Horizon.parse("3x1+2x5")
BLOCK = layout.STATES + layout.INPUTS
DATA = ProblemData(np.zeros(layout.STATES), np.zeros(1))
GUESS = np.zeros(BLOCK * GRID.steps + layout.STATES)


def answer(
    status: SolveStatus = SolveStatus.SOLVED,
    power_w: float = 0.0,
    temperature_slack_k: float = 0.0,
    objective: float = 1.0,
) -> SolveResult:
    variables = GUESS.copy()
    table = variables[: -layout.STATES].reshape(GRID.steps, BLOCK)[:, layout.STATES :]
    table[:, InputIndex.COMPRESSOR_POWER] = power_w / 1000.0
    table[1, InputIndex.TEMPERATURE_EXCESS] = temperature_slack_k
    return SolveResult(status, status.name, variables, objective, 7, 0.5, 0.0)


class Scripted:
    """Gives prepared answers and keeps the guesses."""

    name = "scripted"
    compiled = False

    def __init__(self, *answers: SolveResult) -> None:
        self.answers = list(answers)
        self.guesses: list[FloatArray] = []

    def solve(self, data: ProblemData, guess: FloatArray) -> SolveResult:
        del data
        self.guesses.append(guess)
        return self.answers[min(len(self.guesses), len(self.answers)) - 1]


def probe(inner: Scripted) -> CoolingProbe:
    return CoolingProbe(inner, GRID, PARAMETERS)


def powers_of(guess: FloatArray) -> FloatArray:
    table = guess[: -layout.STATES].reshape(GRID.steps, BLOCK)
    return 1000.0 * table[:, layout.STATES + InputIndex.COMPRESSOR_POWER]


def test_a_plan_that_cools_is_left_alone() -> None:
    inner = Scripted(answer(power_w=OFF_BELOW_W + 1.0, temperature_slack_k=1.0))
    probing = probe(inner)
    for _ in range(3 * PROBE_EVERY):
        assert probing.solve(DATA, GUESS) is inner.answers[0]
    assert len(inner.guesses) == 3 * PROBE_EVERY
    assert (probing.name, probing.compiled) == ("scripted", False)


def test_an_off_plan_is_probed_every_few_ticks() -> None:
    inner = Scripted(answer(power_w=0.0))
    probing = probe(inner)
    solves = []
    for _ in range(3 * PROBE_EVERY):
        before = len(inner.guesses)
        probing.solve(DATA, GUESS)
        solves.append(len(inner.guesses) - before)
    assert solves == ([2] + [1] * (PROBE_EVERY - 1)) * 3


def test_a_broken_temperature_limit_is_probed_at_once() -> None:
    inner = Scripted(
        answer(temperature_slack_k=0.5, objective=50.0), answer(power_w=900.0, objective=10.0)
    )
    result = probe(inner).solve(DATA, GUESS)
    assert result.objective == 10.0
    # Both solves count.
    assert result.iterations == 14
    assert result.time_s == 1.0


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (answer(temperature_slack_k=1.0), answer(power_w=900.0, objective=0.5), 0.5),
        (answer(temperature_slack_k=1.0), answer(power_w=900.0, objective=1.5), 1.0),
        # Equally good up to the tolerance of the solver: no switching back and forth.
        (answer(temperature_slack_k=1.0), answer(power_w=900.0, objective=1.0 - 1e-5), 1.0),
        (
            answer(temperature_slack_k=1.0),
            answer(SolveStatus.NUMERICAL_ERROR, power_w=900.0, objective=0.0),
            1.0,
        ),
        (answer(SolveStatus.ITERATION_LIMIT), answer(power_w=900.0, objective=9.0), 9.0),
        (
            answer(SolveStatus.ITERATION_LIMIT),
            answer(SolveStatus.NUMERICAL_ERROR, objective=0.0),
            1.0,
        ),
        (answer(temperature_slack_k=1.0), answer(SolveStatus.FEASIBLE, objective=0.1), 0.1),
    ],
)
def test_the_better_usable_plan_wins(
    first: SolveResult, second: SolveResult, expected: float
) -> None:
    assert probe(Scripted(first, second)).solve(DATA, GUESS).objective == expected


def test_second_start_ramps_the_compressor_within_its_rate() -> None:
    inner = Scripted(answer(temperature_slack_k=1.0))
    probe(inner).solve(DATA, GUESS)
    second = inner.guesses[1]
    assert powers_of(second).tolist() == [200.0, 400.0, 600.0, 900.0, 900.0]
    table = second[: -layout.STATES].reshape(GRID.steps, BLOCK)
    held = np.append(
        table[1:, StateIndex.LAST_COMPRESSOR_POWER],
        second[-layout.STATES + StateIndex.LAST_COMPRESSOR_POWER],
    )
    np.testing.assert_allclose(1000.0 * held, powers_of(second))


def test_second_start_never_asks_for_less_than_there_is() -> None:
    inner = Scripted(answer(temperature_slack_k=1.0))
    state = np.zeros(layout.STATES)
    state[StateIndex.LAST_COMPRESSOR_POWER] = 2.0
    probe(inner).solve(replace(DATA, initial_state=state), GUESS)
    assert (powers_of(inner.guesses[1]) == 2000.0).all()


def test_neither_guess_nor_answer_is_written_to() -> None:
    first = answer(temperature_slack_k=1.0)
    kept, guess = first.variables.copy(), GUESS.copy()
    probe(Scripted(first)).solve(DATA, guess)
    np.testing.assert_array_equal(first.variables, kept)
    np.testing.assert_array_equal(guess, GUESS)


def test_escapes_the_valley_in_which_the_compressor_is_off() -> None:
    """The compressor is off and 26 degC asked for: the map is flat there, the solver alone stays off."""
    problem = problem_of(SCENES["cruise"], "3x1+5x5", "reference")
    alone = plain_solver("3x1+5x5").solve(*problem)
    probed = probing_solver("3x1+5x5").solve(*problem)

    def warmest_power(result: SolveResult) -> float:
        table = result.variables[: -layout.STATES].reshape(-1, BLOCK)
        return float(1000.0 * table[:, layout.STATES + InputIndex.COMPRESSOR_POWER].max())

    assert alone.status is SolveStatus.SOLVED
    assert warmest_power(alone) < OFF_BELOW_W
    assert probed.status is SolveStatus.SOLVED
    assert warmest_power(probed) > 1000.0
    assert probed.objective < alone.objective - 10.0
    assert probed.iterations > alone.iterations
