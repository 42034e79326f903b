"""Everything that solves recorded problems, behind one call."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.clock import Elapsed, timed
from benchmarks.other_solvers import OTHER_SOLVER_NAMES, SqpBackend, build_other_solver
from benchmarks.peer_opti import OptiPeer
from iptm_controller.horizon import Horizon
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.factory import SOLVER_NAMES, build_plain_solver
from iptm_controller.solvers.interface import RICCATI, SolverBackend, SolveResult, SolverOptions
from iptm_core.decision_record import SolveStatus
from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray

PEER = "peer_plain"
PEER_EXPANDED = "peer_expanded"
PEERS = (PEER, PEER_EXPANDED)
INTERPRETED = "riccati_interpreted"
# The order of the tables.
CONTENDER_NAMES = (RICCATI, "fatrop", "ipopt", *OTHER_SOLVER_NAMES[1:], INTERPRETED, *PEERS)


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
