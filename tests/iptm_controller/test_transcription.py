"""The horizon as one nonlinear program: derivatives, structure, bounds, and one grid written two ways."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from tests.iptm_controller.scenes import (
    SCENES,
    make_scene,
    plain_solver,
    problem_of,
    transcription_of,
)

from iptm_controller.ocp import layout
from iptm_controller.ocp.layout import BLOCK, ROWS, InputIndex, LimitIndex
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


def test_stage_structure_is_visible(transcription: Transcription) -> None:
    """Rows of a step touch its own variables and, one to one, the states of the next node."""
    steps = transcription.grid.steps
    rows, columns = (np.array(part) for part in transcription.jacobian.sparsity().get_triplet())
    assert (columns >= BLOCK * (rows // ROWS)).all()
    assert (columns < BLOCK * (rows // ROWS) + BLOCK + layout.STATES).all()
    successor = columns >= BLOCK * (rows // ROWS) + BLOCK
    assert (rows[successor] % ROWS == columns[successor] % BLOCK).all()
    assert successor.sum() == layout.STATES * steps
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", transcription.grid.row_count)
    hessian = transcription.hessian(lam_f, lam_g).sparsity()
    rows, columns = (np.array(part) for part in hessian.get_triplet())
    assert (rows // BLOCK == columns // BLOCK).all()
    assert (rows < BLOCK * steps).all()


def test_dynamics_rows_vanish_on_a_trajectory(transcription: Transcription, grid: str) -> None:
    """Where position and speed follow the inputs, only the temperatures are left over."""
    data, guess = problem_of(SCENES["cruise"], grid)
    function = ca.Function(
        "rows", [transcription.variables, transcription.parameters], [transcription.rows]
    )
    table = numbers(function, guess, data.parameters).reshape(-1, ROWS)[:, : layout.STATES]
    np.testing.assert_allclose(np.delete(table, [2, 3], axis=1), 0.0, atol=1e-12)
    assert (np.abs(table[:, 2:4]) > 0.0).all()


def test_one_grid_written_two_ways_is_one_problem() -> None:
    values = []
    for text in ("8x1", "3x1+5x1"):
        t = transcription_of(text)
        function = ca.Function(
            "all", [t.variables, t.parameters], [ca.vertcat(t.cost, t.rows, ca.vec(t.jacobian))]
        )
        data, guess = problem_of(SCENES["hills"], text, "reference_energy_aging")
        values.append((data.parameters, numbers(function, guess + 0.1, data.parameters)))
    np.testing.assert_array_equal(values[0][0], values[1][0])
    np.testing.assert_allclose(values[0][1], values[1][1], rtol=1e-14, atol=1e-14)


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


def test_enough_slack_makes_any_state_feasible() -> None:
    """Feasible by design: no measurement can make the soft rows contradict each other."""
    t = transcription_of("2x1+2x5")
    function = ca.Function("rows", [t.variables, t.parameters], [t.rows])
    scene = make_scene(gap_m=-0.5, speed_m_s=45.0, leader_speed_m_s=0.0, cell_n_temperature_k=330.0)
    data, guess = problem_of(scene, "2x1+2x5")
    guess[:-6].reshape(-1, BLOCK)[:, layout.STATES + InputIndex.GAP_SHORT :] = 5000.0
    rows = numbers(function, guess, data.parameters).reshape(-1, ROWS)[:, layout.STATES :]
    assert (rows[:, LimitIndex.GAP_MIN :] >= 0.0).all()
