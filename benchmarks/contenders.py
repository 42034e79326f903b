"""Everything that solves recorded problems, behind one call: the product's solvers, the peers and others.

The others are Fatrop, and sequential quadratic programming with three QP solvers. They solve the same
transcription as the product's IPOPT. SQP makes the stage Hessians convex by clipping their eigenvalues
and carries its multipliers from solve to solve.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.harness import Elapsed, timed
from benchmarks.peer_opti import OptiPeer
from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.factory import SOLVER_NAMES, build_plain_solver
from iptm_controller.solvers.interface import RICCATI, SolverBackend, SolveResult, SolverOptions
from iptm_controller.solvers.nlpsol_backend import NlpsolBackend, Plugin
from iptm_core.decision_record import SolveStatus
from iptm_core.errors import ScenarioError, SolverSetupError
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray

FATROP = "fatrop"
QP_SOLVERS: dict[str, dict[str, Any]] = {
    "piqp": {},
    "hpipm": {"hpipm": {"iter_max": 50}},
    "daqp": {},
}
"""Quadratic programming solvers by name, with their options."""
OTHER_SOLVER_NAMES = (FATROP, *(f"sqp_{qp_solver}" for qp_solver in QP_SOLVERS))
SQP_DUAL_TOLERANCE = 1e-4
SQP_PRIMAL_TOLERANCE = 1e-6
SQP_SMALLEST_EIGENVALUE = 1e-6
PEER = "peer_plain"
PEER_EXPANDED = "peer_expanded"
PEERS = (PEER, PEER_EXPANDED)
INTERPRETED = "riccati_interpreted"
# The order of the tables.
CONTENDER_NAMES = (RICCATI, "fatrop", "ipopt", *OTHER_SOLVER_NAMES[1:], INTERPRETED, *PEERS)


class SqpBackend(NlpsolBackend):
    """An SQP method that starts from the multipliers of the previous solve."""

    def solve(self, data: ProblemData, guess: FloatArray) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        result = super().solve(data, guess)
        solver = self._solver
        for start, found in (("lam_x0", "lam_x"), ("lam_g0", "lam_g")):
            keep = result.status is SolveStatus.SOLVED
            solver.arguments[start][:] = solver.results[found] if keep else 0.0
        return result

    def forget(self) -> None:
        """Drop the multipliers, as at the start of a trip."""
        for start in ("lam_x0", "lam_g0"):
            self._solver.arguments[start][:] = 0.0


def build_other_solver(problem: OptimalControlProblem, options: SolverOptions) -> NlpsolBackend:
    """Return a solver that is not part of the product.

    Raises:
        SolverSetupError: unknown name, or the set-up fails.
    """
    if options.name == FATROP:
        return NlpsolBackend(_fatrop_plugin(problem.grid.steps, options), problem, options)
    if options.name in OTHER_SOLVER_NAMES:
        plugin = _sqp_plugin(options.name.removeprefix("sqp_"), options.max_iterations)
        return SqpBackend(plugin, problem, options)
    raise SolverSetupError(f"solver is '{options.name}'; allowed: {', '.join(OTHER_SOLVER_NAMES)}")


def _fatrop_plugin(steps: int, options: SolverOptions) -> Plugin:
    """Return Fatrop with the stage structure of a horizon."""
    settings: dict[str, Any] = {
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
    signature = {
        "nlp_f": ("f",),
        "nlp_g": ("g",),
        "nlp_grad_f": ("grad_f_x",),
        "nlp_jac_g": ("g", "jac_g_x"),
        "nlp_hess_l": ("grad_gamma_x", "hess_gamma_x_x"),
    }
    return Plugin(FATROP, FATROP, signature, settings)


def _sqp_plugin(qp_solver: str, max_iterations: int) -> Plugin:
    """Return CasADi's SQP method with one of ``QP_SOLVERS``."""
    settings: dict[str, Any] = {
        "qpsol": qp_solver,
        "qpsol_options": {"error_on_fail": False, "print_time": False, **QP_SOLVERS[qp_solver]},
        "convexify_strategy": "eigen-clip",
        "convexify_margin": SQP_SMALLEST_EIGENVALUE,
        "tol_du": SQP_DUAL_TOLERANCE,
        "tol_pr": SQP_PRIMAL_TOLERANCE,
        "max_iter": max_iterations,
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
    }
    signature = {
        "nlp_fg": ("f", "g"),
        "nlp_jac_fg": ("f", "grad_f_x", "g", "jac_g_x"),
        "nlp_hess_l": ("hess_gamma_x_x",),
    }
    return Plugin(f"sqp_{qp_solver}", "sqpmethod", signature, settings)


@dataclass(frozen=True)
class TimedSolve:
    """One solve with its time."""

    result: SolveResult
    elapsed: Elapsed

    @property
    def converged(self) -> bool:
        """By the solver's own word."""
        return self.result.status is SolveStatus.SOLVED


@dataclass(frozen=True)
class Contender:
    """A solver with a name of ``CONTENDER_NAMES``."""

    name: str
    backend: SolverBackend

    def solve(self, data: ProblemData, guess: FloatArray) -> TimedSolve:
        """Solve one problem."""
        result, elapsed = timed(lambda: self.backend.solve(data, guess))
        return TimedSolve(result, elapsed)

    def forget(self) -> None:
        """Drop what is carried from solve to solve, as at the start of a stretch."""
        if isinstance(self.backend, SqpBackend):
            self.backend.forget()


def build_contender(name: str, horizon: Horizon, parameters: ModelParameters) -> Contender:
    """Return a contender for a grid.

    Raises:
        ScenarioError: the name is unknown.
        SolverSetupError: the set-up fails.
    """
    problem = OptimalControlProblem(horizon, parameters)
    backend: SolverBackend
    if name in PEERS:
        backend = OptiPeer(problem, expand=name == PEER_EXPANDED)
    elif name == INTERPRETED:
        backend = build_plain_solver(horizon, parameters, SolverOptions(compile_code=False))
    elif name in SOLVER_NAMES:
        backend = build_plain_solver(horizon, parameters, SolverOptions(name=name))
    elif name in OTHER_SOLVER_NAMES:
        backend = build_other_solver(problem, SolverOptions(name=name))
    else:
        raise ScenarioError(f"contender is '{name}'; allowed: {', '.join(CONTENDER_NAMES)}")
    return Contender(name, backend)
