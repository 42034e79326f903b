"""The horizon as one nonlinear program with the stage structure kept visible.

Variables are ordered ``x_0, u_0, x_1, u_1, ..., x_N`` and constraint rows ``dynamics_0, limits_0,
dynamics_1, ...``, the order that structure-exploiting solvers read. Every derivative is taken once per
stage kind and mapped over the steps of a phase, so that code size does not grow with the horizon and
evaluation cost grows linearly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.layout import InputIndex, LimitIndex
from iptm_controller.ocp.stage import (
    DEFAULT_PENALTIES,
    DEFAULT_SMOOTHING,
    PenaltyWeights,
    StageSpec,
    build_stage,
    sample_count,
)
from iptm_core.parameters.model import LimitParameters, ModelParameters
from iptm_core.physics.power_thermal import Smoothing
from iptm_core.state import FloatArray

ROWS = layout.STATES + layout.LIMITS
BLOCK = layout.STATES + layout.INPUTS
UNBOUNDED = np.inf


@dataclass(frozen=True)
class StageFunctions:
    """Functions of one stage kind; sparse results come as vectors of nonzeros.

    Attributes:
        spec: step length and samples.
        value: ``(x, u, p, g) -> (rows (20,), cost)``, rows being minus the next state, then limits.
        gradient: ``(x, u, p, g) -> (cost gradient (12,))``.
        jacobian: ``(x, u, p, g) -> nonzeros of d rows / d (x, u)``.
        hessian: ``(x, u, p, g, lam_f, lam_rows) -> nonzeros of the Lagrangian's Hessian``.
        jacobian_sparsity: (20, 12).
        hessian_sparsity: (12, 12), symmetric.
    """

    spec: StageSpec
    value: ca.Function
    gradient: ca.Function
    jacobian: ca.Function
    hessian: ca.Function
    jacobian_sparsity: ca.Sparsity
    hessian_sparsity: ca.Sparsity


def build_stage_functions(
    spec: StageSpec, parameters: ModelParameters, name: str
) -> StageFunctions:
    """Differentiate one stage kind symbolically."""
    stage = build_stage(spec, parameters)
    variables = ca.vertcat(stage.state, stage.inputs)
    # The sign of the dynamics rows is the one that structure-exploiting solvers expect: x+ - F(x, u).
    rows = ca.vertcat(-stage.next_state, stage.limits)
    arguments = [stage.state, stage.inputs, stage.step_parameters, stage.global_parameters]
    lam_f, lam_rows = ca.SX.sym("lam_f"), ca.SX.sym("lam_rows", ROWS)
    gradient = ca.gradient(stage.cost, variables)
    jacobian = ca.jacobian(rows, variables)
    lagrangian = lam_f * stage.cost + ca.dot(lam_rows, rows)
    hessian = ca.hessian(lagrangian, variables)[0]
    options = {"cse": True}
    return StageFunctions(
        spec=spec,
        value=ca.Function(f"{name}_value", arguments, [rows, stage.cost], options),
        gradient=ca.Function(f"{name}_gradient", arguments, [ca.densify(gradient)], options),
        jacobian=ca.Function(f"{name}_jacobian", arguments, [_nonzeros(jacobian)], options),
        hessian=ca.Function(
            f"{name}_hessian", [*arguments, lam_f, lam_rows], [_nonzeros(hessian)], options
        ),
        jacobian_sparsity=jacobian.sparsity(),
        hessian_sparsity=hessian.sparsity(),
    )


@dataclass(frozen=True)
class Transcription:
    """The nonlinear program of one horizon.

    Attributes:
        horizon: the grid.
        stages: one stage kind per phase.
        variables: symbol w, shape (12 N + 6,).
        parameters: symbol, globals then the parameters of every step.
        objective: ``(w, parameters) -> cost``, and so on for the others.
        step_offsets: start of each step's parameters in the parameter vector, shape (N,).
    """

    horizon: Horizon
    stages: tuple[StageFunctions, ...]
    variables: ca.MX
    parameters: ca.MX
    cost: ca.MX
    rows: ca.MX
    gradient: ca.MX
    jacobian: ca.MX
    step_offsets: NDArray[np.int64]

    @property
    def variable_count(self) -> int:
        """Number of decision variables."""
        return BLOCK * self.horizon.steps + layout.STATES

    @property
    def row_count(self) -> int:
        """Number of constraint rows."""
        return ROWS * self.horizon.steps

    def hessian(self, lam_f: ca.MX, lam_rows: ca.MX) -> ca.MX:
        """Hessian of ``lam_f cost + lam_rows . rows``, symmetric and block diagonal."""
        count = self.horizon.steps
        multipliers = ca.reshape(lam_rows, ROWS, count)
        blocks = []
        start = 0
        for stage, phase, arguments in zip(
            self.stages, self.horizon.phases, self._arguments(), strict=True
        ):
            span = slice(start, start + phase.steps)
            repeated = [ca.repmat(lam_f, 1, phase.steps), multipliers[:, span]]
            blocks.append(ca.vec(stage.hessian.map(phase.steps)(*arguments, *repeated)))
            start += phase.steps
        values = ca.vertcat(*blocks)
        sparsity, order = _scatter(
            (self.variable_count, self.variable_count), self._hessian_entries()
        )
        return ca.MX(sparsity, values[order])

    def _arguments(self) -> list[list[ca.MX]]:
        counts = [stage.spec.parameter_count for stage in self.stages]
        return phase_arguments(self.horizon, counts, self.variables, self.parameters)

    def _hessian_entries(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        rows, columns = [], []
        start = 0
        for stage, phase in zip(self.stages, self.horizon.phases, strict=True):
            row, column = (np.array(part) for part in stage.hessian_sparsity.get_triplet())
            for step in range(start, start + phase.steps):
                rows.append(row + BLOCK * step)
                columns.append(column + BLOCK * step)
            start += phase.steps
        return np.concatenate(rows), np.concatenate(columns)


def transcribe(
    horizon: Horizon,
    model: ModelParameters,
    smoothing: Smoothing = DEFAULT_SMOOTHING,
    penalties: PenaltyWeights = DEFAULT_PENALTIES,
) -> Transcription:
    """Build the nonlinear program of a horizon for a vehicle."""
    stages = tuple(
        build_stage_functions(
            StageSpec(phase.step_s, sample_count(phase.step_s), smoothing, penalties),
            model,
            f"stage_{index}",
        )
        for index, phase in enumerate(horizon.phases)
    )
    sizes = np.concatenate(
        [
            np.full(phase.steps, stage.spec.parameter_count)
            for phase, stage in zip(horizon.phases, stages, strict=True)
        ]
    )
    offsets = layout.GLOBALS + np.concatenate([[0], np.cumsum(sizes)])
    w = ca.MX.sym("x", BLOCK * horizon.steps + layout.STATES)
    p = ca.MX.sym("p", int(offsets[-1]))
    counts = [stage.spec.parameter_count for stage in stages]
    arguments = phase_arguments(horizon, counts, w, p)
    rows, costs, gradients, jacobians = [], [], [], []
    for stage, phase, argument in zip(stages, horizon.phases, arguments, strict=True):
        row, cost = stage.value.map(phase.steps)(*argument)
        rows.append(row)
        costs.append(ca.sum2(cost))
        gradients.append(ca.vec(stage.gradient.map(phase.steps)(*argument)))
        jacobians.append(ca.vec(stage.jacobian.map(phase.steps)(*argument)))
    successors = ca.reshape(w[layout.STATES + layout.INPUTS :], -1, 1)
    nodes = ca.reshape(ca.vertcat(successors, ca.MX.zeros(layout.INPUTS, 1)), BLOCK, horizon.steps)[
        : layout.STATES, :
    ]
    row_table = ca.horzcat(*rows)
    row_table = ca.vertcat(row_table[: layout.STATES, :] + nodes, row_table[layout.STATES :, :])
    sparsity, order = _scatter(
        (ROWS * horizon.steps, BLOCK * horizon.steps + layout.STATES),
        _jacobian_entries(horizon, stages),
    )
    values = ca.vertcat(*jacobians, ca.MX.ones(layout.STATES * horizon.steps, 1))
    return Transcription(
        horizon=horizon,
        stages=stages,
        variables=w,
        parameters=p,
        cost=sum(costs[1:], costs[0]),
        rows=ca.vec(row_table),
        gradient=ca.vertcat(*gradients, ca.MX.zeros(layout.STATES, 1)),
        jacobian=ca.MX(sparsity, values[order]),
        step_offsets=offsets[:-1].astype(np.int64),
    )


@dataclass(frozen=True)
class Bounds:
    """Bounds of variables and rows, in scaled units, in the order of the transcription."""

    variables_low: FloatArray
    variables_high: FloatArray
    rows_low: FloatArray
    rows_high: FloatArray


def problem_bounds(steps: int, limits: LimitParameters) -> Bounds:
    """Constant bounds: physical input limits hard, everything else through rows with slacks.

    The entries of x_0 are free here; the present state is put into them for every problem.
    """
    free = np.full(layout.STATES, UNBOUNDED)
    input_low = np.zeros(layout.INPUTS)
    input_high = np.full(layout.INPUTS, UNBOUNDED)
    input_low[InputIndex.ACCELERATION] = limits.min_acceleration_m_s2
    input_high[InputIndex.ACCELERATION] = limits.max_acceleration_m_s2
    input_low[InputIndex.COMPRESSOR_POWER] = limits.min_compressor_power_w
    input_high[InputIndex.COMPRESSOR_POWER] = limits.max_compressor_power_w
    input_low = input_low / layout.INPUT_SCALE
    input_high = input_high / layout.INPUT_SCALE
    row_low = np.zeros(ROWS)
    row_high = np.full(ROWS, UNBOUNDED)
    row_high[: layout.STATES] = 0.0
    for rate in (LimitIndex.ACCELERATION_RATE, LimitIndex.COMPRESSOR_RATE):
        row_low[layout.STATES + rate] = -1.0
        row_high[layout.STATES + rate] = 1.0
    return Bounds(
        variables_low=np.concatenate([np.tile(np.concatenate([-free, input_low]), steps), -free]),
        variables_high=np.concatenate([np.tile(np.concatenate([free, input_high]), steps), free]),
        rows_low=np.tile(row_low, steps),
        rows_high=np.tile(row_high, steps),
    )


def phase_arguments(
    horizon: Horizon, parameter_counts: Sequence[int], w: ca.MX, p: ca.MX
) -> list[list[ca.MX]]:
    """Stage arguments of every phase: states, inputs, step parameters and globals, one column each.

    Args:
        horizon: the grid.
        parameter_counts: parameters of one step, for each phase.
        w: all variables.
        p: all parameters.
    """
    table = ca.reshape(w[: BLOCK * horizon.steps], BLOCK, horizon.steps)
    shared = p[: layout.GLOBALS]
    arguments = []
    step, offset = 0, layout.GLOBALS
    for phase, count in zip(horizon.phases, parameter_counts, strict=True):
        columns = slice(step, step + phase.steps)
        length = count * phase.steps
        arguments.append(
            [
                table[: layout.STATES, columns],
                table[layout.STATES :, columns],
                ca.reshape(p[offset : offset + length], count, phase.steps),
                ca.repmat(shared, 1, phase.steps),
            ]
        )
        step += phase.steps
        offset += length
    return arguments


def _jacobian_entries(
    horizon: Horizon, stages: tuple[StageFunctions, ...]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    rows, columns = [], []
    start = 0
    for stage, phase in zip(stages, horizon.phases, strict=True):
        row, column = (np.array(part) for part in stage.jacobian_sparsity.get_triplet())
        for step in range(start, start + phase.steps):
            rows.append(row + ROWS * step)
            columns.append(column + BLOCK * step)
        start += phase.steps
    for step in range(horizon.steps):
        index = np.arange(layout.STATES)
        rows.append(index + ROWS * step)
        columns.append(index + BLOCK * (step + 1))
    return np.concatenate(rows), np.concatenate(columns)


def _scatter(
    shape: tuple[int, int], entries: tuple[NDArray[np.int64], NDArray[np.int64]]
) -> tuple[ca.Sparsity, list[int]]:
    """Sparsity of unique (row, column) entries and, per nonzero, where its value stands in the list."""
    rows, columns = entries
    order = np.lexsort((rows, columns))
    sparsity = ca.Sparsity.triplet(*shape, rows[order].tolist(), columns[order].tolist())
    return sparsity, order.tolist()


def _nonzeros(matrix: ca.SX) -> ca.SX:
    return matrix.nz[:]
