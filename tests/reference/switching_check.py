"""The second start of ``c/switching.c`` in Python, to the same bits; see ``SwitchingCheck``."""

from __future__ import annotations

from dataclasses import astuple, replace

import casadi as ca
import numpy as np
from studies.speed.transcription import stage_arguments
from tests.reference.cooling_search import CoolingSearch, ordered_sum

from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import GlobalIndex, InputIndex, StateIndex, StepIndex
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.interface import SolverBackend, SolveResult, SolverOptions, Stopwatch
from iptm_controller.solvers.riccati.backend import SwitchingNumbers
from iptm_controller.solvers.switching_check import (
    AT_LIMIT_K,
    DISTINCT_POWER_KW,
    FULL_SHARE,
    LEAST_GAIN,
    PROMISING_SHARE,
    RUNNING_SHARE,
    SECOND_ITERATIONS,
)
from iptm_core.physics.ops import BufferedFunction, named_function
from iptm_core.state import FloatArray

_TEMPERATURE_OFFSET_K = float(layout.STATE_OFFSET[StateIndex.CELL_1_TEMPERATURE])


class SwitchingCheckInPython:
    """Wraps any back end.

    Attributes:
        since_second: solves since the last one with a second start, None before the first solve.
    """

    def __init__(
        self, inner: SolverBackend, problem: OptimalControlProblem, numbers: SwitchingNumbers
    ) -> None:
        self._inner = inner
        self._grid = problem.grid
        self._lengths_s = self._grid.horizon.step_lengths_s
        self._rate_slots = [
            place.start + StepIndex.COMPRESSOR_INTERVAL for place in self._grid.step_parameters
        ]
        self._rate_1_s = numbers.rate_1_s
        self._slack_prices = np.outer(self._lengths_s, astuple(problem.penalties))
        self._candidates = np.array(numbers.candidates)[:, None]
        self._try_every = numbers.try_every
        self._warm_iterations = SolverOptions.warm_start_iterations
        self.since_second: int | None = None
        self._search = CoolingSearch(problem, numbers) if numbers.simulates else None
        self._hamiltonian = BufferedFunction(_hamiltonians(problem, len(self._candidates) + 1))
        # Own and candidate powers, and their Hamiltonians, in the memory of the function.
        shape = (len(self._candidates) + 1, self._grid.steps)
        self._options = self._hamiltonian.arguments["powers"].reshape(shape)
        self._values = self._hamiltonian.results["hamiltonians"].reshape(shape)

    @property
    def _since_second(self) -> int:
        return self._try_every if self.since_second is None else self.since_second

    @property
    def name(self) -> str:
        """Name of the wrapped back end."""
        return self._inner.name

    def solve(
        self, data: ProblemData, guess: FloatArray, *, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        clock = Stopwatch()
        first = self._inner.solve(data, guess, most_iterations=most_iterations)
        usable = first.status.usable
        powers = (
            self._better_powers(first, data)
            if usable
            else np.full(self._grid.steps, self._candidates[-1, 0])
        )
        self.since_second = self._since_second + 1
        if powers is None:
            return replace(first, time_s=clock.processor_s, wall_time_s=clock.wall_s)
        self.since_second = 0
        start = self._with_powers(first.variables if usable else guess, powers, data)
        most = SECOND_ITERATIONS if usable else most_iterations
        if first.cold_starts and self._warm_iterations:
            # One cold start a tick: where the first solve needed it, the second ends with the warm start.
            most = self._warm_iterations if most is None else min(most, self._warm_iterations)
        second = self._inner.solve(data, start, most_iterations=most)
        better = second if _is_better(second, first) else first
        return replace(
            better,
            iterations=first.iterations + second.iterations,
            time_s=clock.processor_s,
            wall_time_s=clock.wall_s,
        )

    def _better_powers(self, result: SolveResult, data: ProblemData) -> FloatArray | None:
        """Return the powers for a second start, None if the expected gain is too small."""
        variables = result.variables
        table = variables[: -layout.STATES].reshape(-1, layout.BLOCK)
        own = table[:, layout.STATES + InputIndex.COMPRESSOR_POWER]
        # A power is only reached through the ramp; what the ramp leaves of a candidate is judged.
        last = data.initial_state[StateIndex.LAST_COMPRESSOR_POWER]
        reach = self._ramps(data).cumsum()
        self._options[0] = own
        np.maximum(self._candidates, last - reach, out=self._options[1:])
        np.minimum(self._options[1:], last + reach, out=self._options[1:])
        given = self._hamiltonian.arguments
        given["w"][:] = variables
        given["p"][:] = data.parameters
        given["lam"][:] = result.costates
        self._hamiltonian()
        due = self._since_second >= self._try_every
        coldest_k = _TEMPERATURE_OFFSET_K + min(
            float(table[1:, StateIndex.CELL_1_TEMPERATURE].min()),
            float(variables[StateIndex.CELL_1_TEMPERATURE - layout.STATES]),
        )
        if coldest_k < data.parameters[GlobalIndex.LOWEST_TEMPERATURE] + AT_LIMIT_K:
            # The costates include the penalty below the limit and are not valid for less cooling.
            tried = self._concentrated(own, self._values) if due else None
            return self._cheaper_powers(variables, data, tried)
        alike = np.abs(self._options[1:] - own) < DISTINCT_POWER_KW
        gains = np.where(alike, -np.inf, self._values[0] - self._values[1:])
        best = gains.max(axis=0)
        powers = self._options[1:][gains.argmax(axis=0), np.arange(own.size)]
        expected = ordered_sum(best[best > 0.0])
        if expected > LEAST_GAIN and expected > PROMISING_SHARE * self._cost(result, table):
            return np.where(best > 0.0, powers, own)
        tried = None
        if due and not alike.all():
            tried = np.where(best >= min(float(best.max()), 0.0), powers, own)
        return self._cheaper_powers(variables, data, tried)

    def _cost(self, result: SolveResult, table: FloatArray) -> float:
        """Return the magnitude of what a plan costs without its slacks."""
        slacks = table[:, layout.BLOCK - layout.SLACKS :]
        return abs(result.objective - ordered_sum((slacks * self._slack_prices).ravel()))

    def _concentrated(self, own: FloatArray, values: FloatArray) -> FloatArray | None:
        """Return powers that do the work of the plan in fewer steps, the cheapest ones, at the best power.

        Below its most efficient power the compressor wastes: a plan that may cool only a little further must
        not spread that over the whole horizon.
        """
        best = float(self._candidates[-1, 0])
        running = own > RUNNING_SHARE * best
        if not running.any() or own[running].min() >= FULL_SHARE * best:
            return None
        lengths_s = self._lengths_s
        work = ordered_sum(own * lengths_s)
        order = np.argsort((values[2] - values[1]) / lengths_s, kind="stable")
        done = np.cumsum(best * lengths_s[order])
        chosen = order[: int(np.searchsorted(done, work)) + 1]
        powers = np.zeros_like(own)
        powers[chosen] = best
        return powers

    def _cheaper_powers(
        self, variables: FloatArray, data: ProblemData, tried: FloatArray | None
    ) -> FloatArray | None:
        """Return the powers of a simulated plan that is cheaper, those to be tried where there is none."""
        if self._search is None:
            return tried
        cheaper = self._search.cheaper_powers(variables, data, self._ramps(data))
        return tried if cheaper is None else cheaper

    def _within_ramps(self, powers: FloatArray, data: ProblemData) -> FloatArray:
        """Return the powers as the rate limit lets the compressor follow them from where it is."""
        followed = np.empty_like(powers)
        last = float(data.initial_state[StateIndex.LAST_COMPRESSOR_POWER])
        for step, (wanted, ramp) in enumerate(zip(powers, self._ramps(data), strict=True)):
            last = min(max(wanted, last - ramp), last + ramp)
            followed[step] = last
        return followed

    def _ramps(self, data: ProblemData) -> FloatArray:
        """Return the largest change of the power into every step, shape (N,)."""
        ramps: FloatArray = self._rate_1_s * data.parameters[self._rate_slots]
        return ramps

    def _with_powers(
        self, variables: FloatArray, powers: FloatArray, data: ProblemData
    ) -> FloatArray:
        states, inputs = self._grid.split(variables)
        followed = self._within_ramps(powers, data)
        inputs[:, InputIndex.COMPRESSOR_POWER] = followed
        states[1:, StateIndex.LAST_COMPRESSOR_POWER] = followed
        return self._grid.join(states, inputs)


def _hamiltonians(problem: OptimalControlProblem, options: int) -> ca.Function:
    """Return a function of ``w, p, lam, powers``: the Hamiltonian of every step, option after option."""
    grid = problem.grid
    w, p = ca.MX.sym("w", grid.variable_count), ca.MX.sym("p", grid.parameter_count)
    lam = ca.MX.sym("lam", layout.STATES * grid.steps)
    powers = ca.MX.sym("powers", options * grid.steps)
    costates = ca.reshape(lam, layout.STATES, grid.steps)
    tables = ca.reshape(powers, grid.steps, options)
    functions = []
    for index, stage in enumerate(problem.stage_expressions()):
        costate = ca.SX.sym("costate", layout.STATES)
        symbols = [stage.state, stage.inputs, stage.step_parameters, stage.global_parameters]
        symbols.append(stage.model.numbers)
        value = stage.cost + ca.dot(costate, stage.next_state)
        name = f"hamiltonian_{index}"
        functions.append(ca.Function(name, [*symbols, costate], [value], {"cse": True}))
    before, after = InputIndex.COMPRESSOR_POWER, InputIndex.COMPRESSOR_POWER + 1
    values = []
    for option in range(options):
        for kind, function, (x, u, *given) in zip(
            grid.stages, functions, stage_arguments(grid, w, p), strict=True
        ):
            inputs = ca.vertcat(u[:before, :], tables[kind.steps, option].T, u[after:, :])
            given.append(ca.repmat(ca.DM(problem.numbers), 1, kind.count))
            values.append(function.map(kind.count)(x, inputs, *given, costates[:, kind.steps]))
    return named_function(
        "hamiltonian",
        {"w": w, "p": p, "lam": lam, "powers": powers},
        {"hamiltonians": ca.vec(ca.horzcat(*values))},
    )


def _is_better(second: SolveResult, first: SolveResult) -> bool:
    if not second.status.usable:
        return False
    return not first.status.usable or second.objective < first.objective - LEAST_GAIN
