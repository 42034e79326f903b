"""The horizon as one nonlinear program: derivatives, structure, bounds, and one grid written two ways."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from iptm_controller.controller import Measurements
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import BLOCK, ROWS, InputIndex, LimitIndex
from iptm_controller.ocp.oracle import oracle_functions
from iptm_controller.ocp.problem import problem_bounds
from iptm_controller.ocp.transcription import Transcription
from iptm_controller.solvers.interface import SolverBackend
from iptm_controller.strategy import STRATEGIES
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray

GRIDS = ["2x1+2x5", "3x1", "1x0.5+1x1+2x10"]
Pose = Callable[..., tuple[ProblemData, FloatArray]]


@pytest.fixture(params=GRIDS)
def grid(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def transcription(transcription_of: Callable[[str], Transcription], grid: str) -> Transcription:
    return transcription_of(grid)


@pytest.fixture
def point(
    problem_of: Pose, scenes: dict[str, Measurements], grid: str
) -> tuple[FloatArray, FloatArray]:
    """Somewhere around a trajectory, all terms of the cost counting."""
    data, guess = problem_of(scenes["hills"], grid, "reference_energy_aging")
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


def test_derivatives_agree_with_finite_differences(
    transcription: Transcription, point: tuple[FloatArray, FloatArray]
) -> None:
    t = transcription
    lam_g = np.random.default_rng(3).normal(size=t.grid.row_count)
    values = ca.Function("v", [t.variables, t.parameters], [ca.vertcat(t.cost, t.rows)])
    slopes = ca.Function("s", [t.variables, t.parameters], [ca.vertcat(t.gradient.T, t.jacobian)])
    curvature = ca.Function("h", [t.variables, t.parameters], [t.hessian(ca.MX(1.0), ca.MX(lam_g))])
    w, p = point
    weights = np.concatenate([[1.0], lam_g])
    step = 1e-5
    for seed in range(5):
        direction = np.random.default_rng(seed).normal(size=w.size)
        ahead, behind = w + step * direction, w - step * direction
        difference = (numbers(values, ahead, p) - numbers(values, behind, p)) / (2.0 * step)
        analytic = numbers(slopes, w, p) @ direction
        np.testing.assert_allclose(analytic, difference.ravel(), rtol=1e-4, atol=1e-4)
        turned = numbers(slopes, ahead, p) - numbers(slopes, behind, p)
        expected = weights @ turned / (2.0 * step)
        np.testing.assert_allclose(
            numbers(curvature, w, p) @ direction, expected, rtol=1e-3, atol=1e-3
        )


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


def test_dynamics_rows_vanish_on_a_trajectory(
    transcription: Transcription, problem_of: Pose, scenes: dict[str, Measurements], grid: str
) -> None:
    """Where position and speed follow the inputs, only the temperatures are left over."""
    data, guess = problem_of(scenes["cruise"], grid)
    function = ca.Function(
        "rows", [transcription.variables, transcription.parameters], [transcription.rows]
    )
    table = numbers(function, guess, data.parameters).reshape(-1, ROWS)[:, : layout.STATES]
    np.testing.assert_allclose(np.delete(table, [2, 3], axis=1), 0.0, atol=1e-12)
    assert (np.abs(table[:, 2:4]) > 0.0).all()


def test_one_grid_written_two_ways_is_one_problem(
    transcription_of: Callable[[str], Transcription],
    problem_of: Pose,
    scenes: dict[str, Measurements],
) -> None:
    values = []
    for text in ("8x1", "3x1+5x1"):
        t = transcription_of(text)
        function = ca.Function(
            "all", [t.variables, t.parameters], [ca.vertcat(t.cost, t.rows, ca.vec(t.jacobian))]
        )
        data, guess = problem_of(scenes["hills"], text, "reference_energy_aging")
        values.append((data.parameters, numbers(function, guess + 0.1, data.parameters)))
    np.testing.assert_array_equal(values[0][0], values[1][0])
    np.testing.assert_allclose(values[0][1], values[1][1], rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("strategy", sorted(STRATEGIES))
def test_single_and_multi_horizon_give_the_same_plan_on_the_same_steps(
    plain_solver: Callable[..., SolverBackend],
    problem_of: Pose,
    scenes: dict[str, Measurements],
    strategy: str,
) -> None:
    plans = []
    for text in ("8x1", "3x1+5x1"):
        result = plain_solver(text, compile_code=False).solve(
            *problem_of(scenes["leader_brakes"], text, strategy)
        )
        assert result.status.usable
        plans.append(result)
    assert plans[0].iterations == plans[1].iterations
    np.testing.assert_allclose(plans[0].variables, plans[1].variables, rtol=0.0, atol=1e-6)


def test_only_physical_input_limits_are_hard(parameters: ModelParameters) -> None:
    bounds = problem_bounds(3, parameters.limits)
    low = bounds.variables_low[:-6].reshape(3, BLOCK)
    high = bounds.variables_high[:-6].reshape(3, BLOCK)
    for table, states in ((low, -np.inf), (high, np.inf)):
        assert (table[:, : layout.STATES] == states).all()
    inputs = slice(layout.STATES, None)
    assert low[:, inputs].tolist() == [[-2.0, 0.0, 0.0, 0.0, 0.0, 0.0]] * 3
    assert high[:, inputs].tolist() == [[2.0, 4.5, np.inf, np.inf, np.inf, np.inf]] * 3
    assert (bounds.variables_low[-6:] == -np.inf).all()
    row_low, row_high = bounds.rows_low.reshape(3, ROWS), bounds.rows_high.reshape(3, ROWS)
    assert (row_low[:, : layout.STATES] == 0.0).all()
    assert (row_high[:, : layout.STATES] == 0.0).all()
    rates = [
        layout.STATES + LimitIndex.ACCELERATION_RATE,
        layout.STATES + LimitIndex.COMPRESSOR_RATE,
    ]
    assert (row_low[:, rates] == -1.0).all()
    assert (row_high[:, rates] == 1.0).all()
    soft = [row for row in range(layout.STATES, ROWS) if row not in rates]
    assert (row_low[:, soft] == 0.0).all()
    assert (row_high[:, soft] == np.inf).all()


def test_enough_slack_makes_any_state_feasible(
    transcription_of: Callable[[str], Transcription],
    problem_of: Pose,
    make_scene: Callable[..., Measurements],
) -> None:
    """Feasible by design: no measurement can make the soft rows contradict each other."""
    t = transcription_of("2x1+2x5")
    function = ca.Function("rows", [t.variables, t.parameters], [t.rows])
    scene = make_scene(gap_m=-0.5, speed_m_s=45.0, leader_speed_m_s=0.0, cell_n_temperature_k=330.0)
    data, guess = problem_of(scene, "2x1+2x5")
    guess[:-6].reshape(-1, BLOCK)[:, layout.STATES + InputIndex.GAP_SHORT :] = 5000.0
    rows = numbers(function, guess, data.parameters).reshape(-1, ROWS)[:, layout.STATES :]
    assert (rows[:, LimitIndex.GAP_MIN :] >= 0.0).all()


def test_functions_for_compiled_solvers(
    transcription: Transcription, point: tuple[FloatArray, FloatArray]
) -> None:
    """What plug-ins look up by name has the promised outputs and values."""
    signature = {
        "nlp_grad_f": ("grad_f_x",),
        "nlp_hess_l": ("grad_gamma_x", "hess_gamma_x_x", "triu_hess_gamma_x_x"),
    }
    functions = {f.name(): f for f in oracle_functions(transcription, signature)}
    assert set(functions) == {"nlp", "nlp_grad", *signature}
    assert functions["nlp"].name_in() == ["x", "p"]
    assert functions["nlp_hess_l"].name_in() == ["x", "p", "lam_f", "lam_g"]
    assert functions["nlp_hess_l"].name_out() == list(signature["nlp_hess_l"])
    lam_g = np.random.default_rng(4).normal(size=transcription.grid.row_count)
    slope, hessian, upper = functions["nlp_hess_l"](*point, 2.0, lam_g)
    t = transcription
    parts = ca.Function("parts", [t.variables, t.parameters], [t.gradient, t.jacobian])
    gradient, jacobian = (part.full() for part in parts(*point))
    expected = 2.0 * gradient.ravel() + jacobian.T @ lam_g
    np.testing.assert_allclose(slope.full().ravel(), expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(np.triu(hessian.full()), upper.full())
    cost, rows, again, _ = functions["nlp_grad"](*point, 2.0, lam_g)
    np.testing.assert_allclose(again.full(), slope.full())
    assert rows.numel() == transcription.grid.row_count
    assert float(cost) == pytest.approx(float(functions["nlp"](*point)[0]))
