"""A CasADi ``nlpsol`` on the transcription, compiled where a C compiler is at hand.

What differs between plug-ins (functions looked up, options) comes as data; IPOPT's is here. A time limit
is kept without interrupting the solver: iterations are bounded by what fits, judged by the slowest
recent iteration.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from iptm_controller.ocp import layout
from iptm_controller.ocp.compilation import compile_functions, find_compiler
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.oracle import OracleSignature, oracle_expressions, oracle_functions
from iptm_controller.ocp.problem import OptimalControlProblem, problem_bounds
from iptm_controller.ocp.transcription import transcribe
from iptm_controller.solvers.buffered import BufferedFunction
from iptm_controller.solvers.interface import (
    FEASIBILITY_TOLERANCE,
    STATUS_TEXT,
    SolveResult,
    SolverOptions,
    broken,
)
from iptm_core.decision_record import SolveStatus
from iptm_core.errors import SolverSetupError
from iptm_core.state import FloatArray

LOGGER = logging.getLogger(__name__)
SHORTER_CAPS = (60, 25, 10)
PACE_MEMORY = 0.9
PACE_MARGIN = 1.5
_PROBLEM = (["x", "p"], ["f", "g"])


@dataclass(frozen=True)
class Plugin:
    """What a plug-in of ``nlpsol`` needs.

    Attributes:
        name: name of the back end.
        plugin: name of the CasADi plug-in.
        signature: functions that it looks up in a compiled problem.
        options: from the bound on the iterations to the plug-in's options.
    """

    name: str
    plugin: str
    signature: OracleSignature
    options: Callable[[int], dict[str, Any]]


def ipopt_plugin(options: SolverOptions) -> Plugin:
    """Return IPOPT with the derivatives of the transcription; it does not look at the stage structure."""

    def plugin_options(max_iterations: int) -> dict[str, Any]:
        return {
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "tol": options.tolerance,
                "max_iter": max_iterations,
                "mu_init": options.initial_barrier,
            }
        }

    signature = {
        "nlp_f": ("f",),
        "nlp_g": ("g",),
        "nlp_grad_f": ("f", "grad_f_x"),
        "nlp_jac_g": ("g", "jac_g_x"),
        "nlp_hess_l": ("triu_hess_gamma_x_x",),
    }
    return Plugin("ipopt", "ipopt", signature, plugin_options)


class NlpsolBackend:
    """Solves problem after problem; see ``SolverBackend``."""

    def __init__(
        self,
        plugin: Plugin,
        problem: OptimalControlProblem,
        options: SolverOptions,
    ) -> None:
        """Transcribe a problem and set the plug-in up for it.

        Raises:
            SolverSetupError: the compiler or the plug-in fails.
        """
        self.name = plugin.name
        self._plugin = plugin
        self._bounds = problem_bounds(problem.grid.steps, problem.model.limits)
        transcription = transcribe(problem)
        self._options = options
        compiler = find_compiler() if options.compile_code else None
        self.compiled = compiler is not None
        oracle: Any = (
            oracle_expressions(transcription)
            if compiler is None
            else str(compile_functions(oracle_functions(transcription, plugin.signature), compiler))
        )
        self._solvers = {cap: self._set_up(oracle, cap) for cap in self._caps()}
        self._problem = BufferedFunction(
            ca.external("nlp", oracle) if self.compiled else ca.Function("nlp", oracle, *_PROBLEM)
        )
        bounds = self._bounds
        self._low = np.concatenate([bounds.variables_low, bounds.rows_low])
        self._high = np.concatenate([bounds.variables_high, bounds.rows_high])
        self._iteration_s = 0.0

    def _caps(self) -> tuple[int, ...]:
        longest = self._options.max_iterations
        if self._options.deadline_s <= 0.0:
            return (longest,)
        return (longest, *(cap for cap in SHORTER_CAPS if cap < longest))

    def _set_up(self, oracle: Any, cap: int) -> BufferedFunction:
        options: dict[str, Any] = {
            "print_time": False,
            "record_time": False,
            "error_on_fail": False,
            **self._plugin.options(cap),
        }
        try:
            solver = BufferedFunction(ca.nlpsol("iptm", self._plugin.plugin, oracle, options))
        except RuntimeError as error:
            raise SolverSetupError(f"solver '{self.name}' cannot be set up: {error}") from error
        bounds, given = self._bounds, solver.arguments
        given["lbx"][:], given["ubx"][:] = bounds.variables_low, bounds.variables_high
        given["lbg"][:], given["ubg"][:] = bounds.rows_low, bounds.rows_high
        return solver

    def solve(self, data: ProblemData, guess: FloatArray) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        cap = self._affordable_cap()
        solver = self._solvers[cap]
        start = time.perf_counter()
        if not self._can_start(data, guess):
            message = "data or model are not finite at the initial iterate"
            return broken(guess, time.perf_counter() - start, message)
        self._write(solver.arguments, data, guess)
        try:
            solver()
        except RuntimeError as error:
            last_line = str(error).strip().splitlines()[-1]
            return broken(guess, time.perf_counter() - start, last_line)
        elapsed = time.perf_counter() - start
        stats = solver.stats()
        variables, rows = solver.results["x"].copy(), solver.results["g"]
        self._low[: layout.STATES] = self._high[: layout.STATES] = data.initial_state
        violation = _largest_violation(np.concatenate([variables, rows]), self._low, self._high)
        iterations = int(stats["iter_count"])
        self._note_pace(elapsed, iterations)
        status = self._status(
            succeeded=bool(stats["success"]),
            iterations=iterations,
            cap=cap,
            violation=violation,
            late=0.0 < self._options.deadline_s < elapsed,
        )
        reason = STATUS_TEXT[status]
        if status is not SolveStatus.SOLVED:
            reason = f"{reason} ({self.name}: {stats['return_status']}, {iterations} iterations)"
        return SolveResult(
            status,
            reason,
            variables,
            float(solver.results["f"][0]),
            iterations,
            elapsed,
            violation,
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

    def _affordable_cap(self) -> int:
        """Return the largest bound on the iterations that fits the time limit."""
        caps = sorted(self._solvers)
        deadline_s = self._options.deadline_s
        if deadline_s <= 0.0 or self._iteration_s <= 0.0:
            return caps[-1]
        fitting = [cap for cap in caps if cap * self._iteration_s * PACE_MARGIN <= deadline_s]
        return fitting[-1] if fitting else caps[0]

    def _note_pace(self, elapsed_s: float, iterations: int) -> None:
        """Remember the slowest recent iteration, forgetting it slowly."""
        pace = elapsed_s / max(iterations, 1)
        faded = PACE_MEMORY * self._iteration_s + (1.0 - PACE_MEMORY) * pace
        self._iteration_s = max(pace, faded)

    def _status(
        self, *, succeeded: bool, iterations: int, cap: int, violation: float, late: bool
    ) -> SolveStatus:
        # The negated comparison also catches a violation that is not a number.
        if not violation <= FEASIBILITY_TOLERANCE:
            if late or (iterations >= cap and cap < self._options.max_iterations):
                return SolveStatus.DEADLINE
            if iterations >= cap:
                return SolveStatus.ITERATION_LIMIT
            return SolveStatus.NUMERICAL_ERROR
        return SolveStatus.SOLVED if succeeded else SolveStatus.FEASIBLE


def _largest_violation(values: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """Return the largest violation of the bounds; not a number if one of the values is not."""
    return float(np.max([low - values, values - high], initial=0.0))
