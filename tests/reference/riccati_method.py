"""The interior-point method in Python on CasADi's functions, to the bits of ``c/riccati.c``.

Newton steps come from the Riccati recursion, the barrier parameter from Mehrotra's rule. Where the line
search fails, the Hessian is regularised until a step is accepted. The warm start trusts the guess and takes
a small barrier parameter; where the guess was far off, a cold start takes a large one.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
from tests.reference.line_search import FilterPoint, LineSearchFilter, StepSummary
from tests.reference.riccati_program import ITERATE, STEP, build_program

from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.interface import (
    FEASIBILITY_TOLERANCE,
    SolveResult,
    SolverOptions,
    Stopwatch,
    Termination,
    result_of,
)
from iptm_controller.solvers.riccati.constants import (
    BACKTRACKING,
    COLD_START_BARRIER,
    COLD_START_SAFEGUARD,
    FIRST_REGULARISATION,
    LEAST_REGULARISATION,
    MAX_REGULARISATIONS,
    MAX_TRIALS,
    REGULARISATION_FACTOR,
)
from iptm_core.physics.ops import BufferedFunction
from iptm_core.state import FloatArray

NOWHERE = FilterPoint(math.nan, math.nan, math.inf, math.inf)


class RiccatiMethod:
    """Runs the iteration on functions in shared memory; serves one thread."""

    def __init__(
        self,
        starting_point: BufferedFunction,
        search_direction: BufferedFunction,
        trial_point: BufferedFunction,
    ) -> None:
        """Keep the functions.

        Args:
            starting_point: its results w, s and z are the iterate.
            search_direction: its results are the parts of the step.
            trial_point: works on iterate and parts.
        """
        self._starting_point = starting_point
        self._search_direction = search_direction
        self._trial_point = trial_point
        self._iterate = {name: trial_point.arguments[name] for name in ITERATE}
        self._next = {name: trial_point.results[f"next_{name}"] for name in ITERATE}
        self._inequality_count = trial_point.arguments["s"].size
        self._dynamics_count = trial_point.arguments["lam"].size
        self._best: tuple[FloatArray, FilterPoint] | None = None

    def run(self, guess: FloatArray, parameters: FloatArray, options: SolverOptions) -> SolveResult:
        """Iterate from a warm start; if it does not converge, once more from a cold one.

        Args:
            guess: variables, the present state in front.
            parameters: numbers of the problem.
            options: tolerance, barrier parameter and bounds.

        Returns:
            The optimum; if there is none, the cheapest iterate met that keeps dynamics and limits; if there
            is none either, the last one. The costates belong to the last iterate.
        """
        clock = Stopwatch()
        until_s = time.perf_counter() + (options.deadline_s or math.inf)
        self._best = None
        few = min(options.warm_start_iterations, options.max_iterations)
        point, termination, iterations = self._run_from(
            guess, parameters, options, few, until_s, is_cold=False
        )
        left = options.max_iterations - iterations
        goes_cold = termination in {Termination.ITERATIONS, Termination.STALLED} and left > 0
        if goes_cold:
            point, termination, further = self._run_from(
                guess, parameters, options, left, until_s, is_cold=True
            )
            iterations += further
        variables, point = self._answer(point, termination)
        return result_of(
            termination,
            point.cost,
            point.largest_violation,
            iterations,
            clock,
            variables=variables,
            costates=self._iterate["lam"].copy(),
            cold_starts=int(goes_cold),
        )

    def _run_from(
        self,
        guess: FloatArray,
        parameters: FloatArray,
        options: SolverOptions,
        most_iterations: int,
        until_s: float,
        *,
        is_cold: bool,
    ) -> tuple[FilterPoint, Termination, int]:
        """Iterate from a start; returns where it ended, why, and after how many iterations.

        Args:
            is_cold: take a large barrier parameter, make the slacks of soft limits large enough for the
                guess, and hold later barrier parameters up.
        """
        barrier = COLD_START_BARRIER if is_cold else options.initial_barrier
        safeguard = COLD_START_SAFEGUARD if is_cold else 0.0
        point = self._begin(guess, parameters, barrier, relax=is_cold)
        if not _is_finite(guess, parameters, point):
            np.copyto(self._iterate["w"], guess)
            return NOWHERE, Termination.NOT_FINITE, 0
        search_filter = LineSearchFilter(point)
        delta = 0.0
        iteration = 0
        while True:
            self._keep_best(point)
            summary = self._newton_step(delta)
            error = summary.kkt_error(self._inequality_count, self._dynamics_count)
            if not math.isfinite(error):
                return point, Termination.NOT_FINITE, iteration
            if error <= options.tolerance:
                return point, Termination.CONVERGED, iteration
            if iteration >= most_iterations:
                return point, Termination.ITERATIONS, iteration
            if time.perf_counter() > until_s:
                return point, Termination.DEADLINE, iteration
            moved = self._move(point, summary, delta, search_filter, options.tolerance, safeguard)
            if moved is None:
                return point, Termination.STALLED, iteration
            point, delta = moved
            iteration += 1

    def _answer(
        self, point: FilterPoint, termination: Termination
    ) -> tuple[FloatArray, FilterPoint]:
        """Return variables and point of the last iterate; without an optimum, of the best usable one."""
        if termination is not Termination.CONVERGED and self._best is not None:
            return self._best
        return self._iterate["w"].copy(), point

    def _keep_best(self, point: FilterPoint) -> None:
        """Keep the cheapest usable iterate."""
        if point.largest_violation > FEASIBILITY_TOLERANCE:
            return
        if self._best is None or point.cost < self._best[1].cost:
            self._best = (self._iterate["w"].copy(), point)

    def _begin(
        self, guess: FloatArray, parameters: FloatArray, barrier: float, *, relax: bool
    ) -> FilterPoint:
        given = self._starting_point.arguments
        given["guess"][:] = guess
        given["p"][:] = parameters
        given["mu"][0] = barrier
        given["relax"][0] = float(relax)
        self._iterate["lam"][:] = 0.0
        self._starting_point()
        return FilterPoint(*self._starting_point.results["point"].tolist())

    def _newton_step(self, delta: float) -> StepSummary:
        """Compute the step with a multiple ``delta`` of the identity added to the Hessian."""
        self._search_direction.arguments["delta"][0] = delta
        self._search_direction()
        return StepSummary(*self._search_direction.results["summary"].tolist())

    def _move(
        self,
        point: FilterPoint,
        summary: StepSummary,
        delta: float,
        search_filter: LineSearchFilter,
        tolerance: float,
        safeguard: float,
    ) -> tuple[FilterPoint, float] | None:
        """Move to the next iterate, regularising the Hessian until a step is accepted.

        Args:
            tolerance: optimality error to reach.
            safeguard: lower bound on the barrier parameter, see ``StepSummary.barrier_parameter``.

        Returns:
            The iterate and the regularisation to begin with there; None if no step is accepted.
        """
        for attempt in range(MAX_REGULARISATIONS):
            if attempt > 0:
                delta = max(REGULARISATION_FACTOR * delta, FIRST_REGULARISATION)
                summary = self._newton_step(delta)
            if not summary.is_usable:
                continue
            mu = summary.barrier_parameter(self._inequality_count, tolerance, safeguard)
            trials = self._line_search(point, summary, mu, search_filter)
            if trials is None:
                continue
            if attempt == 0 and trials == 1:
                delta = delta / REGULARISATION_FACTOR if delta > LEAST_REGULARISATION else 0.0
            for name, array in self._iterate.items():
                np.copyto(array, self._next[name])
            return FilterPoint(*self._trial_point.results["point"].tolist()), delta
        return None

    def _line_search(
        self, point: FilterPoint, summary: StepSummary, mu: float, search_filter: LineSearchFilter
    ) -> int | None:
        """Backtrack until a trial point is accepted; return the number of trials, None if none is."""
        self._trial_point.arguments["mu"][0] = mu
        slope = summary.cost_slope_affine + mu * summary.cost_slope_centring
        slope -= mu * (summary.log_slope_affine + mu * summary.log_slope_centring)
        backtracking = 1.0
        for trial in range(1, MAX_TRIALS + 1):
            self._trial_point.arguments["backtracking"][0] = backtracking
            self._trial_point()
            length = float(self._trial_point.results["length"][0])
            there = FilterPoint(*self._trial_point.results["point"].tolist())
            if search_filter.accepts(there, point, mu, slope, length):
                return trial
            backtracking *= BACKTRACKING
        return None


def _is_finite(guess: FloatArray, parameters: FloatArray, point: FilterPoint) -> bool:
    # A sum is finite only if every term is: one cheap look instead of arrays of flags.
    with np.errstate(invalid="ignore"):
        total = float(guess.sum()) + float(parameters.sum())
    return math.isfinite(total + point.cost + point.violation)


class InterpretedRiccati:
    """The method on CasADi's virtual machine; see ``SolverBackend``."""

    name = "riccati"

    def __init__(self, problem: OptimalControlProblem, options: SolverOptions) -> None:
        self.options = options
        starting_point, search_direction, trial_point = build_program(problem)
        # Iterate and step exist once, in the memory of the last function.
        last = BufferedFunction(trial_point)
        iterate = {name: last.arguments[name] for name in (*ITERATE, "p")}
        step = {name: last.arguments[name] for name in STEP}
        self.method = RiccatiMethod(
            starting_point=BufferedFunction(starting_point, iterate),
            search_direction=BufferedFunction(search_direction, {**iterate, **step}),
            trial_point=last,
        )

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        options = self.options
        if most_iterations is not None and most_iterations < options.max_iterations:
            options = replace(options, max_iterations=most_iterations)
        first = guess.copy()
        first[: layout.STATES] = data.initial_state
        return self.method.run(first, data.parameters, options)
