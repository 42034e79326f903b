"""One stage of the primal-dual Newton system, condensed to its states and inputs.

Slacks s and multipliers z of the inequality constraints ``c(x, u) - s = 0, s >= 0`` are eliminated from the
Newton system of the barrier problem (Nocedal and Wright, eq. 19.6): with ``Sigma = diag(z / s)`` a stage is
left with the Hessian ``H + J' Sigma J`` over states and inputs, as in HPIPM (Frison and Diehl, 2020). The
gradient is affine in the barrier parameter mu, so its two parts are kept apart and mu can be chosen later.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from iptm_controller.ocp import layout
from iptm_controller.ocp.layout import InputIndex
from iptm_controller.ocp.problem import stage_bounds
from iptm_controller.ocp.stage import StageExpressions
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.model_numbers import NUMBERS
from iptm_core.physics.ops import Scalar, is_symbolic, named_function


def inequality_constraints(model: ModelParameters) -> list[tuple[int, float, Scalar]]:
    """Return the finite bounds of a stage, each as index, sign and bound: ``sign (value - bound) >= 0``.

    The values are the limit rows of the stage followed by its inputs.
    """
    bounds = stage_bounds(model)
    own = slice(layout.STATES, None)
    low = np.concatenate([bounds.rows_low[own], bounds.variables_low[own]])
    high = np.concatenate([bounds.rows_high[own], bounds.variables_high[own]])
    return [
        (index, sign, bound)
        for index, both in enumerate(zip(low, high, strict=True))
        for sign, bound in zip((1.0, -1.0), both, strict=True)
        if is_symbolic(bound) or math.isfinite(bound)
    ]


@dataclass(frozen=True)
class StageSparsity:
    """Sparsity common to all stage kinds of a horizon, so that one recursion serves them all.

    Attributes:
        dynamics: Jacobian of the next state, (6, 12).
        inequalities: Jacobian of the inequality constraints, (inequalities, 12).
        hessian: lower triangle of the condensed Hessian, (12, 12).
    """

    dynamics: ca.Sparsity
    inequalities: ca.Sparsity
    hessian: ca.Sparsity

    def union(self, other: StageSparsity) -> StageSparsity:
        """Return the sparsity that holds both."""
        return StageSparsity(
            self.dynamics + other.dynamics,
            self.inequalities + other.inequalities,
            self.hessian + other.hessian,
        )


class StageSystem:
    """Derivatives of one stage kind."""

    def __init__(self, stage: StageExpressions) -> None:
        self._stage = stage
        variables = ca.vertcat(stage.state, stage.inputs)
        values = ca.vertcat(stage.limits, stage.inputs)
        self._inequalities = ca.vertcat(
            *(
                sign * (values[index] - bound)
                for index, sign, bound in inequality_constraints(stage.model.parameters)
            )
        )
        count = self._inequalities.numel()
        self._lam_next = ca.SX.sym("lam_next", layout.STATES)
        self._s = ca.SX.sym("s", count)
        self._z = ca.SX.sym("z", count)
        lagrangian = (
            stage.cost
            + ca.dot(self._lam_next, stage.next_state)
            - ca.dot(self._z, self._inequalities)
        )
        self._gradient = ca.densify(ca.gradient(stage.cost, variables))
        self._dynamics_jacobian = ca.jacobian(stage.next_state, variables)
        self._inequality_jacobian = ca.jacobian(self._inequalities, variables)
        self._sigma = self._z / self._s
        condensed = ca.hessian(lagrangian, variables)[0] + ca.mtimes(
            self._inequality_jacobian.T, ca.mtimes(ca.diag(self._sigma), self._inequality_jacobian)
        )
        self._hessian = ca.tril(condensed)

    @property
    def inequality_count(self) -> int:
        """Number of inequality constraints."""
        return int(self._inequalities.numel())

    @property
    def sparsity(self) -> StageSparsity:
        """Sparsity of this stage kind alone."""
        return StageSparsity(
            self._dynamics_jacobian.sparsity(),
            self._inequality_jacobian.sparsity(),
            self._hessian.sparsity(),
        )

    def linearise(self, sparsity: StageSparsity, name: str) -> ca.Function:
        """Return the condensed Newton system of the stage at an iterate.

        Args:
            sparsity: common sparsity; sparse results come as vectors of its nonzeros.

        Returns:
            Function of ``x, u, x_next, p, g, numbers``, lam (of x), lam_next (of x_next), s and z. The
            condensed gradient is ``gradient_affine + mu gradient_centring``; residuals are ``F - x_next`` and
            ``c - s``; norms are infinity norms unless stated as sums.
        """
        stage = self._stage
        x_next = ca.SX.sym("x_next", layout.STATES)
        lam = ca.SX.sym("lam", layout.STATES)
        inequality_residual = self._inequalities - self._s
        dynamics_residual = stage.next_state - x_next
        jacobian_t = self._inequality_jacobian.T
        gradient_affine = self._gradient + ca.mtimes(jacobian_t, self._sigma * inequality_residual)
        gradient_centring = -ca.mtimes(jacobian_t, 1.0 / self._s)
        stationarity = (
            self._gradient
            + ca.mtimes(self._dynamics_jacobian.T, self._lam_next)
            - ca.mtimes(jacobian_t, self._z)
        )
        stationarity[: layout.STATES] -= lam
        complementarity = self._s * self._z
        results = {
            "dynamics_jacobian": ca.project(self._dynamics_jacobian, sparsity.dynamics).nz[:],
            "hessian": ca.project(self._hessian, sparsity.hessian).nz[:],
            "gradient_affine": ca.densify(gradient_affine),
            "gradient_centring": ca.densify(gradient_centring),
            "dynamics_residual": dynamics_residual,
            "inequality_jacobian": ca.project(self._inequality_jacobian, sparsity.inequalities).nz[
                :
            ],
            "inequality_residual": inequality_residual,
            "cost_gradient": self._gradient,
            "stationarity_x": ca.norm_inf(stationarity[: layout.STATES]),
            "stationarity_u": ca.norm_inf(stationarity[layout.STATES :]),
            "dynamics_norm": ca.norm_inf(dynamics_residual),
            "inequality_norm": ca.norm_inf(inequality_residual),
            "complementarity_norm": ca.mmax(complementarity),
            "complementarity_sum": ca.sum1(complementarity),
            "z_sum": ca.sum1(self._z),
            "lam_sum": ca.norm_1(lam),
        }
        arguments = {
            **self._point(x_next),
            "lam": lam,
            "lam_next": self._lam_next,
            "s": self._s,
            "z": self._z,
        }
        return named_function(name, arguments, results, cse=True)

    def least_soft_slacks(self, name: str) -> ca.Function:
        """Return a function of ``x, u, x_next, p, g, numbers``: least slacks of u that keep the soft limits.

        The slacks of u itself and the next state are ignored.
        """
        point = self._point(ca.SX.sym("x_next", layout.STATES))
        return named_function(name, point, {"soft_slacks": self._least_soft_slacks()}, cse=True)

    def follow(self, name: str) -> ca.Function:
        """Return a function of ``x, u, p, g, numbers, power``: next state, cost with the least soft slacks.

        The power stands for the compressor power of u.
        """
        stage, power = self._stage, ca.SX.sym("power")
        inputs = [*ca.vertsplit(stage.inputs)]
        inputs[InputIndex.COMPRESSOR_POWER] = power
        inputs[layout.INPUTS - layout.SLACKS :] = ca.vertsplit(
            ca.substitute(self._least_soft_slacks(), stage.inputs, ca.vertcat(*inputs))
        )
        ends = ca.substitute(
            ca.vertcat(ca.densify(stage.next_state), stage.cost), stage.inputs, ca.vertcat(*inputs)
        )
        given = {"x": stage.state, "u": stage.inputs, "p": stage.step_parameters}
        given |= {"g": stage.global_parameters, NUMBERS: stage.model.numbers, "power": power}
        results = {"next_state": ends[:-1], "cost": ends[-1]}
        return named_function(name, given, results, cse=True)

    def _least_soft_slacks(self) -> ca.SX:
        soft_slacks = self._stage.inputs[layout.INPUTS - layout.SLACKS :]
        softened = self._inequalities[: self.inequality_count - layout.SLACKS]
        unsoftened = ca.substitute(softened, soft_slacks, ca.SX.zeros(layout.SLACKS))
        softens = ca.jacobian(softened, soft_slacks).sparsity()
        least = []
        for column in range(layout.SLACKS):
            rows = softens.row()[softens.colind()[column] : softens.colind()[column + 1]]
            least.append(ca.fmax(0.0, ca.mmax(-unsoftened[rows])))
        return ca.vertcat(*least)

    def evaluate(self, name: str) -> ca.Function:
        """Return a function of ``x, u, x_next, p, g, numbers``: constraints, dynamics residual and cost."""
        x_next = ca.SX.sym("x_next", layout.STATES)
        results = {
            "inequalities": self._inequalities,
            "dynamics_residual": self._stage.next_state - x_next,
            "cost": self._stage.cost,
        }
        return named_function(name, self._point(x_next), results, cse=True)

    def _point(self, x_next: ca.SX) -> dict[str, ca.SX]:
        stage = self._stage
        return {
            "x": stage.state,
            "u": stage.inputs,
            "x_next": x_next,
            "p": stage.step_parameters,
            "g": stage.global_parameters,
            NUMBERS: stage.model.numbers,
        }


def common_sparsity(systems: Sequence[StageSystem]) -> StageSparsity:
    """Return the union of the sparsity of several stage kinds."""
    common = systems[0].sparsity
    for system in systems[1:]:
        common = common.union(system.sparsity)
    return common
