"""The interface of a solver back end."""

from __future__ import annotations

from typing import Protocol

from iptm_controller.ocp.data import ProblemData
from iptm_controller.solvers.result import SolveResult
from iptm_core.state import FloatArray


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
            guess: initial iterate in scaled units, order of the transcription.

        Returns:
            The outcome; failures are reported in it, nothing is raised.
        """
