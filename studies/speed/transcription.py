"""The horizon as one nonlinear program, for solvers that are compared with the suite's.

Variables, rows and parameters are ordered as in ``ProblemGrid``. Every derivative is taken once per
stage kind and mapped over the steps of a phase, so that code size does not grow with the horizon and
evaluation cost grows linearly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from iptm_controller.ocp import layout
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.problem import Bounds, OptimalControlProblem, stage_bounds
from iptm_controller.ocp.stage import StageExpressions
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.model_numbers import SymbolicModel
from iptm_core.physics.ops import named_function

Entries = tuple[NDArray[np.int64], NDArray[np.int64]]


@dataclass(frozen=True)
class StageFunctions:
    """Functions of one stage kind; sparse results come as vectors of nonzeros.

    Attributes:
        value: ``(x, u, p, g) -> (rows, cost)``; rows, shape (ROWS,): minus the next state, then the limits.
        gradient: ``(x, u, p, g) -> cost gradient``, shape (BLOCK,).
        jacobian: ``(x, u, p, g) -> nonzeros of d rows / d (x, u)``.
        hessian: ``(x, u, p, g, lam_f, lam_rows) -> nonzeros of the Lagrangian's Hessian``.
        jacobian_sparsity: shape (ROWS, BLOCK).
        hessian_sparsity: shape (BLOCK, BLOCK), symmetric.
    """

    value: ca.Function
    gradient: ca.Function
    jacobian: ca.Function
    hessian: ca.Function
    jacobian_sparsity: ca.Sparsity
    hessian_sparsity: ca.Sparsity


def differentiate_stage(stage: StageExpressions, name: str) -> StageFunctions:
    """Return the functions of one stage kind and their derivatives."""
    variables = ca.vertcat(stage.state, stage.inputs)
    # The sign of the dynamics rows is the one that structure-exploiting solvers expect: x+ - F(x, u).
    rows = ca.vertcat(-stage.next_state, stage.limits)
    arguments = [stage.state, stage.inputs, stage.step_parameters, stage.global_parameters]
    lam_f, lam_rows = ca.SX.sym("lam_f"), ca.SX.sym("lam_rows", layout.ROWS)
    gradient = ca.gradient(stage.cost, variables)
    jacobian = ca.jacobian(rows, variables)
    lagrangian = lam_f * stage.cost + ca.dot(lam_rows, rows)
    hessian = ca.hessian(lagrangian, variables)[0]
    options = {"cse": True}
    return StageFunctions(
        value=ca.Function(f"{name}_value", arguments, [rows, stage.cost], options),
        gradient=ca.Function(f"{name}_gradient", arguments, [ca.densify(gradient)], options),
        jacobian=ca.Function(f"{name}_jacobian", arguments, [jacobian.nz[:]], options),
        hessian=ca.Function(
            f"{name}_hessian", [*arguments, lam_f, lam_rows], [hessian.nz[:]], options
        ),
        jacobian_sparsity=jacobian.sparsity(),
        hessian_sparsity=hessian.sparsity(),
    )


@dataclass(frozen=True)
class Transcription:
    """The nonlinear program of one horizon as expressions of ``variables`` and ``parameters``.

    Attributes:
        grid: order of variables, rows and parameters.
        stages: one entry per stage kind of the grid.
        variables: symbol w, shape (N * BLOCK + STATES,).
        parameters: symbol p.
        cost: scalar.
        rows: constraints, shape (N * ROWS,).
        gradient: of the cost, shape (N * BLOCK + STATES,).
        jacobian: of the rows, shape (N * ROWS, N * BLOCK + STATES).
    """

    grid: ProblemGrid
    stages: tuple[StageFunctions, ...]
    variables: ca.MX
    parameters: ca.MX
    cost: ca.MX
    rows: ca.MX
    gradient: ca.MX
    jacobian: ca.MX

    @property
    def expressions(self) -> dict[str, ca.MX]:
        """The problem as symbolic expressions, for solvers that differentiate by themselves."""
        return {"x": self.variables, "p": self.parameters, "f": self.cost, "g": self.rows}

    def functions(self) -> list[ca.Function]:
        """Return the functions that CasADi's interface to IPOPT looks up by name in a compiled problem.

        They are functions of ``(x, p)``, or of ``(x, p, lam_f, lam_g)`` where an output needs multipliers.
        """
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.grid.row_count)
        point = {"x": self.variables, "p": self.parameters}
        dual = point | {"lam_f": lam_f, "lam_g": lam_g}
        values = {"f": self.cost, "g": self.rows}
        gamma = {
            "grad_gamma_x": lam_f * self.gradient + ca.mtimes(self.jacobian.T, lam_g),
            # Sensitivity to parameters is not used; the slot only has to exist.
            "grad_gamma_p": ca.MX.zeros(self.parameters.numel()),
        }
        return [
            named_function("nlp", point, values),
            named_function("nlp_grad", dual, values | gamma),
            named_function("nlp_f", point, {"f": self.cost}),
            named_function("nlp_g", point, {"g": self.rows}),
            named_function("nlp_grad_f", point, {"f": self.cost, "grad_f_x": self.gradient}),
            named_function("nlp_jac_g", point, {"g": self.rows, "jac_g_x": self.jacobian}),
            named_function(
                "nlp_hess_l", dual, {"triu_hess_gamma_x_x": ca.triu(self.hessian(lam_f, lam_g))}
            ),
        ]

    def hessian(self, lam_f: ca.MX, lam_rows: ca.MX) -> ca.MX:
        """Return the Hessian of ``lam_f cost + lam_rows . rows``, symmetric and block diagonal."""
        grid = self.grid
        arguments = stage_arguments(grid, self.variables, self.parameters)
        blocks = []
        for kind, stage, given in zip(grid.stages, self.stages, arguments, strict=True):
            multipliers = ca.reshape(lam_rows[kind.rows], layout.ROWS, kind.count)
            repeated = [ca.repmat(lam_f, 1, kind.count), multipliers]
            blocks.append(ca.vec(stage.hessian.map(kind.count)(*given, *repeated)))
        entries = _stage_entries(
            grid, [stage.hessian_sparsity for stage in self.stages], layout.BLOCK
        )
        shape = (grid.variable_count, grid.variable_count)
        return _assemble(shape, entries, ca.vertcat(*blocks))


def stage_arguments(grid: ProblemGrid, w: ca.MX, p: ca.MX) -> list[list[ca.MX]]:
    """Return the arguments of every stage kind, one column per step.

    Returns:
        For every kind: states, inputs, step parameters and globals.
    """
    arguments = []
    for kind in grid.stages:
        table = ca.reshape(w[kind.variables], layout.BLOCK, kind.count)
        arguments.append(
            [
                table[: layout.STATES, :],
                table[layout.STATES :, :],
                ca.reshape(p[kind.parameters], kind.parameter_count, kind.count),
                ca.repmat(p[: layout.GLOBALS], 1, kind.count),
            ]
        )
    return arguments


def next_states(grid: ProblemGrid, w: ca.MX) -> ca.MX:
    """Return x_1 ... x_N of the variables as columns."""
    shifted = ca.vertcat(w[layout.BLOCK :], ca.MX.zeros(layout.INPUTS))
    return ca.reshape(shifted, layout.BLOCK, grid.steps)[: layout.STATES, :]


def transcribe(problem: OptimalControlProblem) -> Transcription:
    """Return the nonlinear program of a problem."""
    grid = problem.grid
    stages = tuple(
        differentiate_stage(stage, f"stage_{index}")
        for index, stage in enumerate(
            problem.stage_expressions(SymbolicModel.literal(problem.model))
        )
    )
    w = ca.MX.sym("x", grid.variable_count)
    p = ca.MX.sym("p", grid.parameter_count)
    rows, costs, gradients, jacobians = [], [], [], []
    arguments = stage_arguments(grid, w, p)
    for kind, stage, given in zip(grid.stages, stages, arguments, strict=True):
        row, cost = stage.value.map(kind.count)(*given)
        rows.append(row)
        costs.append(ca.sum2(cost))
        gradients.append(ca.vec(stage.gradient.map(kind.count)(*given)))
        jacobians.append(ca.vec(stage.jacobian.map(kind.count)(*given)))
    row_table = ca.horzcat(*rows)
    row_table = ca.vertcat(
        row_table[: layout.STATES, :] + next_states(grid, w), row_table[layout.STATES :, :]
    )
    entries = _stage_entries(grid, [stage.jacobian_sparsity for stage in stages], layout.ROWS)
    shape = (grid.row_count, grid.variable_count)
    next_state_slopes = ca.MX.ones(layout.STATES * grid.steps, 1)
    return Transcription(
        grid=grid,
        stages=stages,
        variables=w,
        parameters=p,
        cost=sum(costs[1:], costs[0]),
        rows=ca.vec(row_table),
        gradient=ca.vertcat(*gradients, ca.MX.zeros(layout.STATES, 1)),
        jacobian=_assemble(
            shape, [*entries, *_next_state_entries(grid)], ca.vertcat(*jacobians, next_state_slopes)
        ),
    )


def _stage_entries(
    grid: ProblemGrid, sparsities: Sequence[ca.Sparsity], height: int
) -> list[Entries]:
    """Return rows and columns of the stage blocks along the diagonal, step by step."""
    entries: list[Entries] = []
    for kind, sparsity in zip(grid.stages, sparsities, strict=True):
        row, column = (np.array(part) for part in sparsity.get_triplet())
        entries += [
            (row + height * step, column + layout.BLOCK * step)
            for step in range(kind.steps.start, kind.steps.stop)
        ]
    return entries


def _next_state_entries(grid: ProblemGrid) -> list[Entries]:
    index = np.arange(layout.STATES)
    return [
        (index + layout.ROWS * step, index + layout.BLOCK * (step + 1))
        for step in range(grid.steps)
    ]


def _assemble(shape: tuple[int, int], entries: Sequence[Entries], values: ca.MX) -> ca.MX:
    """Return the sparse matrix with the values at unique (row, column) entries."""
    rows, columns = (np.concatenate(part) for part in zip(*entries, strict=True))
    order = np.lexsort((rows, columns))
    sparsity = ca.Sparsity.triplet(*shape, rows[order].tolist(), columns[order].tolist())
    return ca.MX(sparsity, values[order.tolist()])


def problem_bounds(steps: int, model: ModelParameters) -> Bounds:
    """Return the bounds of all variables and rows of a horizon, in the order of the grid."""
    stage = stage_bounds(model)
    last = slice(0, layout.STATES)
    return Bounds(
        np.concatenate([np.tile(stage.variables_low, steps), stage.variables_low[last]]),
        np.concatenate([np.tile(stage.variables_high, steps), stage.variables_high[last]]),
        np.tile(stage.rows_low, steps),
        np.tile(stage.rows_high, steps),
    )
