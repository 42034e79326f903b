"""A second start for the one place where the problem has two local minima: compressor off or on.

A compressor that is off cools nothing, and the chiller map is flat there: "off" is a stationary point
even when cooling would pay, for example when a temperature limit is about to break. A solver started
from an off plan stays at that minimum. Whenever the plan leaves the compressor off, this back end also
tries a plan that starts it, if a temperature limit is violated, if the first solve failed, and at the first
and every few further ticks in any case; the better plan wins.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.solvers.interface import SolverBackend, SolveResult
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray

PROBE_EVERY = 10
OFF_BELOW_W = 300.0
START_POWER_W = 900.0  # near the best coefficient of performance of the gated chiller map
TEMPERATURE_SLACK_K = 1e-4
MINIMUM_GAIN = 1e-4


class CoolingProbe:
    """Wraps a back end; deterministic, because it counts solves and not seconds."""

    def __init__(self, inner: SolverBackend, horizon: Horizon, parameters: ModelParameters) -> None:
        self._inner = inner
        self._grid = ProblemGrid(horizon)
        rate = parameters.limits.max_compressor_rate_w_s
        self._ramp_w = rate * horizon.node_times_s[1:]
        self._start_w = min(START_POWER_W, parameters.limits.max_compressor_power_w)
        self._since_probe = PROBE_EVERY

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
        first = self._inner.solve(data, guess)
        self._since_probe += 1
        if not self._due(first):
            return first
        self._since_probe = 0
        base = first.variables if first.status.usable else guess
        second = self._inner.solve(data, self._with_compressor_on(base, data))
        better = second if _is_better(second, first) else first
        return replace(
            better,
            iterations=first.iterations + second.iterations,
            time_s=first.time_s + second.time_s,
        )

    def _due(self, result: SolveResult) -> bool:
        if not result.status.usable:
            return True
        _, inputs = self._grid.split(result.variables)
        power_w = inputs[:, InputIndex.COMPRESSOR_POWER] * _POWER_SCALE_W
        if power_w.max() > OFF_BELOW_W:
            return False
        violated = inputs[:, InputIndex.TEMPERATURE_EXCESS].max() > TEMPERATURE_SLACK_K
        return bool(violated) or self._since_probe >= PROBE_EVERY

    def _with_compressor_on(self, variables: FloatArray, data: ProblemData) -> FloatArray:
        states, inputs = self._grid.split(variables)
        now_w = data.initial_state[StateIndex.LAST_COMPRESSOR_POWER] * _POWER_SCALE_W
        power = np.minimum(now_w + self._ramp_w, max(self._start_w, now_w)) / _POWER_SCALE_W
        inputs[:, InputIndex.COMPRESSOR_POWER] = power
        states[1:, StateIndex.LAST_COMPRESSOR_POWER] = power
        return self._grid.join(states, inputs)


_POWER_SCALE_W = float(layout.INPUT_SCALE[InputIndex.COMPRESSOR_POWER])


def _is_better(second: SolveResult, first: SolveResult) -> bool:
    if not second.status.usable:
        return False
    return not first.status.usable or second.objective < first.objective - MINIMUM_GAIN
