"""Interior-point back ends of CasADi: Fatrop (structure-exploiting, default) and IPOPT (reference)."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from iptm_controller.ocp import layout
from iptm_controller.ocp.compilation import compile_functions, find_compiler
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.transcription import Transcription, problem_bounds
from iptm_controller.solvers.result import STATUS_TEXT, SolveResult, SolveStatus
from iptm_core.errors import SolverSetupError
from iptm_core.parameters.model import LimitParameters
from iptm_core.state import FloatArray

LOGGER = logging.getLogger(__name__)
FEASIBILITY_TOLERANCE = 1e-4


@dataclass(frozen=True)
class InteriorPointOptions:
    """Settings shared by the interior-point back ends.

    Attributes:
        tolerance: optimality tolerance on the scaled problem.
        max_iterations: bound on the iterations, which bounds the solve time without a clock.
        initial_barrier: first barrier parameter; small, because the guess is a shifted solution.
    """

    tolerance: float = 1e-5
    max_iterations: int = 150
    initial_barrier: float = 1e-4


class InteriorPointBackend:
    """A CasADi ``nlpsol`` on the transcription, compiled where a C compiler is at hand."""

    def __init__(
        self,
        plugin: str,
        transcription: Transcription,
        limits: LimitParameters,
        options: InteriorPointOptions,
        *,
        compile_code: bool = True,
    ) -> None:
        if plugin not in _PLUGIN_OPTIONS:
            raise SolverSetupError(
                f"interior-point solver '{plugin}' is unknown, allowed are "
                f"{', '.join(_PLUGIN_OPTIONS)}"
            )
        self.name = plugin
        self._bounds = problem_bounds(transcription.horizon.steps, limits)
        self._max_iterations = options.max_iterations
        self._rows = ca.Function(
            "rows", [transcription.variables, transcription.parameters], [transcription.rows]
        )
        compiler = find_compiler() if compile_code else None
        if compile_code and compiler is None:
            LOGGER.warning(
                "no C compiler found: the problem runs interpreted, several times slower"
            )
        self.compiled = compiler is not None
        oracle: Any = (
            _expressions(transcription)
            if compiler is None
            else str(compile_functions(_oracle_functions(transcription, plugin), compiler))
        )
        solver_options: dict[str, Any] = {
            "print_time": False,
            "record_time": False,
            "error_on_fail": False,
            **_PLUGIN_OPTIONS[plugin](transcription, options),
        }
        try:
            self._solver = ca.nlpsol("iptm", plugin, oracle, solver_options)
        except RuntimeError as error:
            raise SolverSetupError(f"solver '{plugin}' cannot be set up: {error}") from error

    def solve(self, data: ProblemData, guess: FloatArray) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        bounds = self._bounds
        low, high = bounds.variables_low.copy(), bounds.variables_high.copy()
        low[: layout.STATES] = high[: layout.STATES] = data.initial_state
        start = time.perf_counter()
        try:
            solution = self._solver(
                x0=guess,
                p=data.parameters,
                lbx=low,
                ubx=high,
                lbg=bounds.rows_low,
                ubg=bounds.rows_high,
            )
        except RuntimeError as error:
            last_line = str(error).strip().splitlines()[-1]
            return _broken(guess, time.perf_counter() - start, last_line)
        elapsed = time.perf_counter() - start
        stats = self._solver.stats()
        variables = solution["x"].full().ravel()
        violation = _largest_violation(variables, low, high)
        rows = solution["g"].full().ravel()
        violation = max(violation, _largest_violation(rows, bounds.rows_low, bounds.rows_high))
        iterations = int(stats["iter_count"])
        status = self._status(
            succeeded=bool(stats["success"]), iterations=iterations, violation=violation
        )
        reason = STATUS_TEXT[status]
        if status is not SolveStatus.SOLVED:
            reason = f"{reason} ({self.name}: {stats['return_status']}, {iterations} iterations)"
        return SolveResult(
            status, reason, variables, float(solution["f"]), iterations, elapsed, violation
        )

    def _status(self, *, succeeded: bool, iterations: int, violation: float) -> SolveStatus:
        # The negated comparison also catches a violation that is not a number.
        if not violation <= FEASIBILITY_TOLERANCE:
            if iterations >= self._max_iterations:
                return SolveStatus.ITERATION_LIMIT
            return SolveStatus.NUMERICAL_ERROR
        return SolveStatus.SOLVED if succeeded else SolveStatus.FEASIBLE


def _largest_violation(values: FloatArray, low: FloatArray, high: FloatArray) -> float:
    return float(max(np.max(low - values), np.max(values - high), 0.0))


def _broken(guess: FloatArray, elapsed: float, message: str) -> SolveResult:
    reason = f"{STATUS_TEXT[SolveStatus.NUMERICAL_ERROR]}: {message}"
    return SolveResult(
        SolveStatus.NUMERICAL_ERROR, reason, guess, float("nan"), 0, elapsed, float("inf")
    )


def _fatrop_options(transcription: Transcription, options: InteriorPointOptions) -> dict[str, Any]:
    steps = transcription.horizon.steps
    return {
        "structure_detection": "manual",
        "N": steps,
        "nx": [layout.STATES] * (steps + 1),
        "nu": [layout.INPUTS] * steps + [0],
        "ng": [layout.LIMITS] * steps + [0],
        "equality": ([True] * layout.STATES + [False] * layout.LIMITS) * steps,
        "fatrop": {
            "print_level": 0,
            "tol": options.tolerance,
            "max_iter": options.max_iterations,
            "mu_init": options.initial_barrier,
        },
    }


def _ipopt_options(transcription: Transcription, options: InteriorPointOptions) -> dict[str, Any]:
    del transcription
    return {
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "tol": options.tolerance,
            "max_iter": options.max_iterations,
            "mu_init": options.initial_barrier,
        }
    }


_PLUGIN_OPTIONS = {"fatrop": _fatrop_options, "ipopt": _ipopt_options}


def _expressions(transcription: Transcription) -> dict[str, ca.MX]:
    return {
        "x": transcription.variables,
        "p": transcription.parameters,
        "f": transcription.cost,
        "g": transcription.rows,
    }


def _oracle_functions(transcription: Transcription, plugin: str) -> list[ca.Function]:
    """The functions that ``nlpsol`` looks up by name in a compiled problem, as each plug-in wants them."""
    w, p = transcription.variables, transcription.parameters
    cost, rows = transcription.cost, transcription.rows
    gradient, jacobian = transcription.gradient, transcription.jacobian
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", transcription.row_count)
    hessian = transcription.hessian(lam_f, lam_g)
    lagrangian_gradient = lam_f * gradient + ca.mtimes(jacobian.T, lam_g)
    primal, primal_names = [w, p], ["x", "p"]
    dual, dual_names = [w, p, lam_f, lam_g], ["x", "p", "lam_f", "lam_g"]
    no_parameter_gradient = ca.MX.zeros(p.numel())
    functions = [
        ca.Function("nlp", primal, [cost, rows], primal_names, ["f", "g"]),
        ca.Function("nlp_f", primal, [cost], primal_names, ["f"]),
        ca.Function("nlp_g", primal, [rows], primal_names, ["g"]),
        ca.Function("nlp_jac_g", primal, [rows, jacobian], primal_names, ["g", "jac_g_x"]),
        ca.Function(
            "nlp_grad",
            dual,
            [cost, rows, lagrangian_gradient, no_parameter_gradient],
            dual_names,
            ["f", "g", "grad_gamma_x", "grad_gamma_p"],
        ),
    ]
    if plugin == "fatrop":
        functions += [
            ca.Function("nlp_grad_f", primal, [gradient], primal_names, ["grad_f_x"]),
            ca.Function(
                "nlp_hess_l",
                dual,
                [lagrangian_gradient, hessian],
                dual_names,
                ["grad_gamma_x", "hess_gamma_x_x"],
            ),
        ]
    else:
        functions += [
            ca.Function("nlp_grad_f", primal, [cost, gradient], primal_names, ["f", "grad_f_x"]),
            ca.Function(
                "nlp_hess_l", dual, [ca.triu(hessian)], dual_names, ["triu_hess_gamma_x_x"]
            ),
        ]
    return functions
