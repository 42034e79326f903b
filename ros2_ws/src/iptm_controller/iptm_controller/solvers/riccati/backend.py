"""The default back end: the Riccati interior-point method, compiled where a C compiler is at hand."""

from __future__ import annotations

from dataclasses import replace

from iptm_controller.ocp import layout
from iptm_controller.ocp.compilation import as_machine_code
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.interface import RICCATI, SolveResult, SolverOptions
from iptm_controller.solvers.riccati.method import RiccatiMethod
from iptm_controller.solvers.riccati.program import ITERATE, STEP, build_program
from iptm_core.buffered import BufferedFunction
from iptm_core.state import FloatArray


class RiccatiBackend:
    """Solves problem after problem, nothing carried over; see ``SolverBackend``.

    Attributes:
        options: settings of the next solve; they may be exchanged in between.
    """

    name = RICCATI

    def __init__(self, problem: OptimalControlProblem, options: SolverOptions) -> None:
        self.options = options
        functions, self.compiled = as_machine_code(
            build_program(problem), RICCATI, is_wanted=options.compile_code
        )
        starting_point, search_direction, trial_point = functions
        # Iterate and step exist once, in the memory of the last function.
        last = BufferedFunction(trial_point)
        iterate = {name: last.arguments[name] for name in (*ITERATE, "p")}
        step = {name: last.arguments[name] for name in STEP}
        self._method = RiccatiMethod(
            starting_point=BufferedFunction(starting_point, iterate),
            search_direction=BufferedFunction(search_direction, {**iterate, **step}),
            trial_point=last,
        )

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        first = guess.copy()
        first[: layout.STATES] = data.initial_state
        options = self.options
        if most_iterations is not None and most_iterations < options.max_iterations:
            options = replace(options, max_iterations=most_iterations)
        return self._method.run(first, data.parameters, options)
