"""A solver that fails on demand, and a controller wrapper that passes it the time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace

from iptm.faults.fault import Fault, at_places
from iptm.faults.kinds import FaultKind, FaultPlace
from iptm_controller.controller import Controller
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.ocp.data import ProblemData
from iptm_controller.solvers.interface import (
    STATUS_TEXT,
    SolverBackend,
    SolveResult,
    Stopwatch,
    broken,
)
from iptm_core.decision_record import SolveStatus
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import NS_PER_S, FloatArray

_STATUS = {
    FaultKind.SOLVER_TIMEOUT: SolveStatus.DEADLINE,
    FaultKind.SOLVER_NOT_CONVERGED: SolveStatus.ITERATION_LIMIT,
}


class FaultySolver:
    """A back end that does not answer as it should while a fault hits.

    Attributes:
        now_ns: trip time of the problem that is solved next.
    """

    def __init__(
        self,
        inner: SolverBackend,
        faults: Iterable[Fault],
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._inner = inner
        self._faults = at_places(faults, FaultPlace.SOLVER)
        self._sleep = sleep
        self.now_ns = 0

    @property
    def name(self) -> str:
        """Name of the wrapped back end."""
        return self._inner.name

    @property
    def compiled(self) -> bool:
        """Whether the wrapped back end runs machine code."""
        return self._inner.compiled

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve one problem, or fail to; see ``SolverBackend``.

        Raises:
            RuntimeError: a fault of the kind ``solver_exception`` hits.
        """
        for fault in self._faults:
            if not fault.hits(self.now_ns):
                continue
            if fault.kind is FaultKind.SOLVER_EXCEPTION:
                raise RuntimeError("exception of the solver, asked for by a fault")
            spent_s = fault.magnitude if fault.kind is FaultKind.SOLVER_TIMEOUT else 0.0
            self._sleep(spent_s)
            status = _STATUS[fault.kind]
            failed = broken(guess, Stopwatch(), "asked for by a fault")
            return replace(
                failed,
                status=status,
                reason=STATUS_TEXT[status],
                time_s=spent_s,
                wall_time_s=spent_s,
            )
        return self._inner.solve(data, guess, most_iterations=most_iterations)


class FaultyController(Controller):
    """The controller, with a solver that fails on demand."""

    def __init__(
        self,
        parameters: ModelParameters,
        sound: Controller,
        faults: Iterable[Fault],
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._solver = FaultySolver(sound.backend, faults, sleep)
        super().__init__(parameters, sound.options, self._solver)

    def decide(self, measured: Measurements) -> Decision:
        """Decide one tick."""
        if measured.state is not None:
            self._solver.now_ns = round(measured.state.time_s * NS_PER_S)
        return super().decide(measured)
