"""The default back end: the Riccati interior-point method, compiled where a C compiler is at hand."""

from __future__ import annotations

import time
from collections.abc import Sequence

import casadi as ca

from iptm_controller.ocp import layout
from iptm_controller.ocp.compilation import compile_functions, find_compiler
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.budget import FEASIBILITY_TOLERANCE, SolveBudget
from iptm_controller.solvers.buffered import BufferedFunction
from iptm_controller.solvers.interior_point import InteriorPointOptions
from iptm_controller.solvers.result import STATUS_TEXT, SolveResult, SolveStatus
from iptm_controller.solvers.riccati.method import Ending, MethodSettings, Outcome, RiccatiMethod
from iptm_controller.solvers.riccati.program import ITERATE, STEP, RiccatiProgram, build_program
from iptm_core.errors import SolverSetupError
from iptm_core.state import FloatArray

RICCATI = "riccati"
_UNUSABLE = {
    Ending.CONVERGED: SolveStatus.NUMERICAL_ERROR,
    Ending.ITERATIONS: SolveStatus.ITERATION_LIMIT,
    Ending.DEADLINE: SolveStatus.DEADLINE,
    Ending.STALLED: SolveStatus.NUMERICAL_ERROR,
    Ending.NOT_FINITE: SolveStatus.NUMERICAL_ERROR,
}


class RiccatiBackend:
    """Solves problem after problem, nothing carried over; see ``SolverBackend``."""

    name = RICCATI

    def __init__(
        self,
        problem: OptimalControlProblem,
        options: InteriorPointOptions,
        budget: SolveBudget,
        *,
        compile_code: bool = True,
    ) -> None:
        """Write the method down for a problem and compile it.

        Raises:
            SolverSetupError: the compiler fails.
        """
        compiler = find_compiler() if compile_code else None
        self.compiled = compiler is not None
        program = build_program(problem)
        if compiler is not None:
            library = str(compile_functions(program.functions, compiler))
            program = _load(library, [function.name() for function in program.functions])
        settings = MethodSettings(
            options.tolerance,
            options.initial_barrier,
            options.patience,
            budget.max_iterations,
            budget.deadline_s,
        )
        self._method = _method(program, settings)

    def solve(self, data: ProblemData, guess: FloatArray) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        start = time.perf_counter()
        first = guess.copy()
        first[: layout.STATES] = data.initial_state
        outcome = self._method.run(first, data.parameters)
        status = _status(outcome)
        reason = STATUS_TEXT[status]
        if status is not SolveStatus.SOLVED:
            reason += f" ({RICCATI}: {outcome.ending.value}, {outcome.iterations} iterations)"
        return SolveResult(
            status=status,
            reason=reason,
            variables=outcome.variables,
            objective=outcome.objective,
            iterations=outcome.iterations,
            time_s=time.perf_counter() - start,
            infeasibility=outcome.infeasibility,
        )


def _load(library: str, names: Sequence[str]) -> RiccatiProgram:
    try:
        return RiccatiProgram(*(ca.external(name, library) for name in names))
    except RuntimeError as error:
        last = str(error).strip().splitlines()[-1]
        raise SolverSetupError(f"solver '{RICCATI}' cannot be set up: {last}") from error


def _method(program: RiccatiProgram, settings: MethodSettings) -> RiccatiMethod:
    """Tie the functions together: iterate and step exist once, in the memory of ``advance``."""
    advance = BufferedFunction(program.advance)
    own = advance.arguments
    iterate = {name: own[name] for name in (*ITERATE, "p")}
    return RiccatiMethod(
        start=BufferedFunction(program.start, iterate),
        direction=BufferedFunction(
            program.direction, {name: own[name] for name in (*iterate, *STEP)}
        ),
        advance=advance,
        settings=settings,
    )


def _status(outcome: Outcome) -> SolveStatus:
    # The negated comparison also catches a violation that is not a number.
    if not outcome.infeasibility <= FEASIBILITY_TOLERANCE:
        return _UNUSABLE[outcome.ending]
    if outcome.ending is Ending.CONVERGED:
        return SolveStatus.SOLVED
    return SolveStatus.FEASIBLE
