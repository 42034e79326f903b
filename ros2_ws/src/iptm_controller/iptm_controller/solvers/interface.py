"""Interface of all solvers: the outcome carries a reason and is never an exception."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

import numpy as np

from iptm_controller.ocp.data import ProblemData
from iptm_core.decision_record import SolveStatus
from iptm_core.state import FloatArray

RICCATI = "riccati"
FEASIBILITY_TOLERANCE = 1e-4
"""Largest violation of a row or bound that a usable iterate may have, scaled units."""


@dataclass(frozen=True)
class SolverOptions:
    """Settings of a solver.

    Attributes:
        deadline_s: bound on its wall time, 0 for none. With a bound the iterations depend on the
            machine's pace, so runs are not exactly repeatable.
        tolerance: optimality tolerance on the scaled problem.
        initial_barrier: first barrier parameter; small, because the guess is a shifted solution.
        warm_start_iterations: iterations after which the Riccati method gives the warm start up and
            starts again with a large barrier parameter, 0 to begin with it; other solvers ignore it.
        smoothing_factor: factor on the widths of the smoothed kinks of the model.
        simulate_cooling: simulate other cooling after every solve, and begin again from a cheaper plan.
    """

    max_iterations: int = 150
    deadline_s: float = 0.0
    tolerance: float = 1e-5
    initial_barrier: float = 1e-4
    warm_start_iterations: int = 20
    smoothing_factor: float = 1.0
    simulate_cooling: bool = False


STATUS_TEXT: dict[SolveStatus, str] = {
    SolveStatus.SOLVED: "converged",
    SolveStatus.FEASIBLE: "stopped early with a feasible iterate",
    SolveStatus.ITERATION_LIMIT: "iteration limit reached without a feasible iterate",
    SolveStatus.DEADLINE: "time limit reached without a feasible iterate",
    SolveStatus.NUMERICAL_ERROR: "the solver broke off",
}


@dataclass(frozen=True)
class SolveResult:
    """Result of one solve.

    Attributes:
        variables: last iterate in scaled units, order of the grid; may be unusable.
        objective: cost at the iterate, slack penalties included.
        time_s: processor time of the thread that solved.
        cold_starts: starts with a large barrier parameter, after one that trusted the guess had failed.
        wall_time_s: what passed meanwhile; longer where something else had the processor.
        infeasibility: largest violation of a row or bound at the iterate, scaled units.
        costates: multipliers lam_1 ... lam_N of the dynamics in scaled units, shape (6 N,): the change of
            the cost with the state at the end of each step; empty if the solve broke off.
    """

    status: SolveStatus
    reason: str
    variables: FloatArray
    objective: float
    iterations: int
    time_s: float
    infeasibility: float
    costates: FloatArray = field(default_factory=lambda: np.empty(0))
    wall_time_s: float = math.nan
    cold_starts: int = 0


class Stopwatch:
    """Processor time of this thread and wall time since it was made."""

    def __init__(self) -> None:
        self._processor_s, self._wall_s = time.thread_time(), time.perf_counter()

    @property
    def processor_s(self) -> float:
        """Processor time in seconds."""
        return time.thread_time() - self._processor_s

    @property
    def wall_s(self) -> float:
        """Wall time in seconds."""
        return time.perf_counter() - self._wall_s


def broken(guess: FloatArray, clock: Stopwatch, message: str) -> SolveResult:
    """Return the result of a solve that could not start or broke off: the guess, and why."""
    return SolveResult(
        status=SolveStatus.NUMERICAL_ERROR,
        reason=f"{STATUS_TEXT[SolveStatus.NUMERICAL_ERROR]}: {message}",
        variables=guess,
        objective=math.nan,
        iterations=0,
        time_s=clock.processor_s,
        wall_time_s=clock.wall_s,
        infeasibility=math.inf,
    )


class Termination(Enum):
    """Why the iteration stopped; the second value is the outcome without a usable iterate."""

    CONVERGED = "converged", SolveStatus.NUMERICAL_ERROR
    ITERATIONS = "bound on the iterations", SolveStatus.ITERATION_LIMIT
    DEADLINE = "time limit", SolveStatus.DEADLINE
    STALLED = "no step was accepted", SolveStatus.NUMERICAL_ERROR
    NOT_FINITE = "data, model or step not finite", SolveStatus.NUMERICAL_ERROR

    def status(self, infeasibility: float) -> SolveStatus:
        """Return the outcome of a solve by the largest violation of its iterate."""
        # The negated comparison also catches a violation that is not a number.
        if not infeasibility <= FEASIBILITY_TOLERANCE:
            return self.value[1]
        return SolveStatus.SOLVED if self is Termination.CONVERGED else SolveStatus.FEASIBLE


def result_of(
    termination: Termination,
    cost: float,
    infeasibility: float,
    iterations: int,
    clock: Stopwatch,
    *,
    variables: FloatArray,
    costates: FloatArray,
    cold_starts: int,
    total_iterations: int | None = None,
) -> SolveResult:
    """Return the result of a solve by the Riccati method.

    Args:
        cost: at the iterate that it ended with.
        infeasibility: largest violation there.
        iterations: of this solve.
        total_iterations: including another solve for the same result, None without one.
    """
    status = termination.status(infeasibility)
    reason = STATUS_TEXT[status]
    if status is not SolveStatus.SOLVED:
        reason += f" ({RICCATI}: {termination.value[0]}, {iterations} iterations)"
    return SolveResult(
        status=status,
        reason=reason,
        variables=variables,
        objective=cost,
        iterations=iterations if total_iterations is None else total_iterations,
        time_s=clock.processor_s,
        wall_time_s=clock.wall_s,
        infeasibility=infeasibility,
        costates=costates,
        cold_starts=cold_starts,
    )


class SolverBackend(Protocol):
    """Solves the problems of one horizon, one after the other."""

    @property
    def name(self) -> str:
        """Name of the back end, as used in parameters and tables."""

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve one problem.

        Args:
            guess: initial iterate in scaled units, order of the grid.
            most_iterations: bound on the iterations of this solve, where it is less than the bound of the
                options; back ends that cannot change it between solves keep theirs.

        Returns:
            The outcome; failures are reported in it, nothing is raised.
        """
