"""What a solver answers: an outcome with a reason, never an exception."""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_core.decision_record import SolveStatus
from iptm_core.state import FloatArray

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
        status: outcome.
        reason: one readable sentence.
        variables: last iterate in scaled units, order of the transcription; may be unusable.
        objective: cost at the iterate, slack penalties included.
        iterations: iterations of the solver.
        time_s: wall time of the solve.
        infeasibility: largest violation of a row or bound at the iterate, scaled units.
    """

    status: SolveStatus
    reason: str
    variables: FloatArray
    objective: float
    iterations: int
    time_s: float
    infeasibility: float


def broken(guess: FloatArray, time_s: float, message: str) -> SolveResult:
    """The result of a solve that could not even start or broke off: the guess, and why."""
    return SolveResult(
        status=SolveStatus.NUMERICAL_ERROR,
        reason=f"{STATUS_TEXT[SolveStatus.NUMERICAL_ERROR]}: {message}",
        variables=guess,
        objective=math.nan,
        iterations=0,
        time_s=time_s,
        infeasibility=math.inf,
    )
