"""What every solver takes and offers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from iptm_controller.ocp.data import ProblemData
from iptm_controller.solvers.result import SolveResult
from iptm_core.state import FloatArray

RICCATI = "riccati"
FEASIBILITY_TOLERANCE = 1e-4
"""Largest violation of a row or bound that a usable iterate may have, scaled units."""


@dataclass(frozen=True)
class SolverOptions:
    """Choice of a solver and its settings.

    Attributes:
        name: name of the back end.
        compile_code: generate and compile C where a compiler is found.
        max_iterations: bound on the iterations of one solve.
        deadline_s: bound on its wall time, 0 for none. With a bound the iterations depend on the
            machine's pace, so runs are no longer exactly repeatable.
        tolerance: optimality tolerance on the scaled problem.
        initial_barrier: first barrier parameter; small, because the guess is a shifted solution.
        warm_start_iterations: iterations after which the Riccati method gives the warm start up and
            starts again with a large barrier parameter, 0 to begin with it; other solvers ignore it.
    """

    name: str = RICCATI
    compile_code: bool = True
    max_iterations: int = 150
    deadline_s: float = 0.0
    tolerance: float = 1e-5
    initial_barrier: float = 1e-4
    warm_start_iterations: int = 20


class SolverBackend(Protocol):
    """Solves the problems of one horizon, one after the other."""

    @property
    def name(self) -> str:
        """Name of the back end, as used in parameters and tables."""

    @property
    def compiled(self) -> bool:
        """True if the problem runs as machine code, False on CasADi's virtual machine."""

    def solve(self, data: ProblemData, guess: FloatArray) -> SolveResult:
        """Solve one problem.

        Args:
            data: numbers of the problem.
            guess: initial iterate in scaled units, order of the grid.

        Returns:
            The outcome; failures are reported in it, nothing is raised.
        """
