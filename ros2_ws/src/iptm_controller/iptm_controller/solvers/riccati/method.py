"""The iteration: a primal-dual interior-point method with a filter line search.

Newton steps come from the Riccati recursion, the barrier parameter from Mehrotra's rule. Where the line
search fails, the Hessian is regularised until a step is accepted. The warm start trusts the guess and takes
a small barrier parameter; where the guess was far off, a cold start takes a large one.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from iptm_controller.solvers.interface import FEASIBILITY_TOLERANCE, SolverOptions
from iptm_controller.solvers.riccati.line_search import FilterPoint, LineSearchFilter
from iptm_controller.solvers.riccati.program import ITERATE
from iptm_controller.solvers.riccati.step_summary import StepSummary
from iptm_core.buffered import BufferedFunction
from iptm_core.state import FloatArray

COLD_START_BARRIER = 10.0
COLD_START_SAFEGUARD = 0.03
BACKTRACKING = 0.3
MAX_TRIALS = 3
MAX_REGULARISATIONS = 12
FIRST_REGULARISATION = 1e-3
REGULARISATION_FACTOR = 8.0
LEAST_REGULARISATION = 1e-5


class Termination(Enum):
    """Why the iteration stopped."""

    CONVERGED = "converged"
    ITERATIONS = "bound on the iterations"
    DEADLINE = "time limit"
    STALLED = "no step was accepted"
    NOT_FINITE = "data, model or step not finite"


@dataclass(frozen=True)
class MethodResult:
    """Where the iteration ended.

    Attributes:
        variables: the optimum; if there is none, the cheapest iterate met that keeps dynamics and
            limits; if there is none either, the last one.
        costates: multipliers of the dynamics at the last iterate.
    """

    termination: Termination
    variables: FloatArray
    objective: float
    infeasibility: float
    iterations: int
    costates: FloatArray


@dataclass(frozen=True)
class StartSettings:
    """How to begin, and when to stop.

    Attributes:
        tolerance: optimality error to reach.
        barrier: first barrier parameter.
        relax: make the slacks of soft limits large enough for the guess.
        safeguard: lower bound on later barrier parameters, see ``StepSummary.barrier_parameter``.
        max_iterations: bound on the iterations from this start.
    """

    tolerance: float
    barrier: float
    relax: bool
    safeguard: float
    max_iterations: int


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

    def run(
        self, guess: FloatArray, parameters: FloatArray, options: SolverOptions
    ) -> MethodResult:
        """Iterate from a warm start; if it does not converge, once more from a cold one.

        Args:
            guess: variables, the present state in front.
            parameters: numbers of the problem.
            options: tolerance, barrier parameter and bounds.
        """
        until_s = time.perf_counter() + (options.deadline_s or math.inf)
        self._best = None
        few = min(options.warm_start_iterations, options.max_iterations)
        warm = StartSettings(
            options.tolerance,
            options.initial_barrier,
            relax=False,
            safeguard=0.0,
            max_iterations=few,
        )
        first = self._run_from(warm, guess, parameters, until_s)
        left = options.max_iterations - first.iterations
        if first.termination not in {Termination.ITERATIONS, Termination.STALLED} or left <= 0:
            return self._with_best(first)
        cold = StartSettings(
            options.tolerance,
            COLD_START_BARRIER,
            relax=True,
            safeguard=COLD_START_SAFEGUARD,
            max_iterations=left,
        )
        second = self._run_from(cold, guess, parameters, until_s)
        total = first.iterations + second.iterations
        return self._with_best(replace(second, iterations=total))

    def _with_best(self, result: MethodResult) -> MethodResult:
        """Return a result that did not converge with the best usable iterate met on the way."""
        best = self._best
        if result.termination is Termination.CONVERGED or best is None:
            return result
        variables, point = best
        return replace(
            result, variables=variables, objective=point.cost, infeasibility=point.largest_violation
        )

    def _run_from(
        self, start: StartSettings, guess: FloatArray, parameters: FloatArray, until_s: float
    ) -> MethodResult:
        point = self._begin(start, guess, parameters)
        if not _is_finite(guess, parameters, point):
            return MethodResult(
                Termination.NOT_FINITE, guess, math.nan, math.inf, 0, self._iterate["lam"].copy()
            )
        search_filter = LineSearchFilter(point)
        delta = 0.0
        iteration = 0
        while True:
            self._keep_best(point)
            summary = self._newton_step(delta)
            error = summary.kkt_error(self._inequality_count, self._dynamics_count)
            if not math.isfinite(error):
                termination = Termination.NOT_FINITE
            elif error <= start.tolerance:
                termination = Termination.CONVERGED
            elif iteration >= start.max_iterations:
                termination = Termination.ITERATIONS
            elif time.perf_counter() > until_s:
                termination = Termination.DEADLINE
            else:
                moved = self._move(point, summary, delta, search_filter, start)
                if moved is not None:
                    point, delta = moved
                    iteration += 1
                    continue
                termination = Termination.STALLED
            return MethodResult(
                termination,
                self._iterate["w"].copy(),
                point.cost,
                point.largest_violation,
                iteration,
                self._iterate["lam"].copy(),
            )

    def _keep_best(self, point: FilterPoint) -> None:
        """Keep the cheapest usable iterate."""
        if point.largest_violation > FEASIBILITY_TOLERANCE:
            return
        if self._best is None or point.cost < self._best[1].cost:
            self._best = (self._iterate["w"].copy(), point)

    def _begin(
        self, start: StartSettings, guess: FloatArray, parameters: FloatArray
    ) -> FilterPoint:
        given = self._starting_point.arguments
        given["guess"][:] = guess
        given["p"][:] = parameters
        given["mu"][0] = start.barrier
        given["relax"][0] = float(start.relax)
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
        start: StartSettings,
    ) -> tuple[FilterPoint, float] | None:
        """Move to the next iterate, regularising the Hessian until a step is accepted.

        Returns:
            The iterate and the regularisation to begin with there; None if no step is accepted.
        """
        for attempt in range(MAX_REGULARISATIONS):
            if attempt > 0:
                delta = max(REGULARISATION_FACTOR * delta, FIRST_REGULARISATION)
                summary = self._newton_step(delta)
            if not summary.is_usable:
                continue
            mu = summary.barrier_parameter(self._inequality_count, start.tolerance, start.safeguard)
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
