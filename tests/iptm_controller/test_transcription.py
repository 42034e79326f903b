"""The horizon as one nonlinear program: derivatives, structure, bounds, and one grid written two ways."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from tests.iptm_controller.scenes import (
    SCENES,
    plain_solver,
    problem_of,
    transcription_of,
)

from iptm_controller.ocp import layout
from iptm_controller.ocp.layout import ROWS
from iptm_controller.ocp.transcription import Transcription
from iptm_controller.strategy import STRATEGIES
from iptm_core.state import FloatArray

GRIDS = ["2x1+2x5", "3x1", "1x0.5+1x1+2x10"]


@pytest.fixture(params=GRIDS)
def grid(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def transcription(grid: str) -> Transcription:
    return transcription_of(grid)


@pytest.fixture
def point(grid: str) -> tuple[FloatArray, FloatArray]:
    """Somewhere around a trajectory, all terms of the cost counting."""
    data, guess = problem_of(SCENES["hills"], grid, "reference_energy_aging")
    rng = np.random.default_rng(5)
    return guess + rng.uniform(-0.3, 0.3, guess.size), data.parameters


def numbers(function: ca.Function, *arguments: Any) -> FloatArray:
    answer: ca.DM = function.call(list(arguments))[0]
    values: FloatArray = answer.full()
    return values


def test_gradient_and_jacobian_are_casadis_own(
    transcription: Transcription, point: tuple[FloatArray, FloatArray]
) -> None:
    t = transcription
    for ours, theirs in (
        (t.gradient, ca.gradient(t.cost, t.variables)),
        (t.jacobian, ca.jacobian(t.rows, t.variables)),
    ):
        function = ca.Function("pair", [t.variables, t.parameters], [ours, theirs])
        mine, reference = (value.full() for value in function(*point))
        np.testing.assert_allclose(mine, reference, rtol=1e-10, atol=1e-10)


def test_hessian_is_casadis_own(
    transcription: Transcription, point: tuple[FloatArray, FloatArray]
) -> None:
    t = transcription
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", t.grid.row_count)
    lagrangian = lam_f * t.cost + ca.dot(lam_g, t.rows)
    theirs = ca.hessian(lagrangian, t.variables)[0]
    arguments = [t.variables, t.parameters, lam_f, lam_g]
    function = ca.Function("pair", arguments, [t.hessian(lam_f, lam_g), theirs])
    multipliers = np.random.default_rng(2).normal(size=t.grid.row_count)
    mine, reference = (value.full() for value in function(*point, 0.7, multipliers))
    np.testing.assert_allclose(mine, reference, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(mine, mine.T, rtol=1e-12, atol=1e-12)


def test_dynamics_rows_vanish_on_a_trajectory(transcription: Transcription, grid: str) -> None:
    """Where position and speed follow the inputs, only the temperatures are left over."""
    data, guess = problem_of(SCENES["cruise"], grid)
    function = ca.Function(
        "rows", [transcription.variables, transcription.parameters], [transcription.rows]
    )
    table = numbers(function, guess, data.parameters).reshape(-1, ROWS)[:, : layout.STATES]
    np.testing.assert_allclose(np.delete(table, [2, 3], axis=1), 0.0, atol=1e-12)
    assert (np.abs(table[:, 2:4]) > 0.0).all()


@pytest.mark.parametrize("strategy", sorted(STRATEGIES))
def test_single_and_multi_horizon_give_the_same_plan_on_the_same_steps(strategy: str) -> None:
    plans = []
    for text in ("8x1", "3x1+5x1"):
        result = plain_solver(text, compile_code=False).solve(
            *problem_of(SCENES["leader_brakes"], text, strategy)
        )
        assert result.status.usable
        plans.append(result)
    assert plans[0].iterations == plans[1].iterations
    np.testing.assert_allclose(plans[0].variables, plans[1].variables, rtol=0.0, atol=1e-6)
