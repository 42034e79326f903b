"""IPOPT on the transcription: the reference solver."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
from studies.speed.transcription import problem_bounds, transcribe

from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.interface import (
    FEASIBILITY_TOLERANCE,
    STATUS_TEXT,
    SolveResult,
    SolverOptions,
    Stopwatch,
    broken,
)
from iptm_core.decision_record import SolveStatus
from iptm_core.errors import SolverSetupError
from iptm_core.physics.ops import BufferedFunction
from iptm_core.state import FloatArray

IPOPT = "ipopt"


class IpoptBackend:
    """Solves problem after problem; see ``SolverBackend``.

    IPOPT takes the derivatives of the transcription and does not look at the stage structure.
    """

    name = IPOPT

    def __init__(self, problem: OptimalControlProblem, options: SolverOptions) -> None:
        self._options = options
        transcription = transcribe(problem)
        oracle: Any = transcription.expressions
        ipopt: dict[str, Any] = {
            "print_level": 0,
            "sb": "yes",
            "tol": options.tolerance,
            "max_iter": options.max_iterations,
            "mu_init": options.initial_barrier,
        }
        if options.deadline_s > 0.0:
            ipopt["max_wall_time"] = options.deadline_s
        settings: dict[str, Any] = {"print_time": False, "record_time": False, IPOPT: ipopt}
        settings["error_on_fail"] = False
        try:
            self._solver = BufferedFunction(ca.nlpsol("iptm", IPOPT, oracle, settings))
        except RuntimeError as error:
            raise SolverSetupError(f"solver '{IPOPT}' cannot be set up: {error}") from error
        bounds, given = problem_bounds(problem.grid.steps, problem.model), self._solver.arguments
        given["lbx"][:], given["ubx"][:] = bounds.variables_low, bounds.variables_high
        given["lbg"][:], given["ubg"][:] = bounds.rows_low, bounds.rows_high
        self._problem = BufferedFunction(ca.Function("nlp", oracle, ["x", "p"], ["f", "g"]))
        self._low = np.concatenate([bounds.variables_low, bounds.rows_low])
        self._high = np.concatenate([bounds.variables_high, bounds.rows_high])

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve one problem; see ``SolverBackend``. The options bound the iterations."""
        del most_iterations
        solver = self._solver
        clock = Stopwatch()
        if not self._can_start(data, guess):
            message = "data or model are not finite at the initial iterate"
            return broken(guess, clock, message)
        self._write(solver.arguments, data, guess)
        try:
            solver()
        except RuntimeError as error:
            last_line = str(error).strip().splitlines()[-1]
            return broken(guess, clock, last_line)
        elapsed = clock.wall_s
        stats = solver.stats()
        variables, rows = solver.results["x"].copy(), solver.results["g"]
        self._low[: layout.STATES] = self._high[: layout.STATES] = data.initial_state
        violation = _largest_violation(np.concatenate([variables, rows]), self._low, self._high)
        iterations = int(stats["iter_count"])
        # The negated comparison also catches a violation that is not a number.
        if not violation <= FEASIBILITY_TOLERANCE:
            status = self._failure(iterations, elapsed)
        else:
            status = SolveStatus.SOLVED if stats["success"] else SolveStatus.FEASIBLE
        reason = STATUS_TEXT[status]
        if status is not SolveStatus.SOLVED:
            reason = f"{reason} ({self.name}: {stats['return_status']}, {iterations} iterations)"
        # The rows of the dynamics are x+ - F, the costates belong to F - x+.
        multipliers = solver.results["lam_g"].reshape(-1, layout.ROWS)
        return SolveResult(
            status=status,
            reason=reason,
            variables=variables,
            objective=float(solver.results["f"][0]),
            iterations=iterations,
            time_s=clock.processor_s,
            wall_time_s=elapsed,
            infeasibility=violation,
            costates=-multipliers[:, : layout.STATES].ravel(),
        )

    def _write(
        self, arguments: dict[str, FloatArray], data: ProblemData, guess: FloatArray
    ) -> None:
        arguments["x0"][:] = guess
        arguments["p"][:] = data.parameters
        for bound in ("lbx", "ubx"):
            arguments[bound][: layout.STATES] = data.initial_state

    def _can_start(self, data: ProblemData, guess: FloatArray) -> bool:
        """Return whether the solver can begin: some regularise forever if the first matrix is not finite."""
        given, results = self._problem.arguments, self._problem.results
        given["x"][:] = guess
        given["x"][: layout.STATES] = data.initial_state
        given["p"][:] = data.parameters
        self._problem()
        # A sum is finite only if every term is: one cheap look instead of four arrays of flags.
        arrays = (given["x"], given["p"], results["f"], results["g"])
        with np.errstate(invalid="ignore"):
            return math.isfinite(sum(float(array.sum()) for array in arrays))

    def _failure(self, iterations: int, elapsed_s: float) -> SolveStatus:
        """Return why a solve ended with an iterate that cannot be used."""
        if 0.0 < self._options.deadline_s < elapsed_s:
            return SolveStatus.DEADLINE
        if iterations >= self._options.max_iterations:
            return SolveStatus.ITERATION_LIMIT
        return SolveStatus.NUMERICAL_ERROR


def _largest_violation(values: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """Return the largest violation of the bounds; not a number if one of the values is not."""
    return float(np.max([low - values, values - high], initial=0.0))
