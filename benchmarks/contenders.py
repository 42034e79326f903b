"""Everything that solves recorded problems, behind one call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.clock import Elapsed, timed
from benchmarks.other_solvers import OTHER_SOLVER_NAMES, SqpBackend, build_other_solver
from benchmarks.peer_opti import OptiPeer
from iptm_controller.horizon import Horizon
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.factory import SOLVER_NAMES, build_plain_solver
from iptm_controller.solvers.interface import RICCATI, SolverBackend, SolverOptions
from iptm_core.decision_record import SolveStatus
from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray

PEER = "peer_plain"
PEER_EXPANDED = "peer_expanded"
INTERPRETED = "riccati_interpreted"
PEERS = (PEER, PEER_EXPANDED)
# The order of the tables.
CONTENDER_NAMES = (RICCATI, "fatrop", "ipopt", *OTHER_SOLVER_NAMES[1:], INTERPRETED, *PEERS)


@dataclass(frozen=True)
class Outcome:
    """One solve.

    Attributes:
        converged: by the solver's own word.
        usable: dynamics and limits are kept.
        variables: solution in the controller's order.
        objective: cost.
        iterations: iterations of the solver.
        elapsed: time.
    """

    converged: bool
    usable: bool
    variables: FloatArray
    objective: float
    iterations: int
    elapsed: Elapsed


@dataclass(frozen=True)
class Contender:
    """A solver with a name.

    Attributes:
        name: one of ``CONTENDER_NAMES``.
        solve: solves one problem.
        forget: drops what is carried from solve to solve, at the start of a stretch.
    """

    name: str
    solve: Callable[[ProblemData, FloatArray], Outcome]
    forget: Callable[[], None]


def build_contender(name: str, horizon: Horizon, parameters: ModelParameters) -> Contender:
    """Return a contender for a grid.

    Raises:
        ScenarioError: the name is unknown.
        SolverSetupError: the set-up fails.
    """
    if name in PEERS:
        return _peer(name, horizon, parameters)
    if name not in CONTENDER_NAMES:
        raise ScenarioError(f"contender is '{name}'; allowed: {', '.join(CONTENDER_NAMES)}")
    backend = build_any_solver(name, horizon, parameters)

    def solve(data: ProblemData, guess: FloatArray) -> Outcome:
        result, elapsed = timed(lambda: backend.solve(data, guess))
        return Outcome(
            converged=result.status is SolveStatus.SOLVED,
            usable=result.status.usable,
            variables=result.variables,
            objective=result.objective,
            iterations=result.iterations,
            elapsed=elapsed,
        )

    return Contender(name, solve, backend.forget if isinstance(backend, SqpBackend) else _nothing)


def build_any_solver(name: str, horizon: Horizon, parameters: ModelParameters) -> SolverBackend:
    """Return a solver of the product or one to compare with, by the name of its contender.

    Raises:
        SolverSetupError: the set-up fails.
    """
    if name == INTERPRETED:
        return build_plain_solver(horizon, parameters, SolverOptions(compile_code=False))
    options = SolverOptions(name=name)
    if name in SOLVER_NAMES:
        return build_plain_solver(horizon, parameters, options)
    return build_other_solver(OptimalControlProblem(horizon, parameters), options)


def _peer(name: str, horizon: Horizon, parameters: ModelParameters) -> Contender:
    problem = OptimalControlProblem(horizon, parameters)
    peer = OptiPeer(problem, expand=name == PEER_EXPANDED)

    def solve(data: ProblemData, guess: FloatArray) -> Outcome:
        answer, elapsed = timed(lambda: peer.solve(data, guess))
        return Outcome(
            converged=answer.succeeded,
            usable=answer.succeeded,
            variables=answer.variables,
            objective=answer.objective,
            iterations=answer.iterations,
            elapsed=elapsed,
        )

    return Contender(name, solve, _nothing)


def _nothing() -> None:
    """Do nothing: there is nothing to forget."""
