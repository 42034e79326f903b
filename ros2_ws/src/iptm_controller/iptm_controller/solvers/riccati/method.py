"""The iteration: a primal-dual interior-point method with filter line search.

Newton steps come from the Riccati recursion; the barrier parameter follows Mehrotra's rule (how far
the step without barrier gets decides how much centring is left). Where the line search fails, the Hessian
is regularised, as in a Levenberg-Marquardt method, until a step is accepted. The first start trusts the
guess and takes a small barrier; where the guess was far off, a second start takes a large one.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from iptm_controller.solvers.budget import FEASIBILITY_TOLERANCE
from iptm_controller.solvers.buffered import BufferedFunction
from iptm_controller.solvers.riccati.program import ITERATE
from iptm_controller.solvers.riccati.report import Report
from iptm_controller.solvers.riccati.search_filter import SearchFilter, Values
from iptm_core.state import FloatArray

SECOND_BARRIER = 10.0
CAUTION = 0.03
SHRINK = 0.3
TRIALS = 3
ATTEMPTS = 12
FIRST_REGULARISATION = 1e-3
REGULARISATION_FACTOR = 8.0
LEAST_REGULARISATION = 1e-5


class Ending(Enum):
    """Why the iteration stopped."""

    CONVERGED = "converged"
    ITERATIONS = "bound on the iterations"
    DEADLINE = "time limit"
    STALLED = "no step was accepted"
    NOT_FINITE = "data, model or step not finite"


@dataclass(frozen=True)
class Outcome:
    """Where the iteration ended.

    Attributes:
        ending: why.
        variables: the optimum; if there is none, the cheapest iterate met that keeps dynamics and
            limits; if there is none either, the last one.
        objective: cost there.
        infeasibility: largest residual there.
        iterations: steps taken.
    """

    ending: Ending
    variables: FloatArray
    objective: float
    infeasibility: float
    iterations: int


@dataclass(frozen=True)
class MethodSettings:
    """Settings of the iteration.

    Attributes:
        tolerance: optimality error to reach.
        initial_barrier: first barrier parameter.
        patience: iterations after which the first start is given up for the second; 0 omits it.
        max_iterations: bound on the iterations of both.
        deadline_s: bound on the wall time, 0 for none.
    """

    tolerance: float
    initial_barrier: float
    patience: int
    max_iterations: int
    deadline_s: float


@dataclass(frozen=True)
class _Start:
    """How to begin: the slacks eased, so that no soft limit is out of reach, or as guessed."""

    barrier: float
    eased: bool
    caution: float
    max_iterations: int


class RiccatiMethod:
    """Runs the iteration on functions in shared memory; serves one thread."""

    def __init__(
        self,
        start: BufferedFunction,
        direction: BufferedFunction,
        advance: BufferedFunction,
        settings: MethodSettings,
    ) -> None:
        """Keep the functions.

        Args:
            start: its results w, s and z are the iterate.
            direction: its results are the parts of the step.
            advance: works on iterate and parts.
            settings: tolerance and bounds.
        """
        self._start, self._direction, self._advance = start, direction, advance
        self._settings = settings
        self._iterate = {name: advance.arguments[name] for name in ITERATE}
        self._next = {name: advance.results[f"next_{name}"] for name in ITERATE}
        self._sides = advance.arguments["s"].size
        self._costates = advance.arguments["lam"].size
        self._best: tuple[FloatArray, Values] | None = None

    def run(self, guess: FloatArray, parameters: FloatArray) -> Outcome:
        """Iterate from a guess; if that leads nowhere, once more from a large barrier.

        Args:
            guess: variables, the present state in front.
            parameters: numbers of the problem.
        """
        settings = self._settings
        until_s = time.perf_counter() + (settings.deadline_s or math.inf)
        self._best = None
        few = min(settings.patience, settings.max_iterations)
        trusting = _Start(settings.initial_barrier, eased=False, caution=0.0, max_iterations=few)
        first = self._run_from(trusting, guess, parameters, until_s)
        left = settings.max_iterations - first.iterations
        if first.ending not in {Ending.ITERATIONS, Ending.STALLED} or left <= 0:
            return self._with_best(first)
        wary = _Start(SECOND_BARRIER, eased=True, caution=CAUTION, max_iterations=left)
        second = self._run_from(wary, guess, parameters, until_s)
        total = first.iterations + second.iterations
        return self._with_best(replace(second, iterations=total))

    def _with_best(self, outcome: Outcome) -> Outcome:
        """An outcome that did not converge, with the best usable iterate met on the way."""
        best = self._best
        if outcome.ending is Ending.CONVERGED or best is None:
            return outcome
        variables, values = best
        return replace(
            outcome,
            variables=variables,
            objective=values.cost,
            infeasibility=values.largest_residual,
        )

    def _run_from(
        self, start: _Start, guess: FloatArray, parameters: FloatArray, until_s: float
    ) -> Outcome:
        values = self._begin(start, guess, parameters)
        if not _is_finite(guess, parameters, values):
            return Outcome(Ending.NOT_FINITE, guess, math.nan, math.inf, 0)
        accepted = SearchFilter(values)
        delta = 0.0
        iteration = 0
        while True:
            self._remember(values)
            report = self._find_direction(delta)
            error = report.error(self._sides, self._costates)
            if not math.isfinite(error):
                ending = Ending.NOT_FINITE
            elif error <= self._settings.tolerance:
                ending = Ending.CONVERGED
            elif iteration >= start.max_iterations:
                ending = Ending.ITERATIONS
            elif time.perf_counter() > until_s:
                ending = Ending.DEADLINE
            else:
                step = self._step(values, report, delta, accepted, start.caution)
                if step is not None:
                    values, delta = step
                    iteration += 1
                    continue
                ending = Ending.STALLED
            return Outcome(
                ending,
                self._iterate["w"].copy(),
                values.cost,
                values.largest_residual,
                iteration,
            )

    def _remember(self, values: Values) -> None:
        """Keep the cheapest usable iterate."""
        if values.largest_residual > FEASIBILITY_TOLERANCE:
            return
        if self._best is None or values.cost < self._best[1].cost:
            self._best = (self._iterate["w"].copy(), values)

    def _begin(self, start: _Start, guess: FloatArray, parameters: FloatArray) -> Values:
        given = self._start.arguments
        given["guess"][:] = guess
        given["p"][:] = parameters
        given["mu"][0] = start.barrier
        given["ease"][0] = float(start.eased)
        self._iterate["lam"][:] = 0.0
        self._start()
        return Values(*self._start.results["values"].tolist())

    def _find_direction(self, delta: float) -> Report:
        self._direction.arguments["delta"][0] = delta
        self._direction()
        return Report(*self._direction.results["report"].tolist())

    def _step(
        self,
        values: Values,
        report: Report,
        delta: float,
        accepted: SearchFilter,
        caution: float,
    ) -> tuple[Values, float] | None:
        """Move to the next iterate; its values and regularisation, or None if no step is accepted."""
        for attempt in range(ATTEMPTS):
            if attempt > 0:
                delta = max(REGULARISATION_FACTOR * delta, FIRST_REGULARISATION)
                report = self._find_direction(delta)
            if not report.leads_somewhere:
                continue
            mu = report.barrier(self._sides, self._settings.tolerance, caution)
            trials = self._search(values, report, mu, accepted)
            if trials is None:
                continue
            if attempt == 0 and trials == 1:
                delta = delta / REGULARISATION_FACTOR if delta > LEAST_REGULARISATION else 0.0
            for name, array in self._iterate.items():
                np.copyto(array, self._next[name])
            return Values(*self._advance.results["values"].tolist()), delta
        return None

    def _search(
        self, values: Values, report: Report, mu: float, accepted: SearchFilter
    ) -> int | None:
        """Try shorter and shorter steps; the number of trials, or None if none is accepted."""
        self._advance.arguments["mu"][0] = mu
        slope = report.slope_pull + mu * report.slope_centring
        slope -= mu * (report.log_slope_pull + mu * report.log_slope_centring)
        shrink = 1.0
        for trial in range(1, TRIALS + 1):
            self._advance.arguments["shrink"][0] = shrink
            self._advance()
            length = float(self._advance.results["length"][0])
            there = Values(*self._advance.results["values"].tolist())
            if accepted.accepts(there, values, mu, slope, length):
                return trial
            shrink *= SHRINK
        return None


def _is_finite(guess: FloatArray, parameters: FloatArray, values: Values) -> bool:
    # A sum is finite only if every term is: one cheap look instead of arrays of flags.
    with np.errstate(invalid="ignore"):
        total = float(guess.sum()) + float(parameters.sum())
    return math.isfinite(total + values.cost + values.residual)
