"""One stage of the Newton system of the interior-point method, condensed to states and inputs.

Every limit is written as ``c(x, u) >= 0`` with a distance variable ``s`` and a multiplier ``z``, and both
are eliminated: what is left of a stage is a dense block over states and inputs. The right-hand side is
affine in the barrier parameter, so its two parts are kept apart and any barrier can be chosen later.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from iptm_controller.ocp import layout
from iptm_controller.ocp.problem import stage_bounds
from iptm_controller.ocp.stage import StageExpressions
from iptm_core.parameters.model import LimitParameters

WIDTH = layout.STATES + layout.INPUTS


@dataclass(frozen=True)
class Side:
    """One finite bound: ``sign (value - bound) >= 0`` for an entry of the rows and inputs of a stage."""

    index: int
    sign: float
    bound: float


def limit_sides(limits: LimitParameters) -> tuple[Side, ...]:
    """Finite bounds of a stage; the values are its limit rows followed by its inputs."""
    bounds = stage_bounds(limits)
    own = slice(layout.STATES, None)
    low = np.concatenate([bounds.rows_low[own], bounds.variables_low[own]])
    high = np.concatenate([bounds.rows_high[own], bounds.variables_high[own]])
    sides = []
    for index, (least, most) in enumerate(zip(low, high, strict=True)):
        if np.isfinite(least):
            sides.append(Side(index, 1.0, float(least)))
        if np.isfinite(most):
            sides.append(Side(index, -1.0, float(most)))
    return tuple(sides)


def distances(stage: StageExpressions, sides: Sequence[Side]) -> ca.SX:
    """Distances c to the bounds, one entry per side."""
    values = ca.vertcat(stage.limits, stage.inputs)
    return ca.vertcat(*(side.sign * (values[side.index] - side.bound) for side in sides))


@dataclass(frozen=True)
class StageStructure:
    """Sparsity common to all stage kinds of a horizon, so that one recursion serves them all.

    Attributes:
        dynamics: of the next state by states and inputs, (6, 12).
        distances: of the distances, (sides, 12).
        block: lower triangle of the condensed block, (12, 12).
    """

    dynamics: ca.Sparsity
    distances: ca.Sparsity
    block: ca.Sparsity


class StageSystem:
    """Derivatives of one stage kind."""

    def __init__(self, stage: StageExpressions, limits: LimitParameters) -> None:
        self._stage = stage
        variables = ca.vertcat(stage.state, stage.inputs)
        self._distances = distances(stage, limit_sides(limits))
        count = self._distances.numel()
        self._next_multiplier = ca.SX.sym("lam_next", layout.STATES)
        self._distance = ca.SX.sym("s", count)
        self._multiplier = ca.SX.sym("z", count)
        lagrangian = (
            stage.cost
            + ca.dot(self._next_multiplier, stage.next_state)
            - ca.dot(self._multiplier, self._distances)
        )
        self._gradient = ca.densify(ca.gradient(stage.cost, variables))
        self._dynamics = ca.jacobian(stage.next_state, variables)
        self._slopes = ca.jacobian(self._distances, variables)
        weight = self._multiplier / self._distance
        block = ca.hessian(lagrangian, variables)[0] + ca.mtimes(
            self._slopes.T, ca.mtimes(ca.diag(weight), self._slopes)
        )
        self._block = ca.tril(block)
        self._weight = weight

    @property
    def sides(self) -> int:
        """Number of limits."""
        return int(self._distances.numel())

    @property
    def structure(self) -> StageStructure:
        """Sparsity of this stage kind alone."""
        return StageStructure(
            self._dynamics.sparsity(), self._slopes.sparsity(), self._block.sparsity()
        )

    def linearise(self, structure: StageStructure, name: str) -> ca.Function:
        """Condensed Newton system of the stage at an iterate.

        Args:
            structure: common sparsity; sparse results come as vectors of its nonzeros.
            name: name of the function.

        Returns:
            ``(x, u, next x, p, g, lam, lam_next, s, z) -> (dynamics, block, pull, centring, defect,
            slopes, gap, gradient, errors)``. ``pull + mu centring`` is the condensed gradient for the
            barrier parameter mu, ``defect`` is F - next x, ``gap`` is c - s, ``errors`` are the largest
            entries of stationarity, defect, gap and s z, and the sums of s z, z and abs(lam).
        """
        stage = self._stage
        successor = ca.SX.sym("x_next", layout.STATES)
        multiplier = ca.SX.sym("lam", layout.STATES)
        gap = self._distances - self._distance
        defect = stage.next_state - successor
        pull = self._gradient + ca.mtimes(self._slopes.T, self._weight * gap)
        centring = -ca.mtimes(self._slopes.T, 1.0 / self._distance)
        stationarity = (
            self._gradient
            + ca.mtimes(self._dynamics.T, self._next_multiplier)
            - ca.mtimes(self._slopes.T, self._multiplier)
        )
        stationarity[: layout.STATES] -= multiplier
        products = self._distance * self._multiplier
        errors = ca.vertcat(
            ca.norm_inf(stationarity[: layout.STATES]),
            ca.norm_inf(stationarity[layout.STATES :]),
            ca.norm_inf(defect),
            ca.norm_inf(gap),
            ca.mmax(products),
            ca.sum1(products),
            ca.sum1(self._multiplier),
            ca.norm_1(multiplier),
        )
        return ca.Function(
            name,
            [
                stage.state,
                stage.inputs,
                successor,
                stage.step_parameters,
                stage.global_parameters,
                multiplier,
                self._next_multiplier,
                self._distance,
                self._multiplier,
            ],
            [
                ca.project(self._dynamics, structure.dynamics).nz[:],
                ca.project(self._block, structure.block).nz[:],
                ca.densify(pull),
                ca.densify(centring),
                defect,
                ca.project(self._slopes, structure.distances).nz[:],
                gap,
                self._gradient,
                errors,
            ],
            {"cse": True},
        )

    def least_slacks(self, name: str) -> ca.Function:
        """Smallest slacks that put no soft limit out of reach: ``(x, u, next x, p, g) -> slacks``.

        The slacks of u and the next state are ignored.
        """
        stage = self._stage
        slacks = stage.inputs[layout.INPUTS - layout.SLACKS :]
        own_bounds = self.sides - layout.SLACKS
        softened = self._distances[:own_bounds]
        tight = ca.substitute(softened, slacks, ca.SX.zeros(layout.SLACKS))
        eased_by = ca.jacobian(softened, slacks).sparsity()
        least = []
        for column in range(layout.SLACKS):
            rows = eased_by.row()[eased_by.colind()[column] : eased_by.colind()[column + 1]]
            least.append(ca.fmax(0.0, ca.mmax(-tight[rows])))
        arguments = [
            stage.state,
            stage.inputs,
            ca.SX.sym("x_next", layout.STATES),
            stage.step_parameters,
            stage.global_parameters,
        ]
        return ca.Function(name, arguments, [ca.vertcat(*least)], {"cse": True})

    def evaluate(self, name: str) -> ca.Function:
        """Values only: ``(x, u, next x, p, g) -> (distances, defect, cost)``."""
        stage = self._stage
        successor = ca.SX.sym("x_next", layout.STATES)
        arguments = [
            stage.state,
            stage.inputs,
            successor,
            stage.step_parameters,
            stage.global_parameters,
        ]
        return ca.Function(
            name,
            arguments,
            [self._distances, stage.next_state - successor, stage.cost],
            {"cse": True},
        )


def common_structure(systems: Sequence[StageSystem]) -> StageStructure:
    """Union of the sparsity of several stage kinds."""
    first, *others = (system.structure for system in systems)
    dynamics, slopes, block = first.dynamics, first.distances, first.block
    for other in others:
        dynamics = dynamics + other.dynamics
        slopes = slopes + other.distances
        block = block + other.block
    return StageStructure(dynamics, slopes, block)
