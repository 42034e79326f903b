"""What a solver answers: an outcome with a reason, never an exception."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from iptm_core.state import FloatArray


class SolveStatus(IntEnum):
    """Outcome of one solve; the numbers travel in messages and bags."""

    SOLVED = 0
    """Converged to the requested tolerance."""
    FEASIBLE = 1
    """Stopped early (iterations or time), but the iterate keeps dynamics and limits: usable."""
    ITERATION_LIMIT = 2
    """Stopped at the iteration limit with an iterate that cannot be used."""
    DEADLINE = 3
    """Stopped at the time limit with an iterate that cannot be used."""
    NUMERICAL_ERROR = 4
    """The solver broke off (not a number, singular system, internal error)."""

    @property
    def usable(self) -> bool:
        """True if the iterate may be acted on."""
        return self in {SolveStatus.SOLVED, SolveStatus.FEASIBLE}


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
