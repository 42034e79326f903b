"""Other cooling on trial: plans that differ in the compressor power are driven through the model.

A plan that costs less than the present one, with the same motion, is not near the local minimum of that one,
so the solver begins again there. Plans on trial cool from some part of the horizon on, or have one part of
it switched over; a few simulated steps each cost far less than one more solve.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.riccati.backend import SwitchingNumbers
from iptm_controller.solvers.riccati.stage_system import StageSystem
from iptm_controller.solvers.switching_check import BLOCKS, LEAST_GAIN, RUNNING_SHARE
from iptm_core.physics.ops import named_function
from iptm_core.state import FloatArray


class CoolingSearch:
    """The search in Python, with the results of the one in ``c/switching.c``."""

    def __init__(self, problem: OptimalControlProblem, numbers: SwitchingNumbers) -> None:
        self._grid, self._numbers = problem.grid, numbers
        self._lengths_s = self._grid.horizon.step_lengths_s
        self._blocks = _blocks(self._lengths_s)
        plans = self._proposals(np.zeros(self._grid.steps)).shape[0]
        written = _followed(problem, plans)
        self._follow = [
            function
            for function, kind in zip(written, self._grid.stages, strict=True)
            for _ in range(kind.count)
        ]

    def cheaper_powers(
        self, variables: FloatArray, data: ProblemData, ramps: FloatArray
    ) -> FloatArray | None:
        """Return the powers of the cheapest plan, None where that is the present one.

        Args:
            variables: of the present plan.
            ramps: largest change of the power into every step, shape (N,).
        """
        table = variables[: -layout.STATES].reshape(-1, layout.BLOCK)
        powers = self._proposals(table[:, layout.STATES + InputIndex.COMPRESSOR_POWER])
        states = np.tile(variables[: layout.STATES], (len(powers), 1)).T
        costs = np.zeros(len(powers))
        shared, places = data.parameters[: layout.GLOBALS], self._grid.step_parameters
        for step, (follow, ramp, place) in enumerate(zip(self._follow, ramps, places, strict=True)):
            last = states[StateIndex.LAST_COMPRESSOR_POWER]
            powers[:, step] = np.minimum(np.maximum(powers[:, step], last - ramp), last + ramp)
            inputs = table[step, layout.STATES :]
            found = follow(states, inputs, data.parameters[place], shared, powers[:, step])
            states, step_costs = (each.full() for each in found)
            costs += step_costs[0]
        best = int(costs.argmin())
        return powers[best] if costs[best] < costs[0] - LEAST_GAIN else None

    def _proposals(self, own: FloatArray) -> FloatArray:
        """Return the powers of the plans on trial, the present ones first, shape (plans, N)."""
        off, on = self._numbers.candidates
        is_on = own > RUNNING_SHARE * on
        works = own * self._lengths_s
        rows = [own]
        for block in self._blocks[1:]:
            powers = *self._numbers.levels, own
            rows += [np.where(block.cumsum(), power, off) for power in powers]
        last = self._blocks[-1]
        ends_on = bool((is_on & last).any())
        for block in self._blocks:
            switched = own.copy()
            if (is_on & block).any():
                # Its work is done at the end, or in the other steps if the end has work.
                rest = ordered_sum(works[is_on & ~block])
                if not ends_on:
                    switched[last] = on
                elif rest > 0.0:
                    switched[is_on] *= ordered_sum(works[is_on]) / rest
                switched[block] = off
            else:
                switched[block] = on
            rows.append(switched)
        return np.array(rows)


def _blocks(lengths_s: FloatArray) -> list[NDArray[np.bool_]]:
    """Return the steps of the parts of the horizon that are switched as one."""
    shortest_s = ordered_sum(lengths_s) / BLOCKS
    places, block_s, place = [], 0.0, -1
    for length_s in lengths_s:
        place += block_s == 0.0
        places.append(place)
        block_s += length_s
        if block_s >= shortest_s:
            block_s = 0.0
    return [np.array(places) == each for each in range(place + 1)]


def _followed(problem: OptimalControlProblem, plans: int) -> list[ca.Function]:
    """Return a function of ``x, u, p, g, powers`` for each stage: next state and cost of a step, by plan."""
    functions = []
    for index, stage in enumerate(problem.stage_expressions()):
        follow = StageSystem(stage).follow(f"one_followed_{index}")
        given = {name: follow.mx_in(name) for name in ("x", "u", "p", "g")}
        given["x"] = ca.MX.sym("x", layout.STATES, plans)
        powers = ca.MX.sym("powers", 1, plans)
        found = follow.map(plans)(
            **given, power=powers, numbers=ca.repmat(ca.DM(problem.numbers), 1, plans)
        )
        results = {name: found[name] for name in ("next_state", "cost")}
        functions.append(named_function(f"followed_{index}", {**given, "powers": powers}, results))
    return functions


def ordered_sum(values: FloatArray) -> float:
    """Return a sum in the order of the values, which NumPy's own is not."""
    return float(values.cumsum()[-1]) if values.size else 0.0
