"""The step of the Riccati method is the Newton step: against a dense solve of the whole system."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from studies.speed.transcription import Transcription
from tests.iptm_controller.scenes import (
    PARAMETERS,
    Problem,
    make_scene,
    problem_of,
    transcription_of,
)
from tests.reference.line_search import StepSummary
from tests.reference.riccati_program import ITERATE, build_program

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import BLOCK, ROWS
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.riccati.recursion import PARTS
from iptm_controller.solvers.riccati.stage_system import inequality_constraints
from iptm_core.state import FloatArray

GRID = "2x1+2x5"
STEPS = 4
MU = 3e-3
Program = dict[str, ca.Function]


@dataclass(frozen=True)
class Iterate:
    """An iterate of the method inside of all limits."""

    w: FloatArray
    lam: FloatArray
    s: FloatArray
    z: FloatArray


@pytest.fixture(scope="module")
def program() -> Program:
    functions = build_program(OptimalControlProblem(Horizon.parse(GRID), PARAMETERS))
    return {function.name(): function for function in functions}


@pytest.fixture
def problem() -> Problem:
    scene = make_scene(leader_acceleration_m_s2=-0.4)
    return problem_of(scene, GRID, "reference_energy_aging")


@pytest.fixture
def iterate(program: Program, problem: Problem) -> Iterate:
    """Positive slacks and multipliers without order, so that nothing cancels by chance."""
    data, guess = problem
    rng = np.random.default_rng(5)
    w = guess + 0.02 * rng.normal(size=guess.size)
    w[: layout.STATES] = data.initial_state
    s, z = (program["starting_point"].size_out(name)[0] for name in ("s", "z"))
    return Iterate(
        w,
        rng.normal(size=layout.STATES * STEPS),
        rng.uniform(0.2, 2.0, size=s),
        rng.uniform(0.2, 2.0, size=z),
    )


def call(function: ca.Function, **given: object) -> dict[str, FloatArray]:
    return {name: value.full().ravel() for name, value in function(**given).items()}


def direction(
    program: Program, data: ProblemData, at: Iterate, delta: float
) -> tuple[dict[str, FloatArray], StepSummary]:
    parts = call(
        program["search_direction"],
        w=at.w,
        p=data.parameters,
        lam=at.lam,
        s=at.s,
        z=at.z,
        delta=delta,
    )
    step = {
        name: parts[f"d{name}_{PARTS[0]}"] + MU * parts[f"d{name}_{PARTS[1]}"] for name in ITERATE
    }
    return step, StepSummary(*parts["summary"].tolist())


@dataclass(frozen=True)
class Dense:
    """Terms of the optimality conditions as dense arrays; x_0 is left out of the unknowns."""

    gradient: FloatArray
    hessian: FloatArray
    dynamics: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    constraints: FloatArray


def dense_terms(transcription: Transcription, data: ProblemData, at: Iterate) -> Dense:
    """Everything from the transcription's own derivatives, in the conventions of the method."""
    t = transcription
    inequalities = inequality_constraints(PARAMETERS)
    choose = np.zeros((len(inequalities) * STEPS, ROWS * STEPS))
    bounds = np.zeros((len(inequalities) * STEPS, t.grid.variable_count))
    offsets = np.zeros(len(inequalities) * STEPS)
    for step in range(STEPS):
        for number, (index, sign, bound) in enumerate(inequalities):
            row = step * len(inequalities) + number
            offsets[row] = sign * bound
            if index < layout.LIMITS:
                choose[row, step * ROWS + layout.STATES + index] = sign
            else:
                bounds[row, step * BLOCK + layout.STATES + index - layout.LIMITS] = sign
    is_dynamics = np.arange(ROWS * STEPS) % ROWS < layout.STATES
    # The rows are x+ - F and the limits; the method counts F - x+ and subtracts the limits.
    multipliers = -choose.T @ at.z
    multipliers[is_dynamics] = -at.lam
    lam_f, lam_rows = ca.MX.sym("lam_f"), ca.MX.sym("lam_rows", t.grid.row_count)
    terms = ca.Function(
        "terms",
        [t.variables, t.parameters, lam_f, lam_rows],
        [t.gradient, t.rows, t.jacobian, t.hessian(lam_f, lam_rows)],
    )(at.w, data.parameters, 1.0, multipliers)
    gradient, rows, jacobian, hessian = (term.full() for term in terms)
    free = slice(layout.STATES, None)
    return Dense(
        gradient=gradient.ravel()[free],
        hessian=hessian[free, free],
        dynamics=-jacobian[is_dynamics, free],
        residual=-rows.ravel()[is_dynamics],
        jacobian=(choose @ jacobian + bounds)[:, free],
        constraints=choose @ rows.ravel() + bounds @ at.w - offsets,
    )


def newton_step(dense: Dense, at: Iterate, delta: float) -> dict[str, FloatArray]:
    """Solve the full Newton system of the barrier problem at once."""
    n, m, k = dense.gradient.size, at.lam.size, at.s.size
    matrix = np.zeros((n + m + 2 * k, n + m + 2 * k))
    w, lam = slice(0, n), slice(n, n + m)
    s, z = slice(n + m, n + m + k), slice(n + m + k, None)
    matrix[w, w] = dense.hessian + delta * np.eye(n)
    matrix[w, lam], matrix[w, z] = dense.dynamics.T, -dense.jacobian.T
    matrix[lam, w] = dense.dynamics
    matrix[s, w], matrix[s, s] = dense.jacobian, -np.eye(k)
    matrix[z, s], matrix[z, z] = np.diag(at.z), np.diag(at.s)
    residual = np.concatenate(
        [
            dense.gradient + dense.dynamics.T @ at.lam - dense.jacobian.T @ at.z,
            dense.residual,
            dense.constraints - at.s,
            at.s * at.z - MU,
        ]
    )
    solved = np.linalg.solve(matrix, -residual)
    return {"w": solved[w], "lam": solved[lam], "s": solved[s], "z": solved[z]}


@pytest.mark.parametrize("delta", [0.0, 0.7])
def test_the_recursion_solves_the_newton_system(
    program: Program, problem: Problem, iterate: Iterate, delta: float
) -> None:
    data, _ = problem
    step, summary = direction(program, data, iterate, delta)
    assert summary.corrected_pivots == 0.0
    dense = dense_terms(transcription_of(GRID), data, iterate)
    # The last state has no stage of its own: nothing is added to its (absent) curvature.
    hessian = dense.hessian.copy()
    hessian[-layout.STATES :, -layout.STATES :] -= delta * np.eye(layout.STATES)
    expected = newton_step(Dense(**{**dense.__dict__, "hessian": hessian}), iterate, delta)
    np.testing.assert_array_equal(step["w"][: layout.STATES], 0.0)
    np.testing.assert_allclose(step["w"][layout.STATES :], expected["w"], rtol=1e-6, atol=1e-7)
    for name in ("lam", "s", "z"):
        np.testing.assert_allclose(step[name], expected[name], rtol=1e-5, atol=1e-5)


def test_the_summary_has_the_residual_norms_and_slopes(
    program: Program, problem: Problem, iterate: Iterate
) -> None:
    data, _ = problem
    step, summary = direction(program, data, iterate, 0.0)
    dense = dense_terms(transcription_of(GRID), data, iterate)
    stationarity = dense.gradient + dense.dynamics.T @ iterate.lam - dense.jacobian.T @ iterate.z
    # lam of the last state has no counterpart but itself; the method keeps it at zero.
    own = np.abs(stationarity[: -layout.STATES]).max()
    assert summary.stationarity == pytest.approx(own, rel=1e-9)
    assert summary.dynamics == pytest.approx(np.abs(dense.residual).max(), rel=1e-9)
    assert summary.inequalities == pytest.approx(
        np.abs(dense.constraints - iterate.s).max(), rel=1e-9
    )
    assert summary.complementarity == pytest.approx((iterate.s * iterate.z).max())
    assert summary.complementarity_sum == pytest.approx(iterate.s @ iterate.z)
    assert summary.z_sum == pytest.approx(iterate.z.sum())
    slope = summary.cost_slope_affine + MU * summary.cost_slope_centring
    assert slope == pytest.approx(dense.gradient @ step["w"][layout.STATES :], rel=1e-8)
    log_slope = summary.log_slope_affine + MU * summary.log_slope_centring
    assert log_slope == pytest.approx((step["s"] / iterate.s).sum(), rel=1e-8)


def test_a_trial_point_is_a_step_away(program: Program, problem: Problem, iterate: Iterate) -> None:
    data, _ = problem
    given = {"w": iterate.w, "lam": iterate.lam, "s": iterate.s, "z": iterate.z}
    parts = call(program["search_direction"], p=data.parameters, delta=0.0, **given)
    parts.pop("summary")
    answer = call(
        program["trial_point"], p=data.parameters, mu=MU, backtracking=0.5, **given, **parts
    )
    length = float(answer["length"][0])
    step = {name: parts[f"d{name}_affine"] + MU * parts[f"d{name}_centring"] for name in ITERATE}
    assert 0.0 < length <= 0.5
    np.testing.assert_allclose(answer["next_w"], iterate.w + length * step["w"], atol=1e-12)
    np.testing.assert_allclose(answer["next_lam"], iterate.lam + length * step["lam"], atol=1e-12)
    there = Iterate(answer["next_w"], answer["next_lam"], answer["next_s"], answer["next_z"])
    assert there.s.min() > 0.0
    assert there.z.min() > 0.0
    dense = dense_terms(transcription_of(GRID), data, there)
    moved = iterate.s + length * step["s"]
    np.testing.assert_allclose(there.s, np.maximum(moved, dense.constraints), atol=1e-9)
    residual = np.concatenate([dense.residual, dense.constraints - there.s])
    cost, log_sum, total, largest = answer["point"]
    assert np.isfinite(cost)
    assert log_sum == pytest.approx(np.log(there.s).sum())
    assert total == pytest.approx(np.abs(residual).sum())
    assert largest == pytest.approx(np.abs(residual).max())


def test_soft_slacks_start_as_guessed_or_relaxed(program: Program) -> None:
    """Far too close: relaxed, the slacks leave no soft limit out of reach."""
    data, guess = problem_of(make_scene(gap_m=-20.0), GRID, "aging")
    starts = {
        relax: call(program["starting_point"], guess=guess, p=data.parameters, mu=1e-2, relax=relax)
        for relax in (0.0, 1.0)
    }
    for relax, start in starts.items():
        table = start["w"][: -layout.STATES].reshape(STEPS, BLOCK)
        slacks = table[:, BLOCK - layout.SLACKS :]
        assert slacks.min() > 0.0
        assert start["s"].min() > 0.0
        np.testing.assert_allclose(start["s"] * start["z"], 1e-2)
        none = np.zeros(layout.STATES * STEPS)
        at = Iterate(start["w"], none, start["s"], start["z"])
        dense = dense_terms(transcription_of(GRID), data, at)
        if relax:
            assert dense.constraints.min() > -1e-9
            assert slacks.max() > 20.0
        else:
            assert dense.constraints.min() < -20.0
            assert slacks.max() < 0.1
