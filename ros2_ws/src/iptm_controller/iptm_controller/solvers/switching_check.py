"""A second start where the compressor had better run, or stand, in some steps of a plan.

A compressor that is off cools nothing, and the gated chiller map is flat there: "off" and "on" are both
local minima, in every step of the horizon. Pontryagin's minimum principle tells them apart: with the
costates lam of the solution, the power of each step has to minimise the Hamiltonian

    H_k(P_cp) = stage cost + lam_k+1' F(x_k, u_k)

not only near the power found. Where standing still, or running at the most efficient power, gives a smaller
one, the problem is solved once more from there, and the better plan wins: one further solve at most.
"""

from __future__ import annotations

import time
from dataclasses import astuple, replace

import casadi as ca
import numpy as np

from iptm_controller.ocp import layout
from iptm_controller.ocp.compilation import compile_functions, find_compiler
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.buffered import BufferedFunction, named_function
from iptm_controller.solvers.interface import SolverBackend, SolveResult
from iptm_core.physics.thermal_loop import most_efficient_cooling
from iptm_core.state import FloatArray

USUAL_TEMPERATURE_K = 303.15
WORTHWHILE_SHARE = 0.002
"""Expected gain, relative to what the plan costs without its slacks, that a second solve is worth."""
LEAST_GAIN = 1e-4
_POWER_SCALE_W = float(layout.INPUT_SCALE[InputIndex.COMPRESSOR_POWER])


class SwitchingCheck:
    """Wraps a back end; nothing is carried over from solve to solve."""

    def __init__(
        self, inner: SolverBackend, problem: OptimalControlProblem, *, compile_code: bool = True
    ) -> None:
        """Write the Hamiltonian of a problem down and compile it.

        Args:
            inner: back end to wrap.
            problem: what it solves.
            compile_code: as machine code, where a compiler is found.

        Raises:
            SolverSetupError: the compiler fails.
        """
        self._inner = inner
        self._grid = problem.grid
        limits = problem.model.limits
        lengths_s = self._grid.horizon.step_lengths_s
        previous = np.concatenate([lengths_s[:1], lengths_s[:-1]])
        self._ramps = limits.max_compressor_rate_w_s * 0.5 * (previous + lengths_s) / _POWER_SCALE_W
        self._slack_prices = np.outer(lengths_s, astuple(problem.penalties))
        power_w, _ = most_efficient_cooling(USUAL_TEMPERATURE_K, problem.model)
        self._candidates = np.array([limits.min_compressor_power_w, power_w]) / _POWER_SCALE_W
        function = _hamiltonians(problem, len(self._candidates) + 1)
        compiler = find_compiler() if compile_code else None
        if compiler is not None:
            library = str(compile_functions([function], compiler))
            function = ca.external(function.name(), library)
        self._hamiltonian = BufferedFunction(function)

    @property
    def name(self) -> str:
        """Name of the wrapped back end."""
        return self._inner.name

    @property
    def compiled(self) -> bool:
        """Whether the wrapped back end runs machine code."""
        return self._inner.compiled

    def solve(self, data: ProblemData, guess: FloatArray) -> SolveResult:
        """Solve one problem; see ``SolverBackend``."""
        began = time.perf_counter()
        first = self._inner.solve(data, guess)
        usable = first.status.usable
        powers = (
            self._better_powers(first, data)
            if usable
            else np.full(self._grid.steps, self._candidates[-1])
        )
        if powers is None:
            return replace(first, time_s=time.perf_counter() - began)
        start = self._with_powers(first.variables if usable else guess, powers, data)
        second = self._inner.solve(data, start)
        better = second if _is_better(second, first) else first
        return replace(
            better,
            iterations=first.iterations + second.iterations,
            time_s=time.perf_counter() - began,
        )

    def _better_powers(self, result: SolveResult, data: ProblemData) -> FloatArray | None:
        """Return the powers that minimise the Hamiltonian step by step, None if those of the plan do."""
        _, inputs = self._grid.split(result.variables)
        slacks_cost = float(np.sum(inputs[:, layout.INPUTS - layout.SLACKS :] * self._slack_prices))
        own = inputs[:, InputIndex.COMPRESSOR_POWER]
        # A power is only reached through the ramp; what the ramp leaves of a candidate is judged.
        options = [own, *(self._within_ramps(np.full_like(own, c), data) for c in self._candidates)]
        given = self._hamiltonian.arguments
        given["w"][:] = result.variables
        given["p"][:] = data.parameters
        given["lam"][:] = result.costates
        given["powers"][:] = np.concatenate(options)
        self._hamiltonian()
        values = self._hamiltonian.results["hamiltonians"].reshape(len(options), -1)
        best = values.argmin(axis=0)
        gain = float(np.sum(values[0] - values.min(axis=0)))
        if not gain > max(LEAST_GAIN, WORTHWHILE_SHARE * abs(result.objective - slacks_cost)):
            return None
        chosen: FloatArray = np.take_along_axis(np.stack(options), best[None, :], axis=0)[0]
        return self._within_ramps(chosen, data)

    def _within_ramps(self, powers: FloatArray, data: ProblemData) -> FloatArray:
        """Return the powers as the rate limit lets the compressor follow them from where it is."""
        followed = np.empty_like(powers)
        last = float(data.initial_state[StateIndex.LAST_COMPRESSOR_POWER])
        for step, (wanted, ramp) in enumerate(zip(powers, self._ramps, strict=True)):
            last = min(max(wanted, last - ramp), last + ramp)
            followed[step] = last
        return followed

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
    values = []
    arguments = grid.stage_arguments(w, p)
    stages = problem.stage_expressions()
    for option in range(options):
        for index, (kind, stage, given) in enumerate(
            zip(grid.stages, stages, arguments, strict=True)
        ):
            costate = ca.SX.sym("costate", layout.STATES)
            value = stage.cost + ca.dot(costate, stage.next_state)
            symbols = [stage.state, stage.inputs, stage.step_parameters, stage.global_parameters]
            function = ca.Function(
                f"hamiltonian_{index}", [*symbols, costate], [value], {"cse": True}
            )
            x, u, step_parameters, shared = given
            row = tables[kind.steps, option].T
            u = ca.vertcat(u[0, :], row, u[2:, :])
            values.append(
                function.map(kind.count)(x, u, step_parameters, shared, costates[:, kind.steps])
            )
    return named_function(
        "hamiltonian",
        {"w": w, "p": p, "lam": lam, "powers": powers},
        {"hamiltonians": ca.vec(ca.horzcat(*values))},
    )


def _is_better(second: SolveResult, first: SolveResult) -> bool:
    if not second.status.usable:
        return False
    return not first.status.usable or second.objective < first.objective - LEAST_GAIN
