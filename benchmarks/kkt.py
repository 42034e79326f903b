"""How optimal a solution is, judged without the solver: the residual of the optimality conditions.

The conditions hold at a point if *some* multipliers fulfil them. Their best values are found by a
linear program, so a solution is judged alike whatever solver it comes from, and whether or not that
solver reports its multipliers. Derivatives are those of the transcription, on CasADi's virtual machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem, problem_bounds
from iptm_controller.ocp.transcription import transcribe
from iptm_core.errors import SolverSetupError
from iptm_core.state import FloatArray

LP_OPTIONS = {
    "output_flag": False,
    "log_to_console": False,
    "threads": 1,
    "parallel": "off",
    "primal_feasibility_tolerance": 1e-10,
    "dual_feasibility_tolerance": 1e-10,
}
MULTIPLIER_SCALE = 100.0
"""Mean multiplier from which on residuals count relative to the multipliers, as in IPOPT."""


@dataclass(frozen=True)
class KktResidual:
    """Residual of the Karush-Kuhn-Tucker conditions, scaled problem, largest entries.

    The sign of the multipliers is not an entry: it holds exactly for the multipliers used.

    Attributes:
        stationarity: gradient of the Lagrangian.
        complementarity: multiplier times distance to its bound.
        feasibility: violation of rows and bounds.
        multiplier_scale: what stationarity and complementarity are divided by in ``optimality``.
    """

    stationarity: float
    complementarity: float
    feasibility: float
    multiplier_scale: float

    @property
    def optimality(self) -> float:
        """Stationarity and complementarity, relative to the size of the multipliers."""
        return max(self.stationarity, self.complementarity) / self.multiplier_scale

    @property
    def worst(self) -> float:
        """Largest of all conditions."""
        return max(self.optimality, self.feasibility)


class KktChecker:
    """Judges solutions of one horizon."""

    def __init__(self, problem: OptimalControlProblem) -> None:
        """Prepare derivatives and the linear program."""
        t = transcribe(problem)
        self._bounds = problem_bounds(problem.grid.steps, problem.model)
        self._evaluate = ca.Function(
            "kkt_terms", [t.variables, t.parameters], [t.rows, t.gradient, t.jacobian]
        )
        # x_0 is given: nothing can be asked of the gradient there.
        self._free = np.arange(layout.STATES, problem.grid.variable_count)
        self._low = np.concatenate([self._bounds.rows_low, self._bounds.variables_low[self._free]])
        self._high = np.concatenate(
            [self._bounds.rows_high, self._bounds.variables_high[self._free]]
        )
        self._equal = self._low == self._high
        self._program: ca.Function | None = None

    def residual(self, data: ProblemData, variables: FloatArray) -> KktResidual:
        """Judge a solution with the multipliers that suit it best.

        Args:
            data: numbers of the problem.
            variables: solution in scaled units, order of the transcription.

        Raises:
            SolverSetupError: the linear program for the multipliers fails.
        """
        rows, gradient, jacobian = self._evaluate(variables, data.parameters)
        values = np.concatenate([rows.full().ravel(), variables[self._free]])
        start = np.abs(variables[: layout.STATES] - data.initial_state)
        violation = np.maximum(np.maximum(self._low - values, values - self._high), 0.0)
        feasibility = float(max(violation.max(), start.max()))
        gradient_free = gradient.full().ravel()[self._free]
        # One matrix for rows and bounds: d (rows, variables) / d variables, transposed.
        transposed = ca.horzcat(jacobian[:, self._free.tolist()].T, ca.DM.eye(self._free.size))
        multipliers = self._best_multipliers(gradient_free, transposed, values)
        stationarity = np.abs(gradient_free + (transposed @ multipliers).full().ravel())
        distance = np.where(multipliers > 0.0, self._high - values, values - self._low)
        with np.errstate(invalid="ignore"):
            products = np.where(
                self._equal | (multipliers == 0.0), 0.0, np.abs(multipliers * distance)
            )
        mean = float(np.mean(np.abs(multipliers)))
        return KktResidual(
            stationarity=float(stationarity.max()),
            complementarity=float(products.max()),
            feasibility=feasibility,
            multiplier_scale=max(MULTIPLIER_SCALE, mean) / MULTIPLIER_SCALE,
        )

    def _best_multipliers(
        self, gradient: FloatArray, transposed: ca.DM, values: FloatArray
    ) -> FloatArray:
        """Minimise the largest entry t of stationarity and complementarity over the multipliers.

        Multipliers are split by sign, ``upper - lower`` with both parts non-negative, so that each
        part is tied to its own bound: ``part * distance <= t``.
        """
        has_high, has_low = np.isfinite(self._high), np.isfinite(self._low)
        count = values.size
        with np.errstate(invalid="ignore"):
            to_high = np.where(has_high & ~self._equal, np.maximum(self._high - values, 0.0), 0.0)
            to_low = np.where(has_low & ~self._equal, np.maximum(values - self._low, 0.0), 0.0)
        upper, lower = np.flatnonzero(has_high), np.flatnonzero(has_low)
        picked = ca.horzcat(transposed[:, upper.tolist()], -transposed[:, lower.tolist()])
        parts = upper.size + lower.size
        minus_ones = -ca.DM.ones(gradient.size, 1)
        distances = np.concatenate([to_high[upper], to_low[lower]])
        matrix = ca.vertcat(
            ca.horzcat(picked, minus_ones),
            ca.horzcat(picked, -minus_ones),
            # Dense on the diagonal, so that one set-up serves every solution.
            ca.horzcat(ca.DM(ca.Sparsity.diag(parts), distances), -ca.DM.ones(parts, 1)),
        )
        infinite = np.inf
        low = np.concatenate(
            [np.full(gradient.size, -infinite), -gradient, np.full(parts, -infinite)]
        )
        high = np.concatenate([-gradient, np.full(gradient.size, infinite), np.zeros(parts)])
        program = self._set_up(matrix)
        cost = np.zeros(parts + 1)
        cost[-1] = 1.0
        answer = program(g=cost, a=matrix, lba=low, uba=high, lbx=0.0, ubx=infinite)
        if not program.stats()["success"]:
            raise SolverSetupError("no multipliers found: the linear program did not converge")
        solution = np.maximum(answer["x"].full().ravel(), 0.0)
        multipliers = np.zeros(count)
        multipliers[upper] += solution[: upper.size]
        multipliers[lower] -= solution[upper.size : parts]
        return multipliers

    def _set_up(self, matrix: ca.DM) -> ca.Function:
        if self._program is None:
            size = matrix.shape[1]
            structure = {"a": matrix.sparsity(), "h": ca.Sparsity(size, size)}
            options: dict[str, Any] = {"error_on_fail": False, "highs": LP_OPTIONS}
            self._program = ca.conic("multipliers", "highs", structure, options)
        return self._program
