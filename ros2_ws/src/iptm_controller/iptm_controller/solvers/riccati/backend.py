"""The default back end: the Riccati interior-point method, compiled where a C compiler is at hand."""

from __future__ import annotations

import time
from dataclasses import replace

from iptm_controller.ocp import layout
from iptm_controller.ocp.compilation import as_machine_code
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.interface import (
    FEASIBILITY_TOLERANCE,
    RICCATI,
    STATUS_TEXT,
    SolveResult,
    SolverOptions,
)
from iptm_controller.solvers.riccati.method import MethodResult, RiccatiMethod, Termination
from iptm_controller.solvers.riccati.program import ITERATE, STEP, RiccatiProgram, build_program
from iptm_core.buffered import BufferedFunction
from iptm_core.decision_record import SolveStatus
from iptm_core.state import FloatArray

_UNUSABLE = {
    Termination.CONVERGED: SolveStatus.NUMERICAL_ERROR,
    Termination.ITERATIONS: SolveStatus.ITERATION_LIMIT,
    Termination.DEADLINE: SolveStatus.DEADLINE,
    Termination.STALLED: SolveStatus.NUMERICAL_ERROR,
    Termination.NOT_FINITE: SolveStatus.NUMERICAL_ERROR,
}


class RiccatiBackend:
    """Solves problem after problem, nothing carried over; see ``SolverBackend``.

    Attributes:
        options: settings of the next solve; they may be exchanged in between.
    """

    name = RICCATI

    def __init__(self, problem: OptimalControlProblem, options: SolverOptions) -> None:
        self.options = options
        functions, self.compiled = as_machine_code(
            build_program(problem).functions, RICCATI, is_wanted=options.compile_code
        )
        self._method = _method(RiccatiProgram(*functions))

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        start = time.perf_counter()
        first = guess.copy()
        first[: layout.STATES] = data.initial_state
        options = self.options
        if most_iterations is not None and most_iterations < options.max_iterations:
            options = replace(options, max_iterations=most_iterations)
        found = self._method.run(first, data.parameters, options)
        status = _status(found)
        reason = STATUS_TEXT[status]
        if status is not SolveStatus.SOLVED:
            reason += f" ({RICCATI}: {found.termination.value}, {found.iterations} iterations)"
        return SolveResult(
            status=status,
            reason=reason,
            variables=found.variables,
            objective=found.objective,
            iterations=found.iterations,
            time_s=time.perf_counter() - start,
            infeasibility=found.infeasibility,
            costates=found.costates,
        )


def _method(program: RiccatiProgram) -> RiccatiMethod:
    """Tie the functions together: iterate and step exist once, in the memory of ``trial_point``."""
    trial_point = BufferedFunction(program.trial_point)
    own = trial_point.arguments
    iterate = {name: own[name] for name in (*ITERATE, "p")}
    step = {name: own[name] for name in STEP}
    return RiccatiMethod(
        starting_point=BufferedFunction(program.starting_point, iterate),
        search_direction=BufferedFunction(program.search_direction, {**iterate, **step}),
        trial_point=trial_point,
    )


def _status(found: MethodResult) -> SolveStatus:
    # The negated comparison also catches a violation that is not a number.
    if not found.infeasibility <= FEASIBILITY_TOLERANCE:
        return _UNUSABLE[found.termination]
    if found.termination is Termination.CONVERGED:
        return SolveStatus.SOLVED
    return SolveStatus.FEASIBLE
