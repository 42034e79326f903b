"""The default back end: the Riccati interior-point method, compiled where a C compiler is at hand."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.interface import (
    RICCATI,
    SolveResult,
    SolverOptions,
    Stopwatch,
    Termination,
    result_of,
)
from iptm_controller.solvers.riccati.machine_code import (
    PROGRAMS_KEPT,
    MachineCode,
    Outcome,
    SwitchingNumbers,
    as_machine_code,
)
from iptm_controller.solvers.riccati.method import RiccatiMethod
from iptm_controller.solvers.riccati.program import ITERATE, STEP, build_program
from iptm_core.physics.ops import BufferedFunction
from iptm_core.state import FloatArray

_TERMINATIONS = tuple(Termination)


class RiccatiBackend:
    """Solves problem after problem, nothing carried over; see ``SolverBackend``.

    Attributes:
        options: settings of the next solve; they may be exchanged in between.
    """

    name = RICCATI

    def __init__(self, problem: OptimalControlProblem, options: SolverOptions) -> None:
        self.options = options
        self._method = as_machine_code(
            problem, is_wanted=options.compile_code
        ) or interpreted_method(problem)

    @property
    def compiled(self) -> bool:
        """True if the method runs as machine code, False on CasADi's virtual machine."""
        return isinstance(self._method, MachineCode)

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        first = _beginning_at(data.initial_state, guess)
        if isinstance(self._method, MachineCode):
            clock = Stopwatch()
            outcome = self._method.solve(first, data.parameters, self.options, most_iterations)
            return _result(outcome, outcome.iterations, clock)
        options = self.options
        if most_iterations is not None and most_iterations < options.max_iterations:
            options = replace(options, max_iterations=most_iterations)
        return self._method.run(first, data.parameters, options)

    def solve_checked(
        self,
        data: ProblemData,
        guess: FloatArray,
        most_iterations: int | None,
        switching: SwitchingNumbers,
        since_second: int,
    ) -> tuple[SolveResult, int]:
        """Do what ``SwitchingCheck`` does, in machine code only.

        Returns:
            The result, and the solves since the last second one.
        """
        if not isinstance(self._method, MachineCode):
            raise TypeError("the check in C is for the method in C")
        clock = Stopwatch()
        outcome, iterations, since_second = self._method.solve_checked(
            _beginning_at(data.initial_state, guess),
            data.parameters,
            self.options,
            most_iterations,
            switching,
            since_second,
        )
        return _result(outcome, iterations, clock), since_second


def interpreted_method(problem: OptimalControlProblem) -> RiccatiMethod:
    """Return the method in Python on CasADi's virtual machine, with the results of the one in C."""
    starting_point, search_direction, trial_point = _program(problem)
    # Iterate and step exist once, in the memory of the last function.
    last = BufferedFunction(trial_point)
    iterate = {name: last.arguments[name] for name in (*ITERATE, "p")}
    step = {name: last.arguments[name] for name in STEP}
    return RiccatiMethod(
        starting_point=BufferedFunction(starting_point, iterate),
        search_direction=BufferedFunction(search_direction, {**iterate, **step}),
        trial_point=last,
    )


_program = lru_cache(maxsize=PROGRAMS_KEPT)(build_program)


def _beginning_at(initial_state: FloatArray, guess: FloatArray) -> FloatArray:
    first = guess.copy()
    first[: layout.STATES] = initial_state
    return first


def _result(outcome: Outcome, iterations: int, clock: Stopwatch) -> SolveResult:
    return result_of(
        _TERMINATIONS[outcome.termination],
        outcome.point.cost,
        outcome.point.largest_violation,
        outcome.iterations,
        clock,
        variables=outcome.variables,
        costates=outcome.costates,
        cold_starts=outcome.cold_starts,
        total_iterations=iterations,
    )
