"""The problem of a tick in one form for every solver, and its bounds."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.layout import InputIndex, LimitIndex
from iptm_controller.ocp.stage import DEFAULT_SMOOTHING, PenaltyWeights, StageExpressions
from iptm_controller.ocp.stages import build_stage, build_thermal_stage
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.chiller import largest_useful_power_w
from iptm_core.physics.model_numbers import SymbolicModel, numbers_of, shape_of
from iptm_core.physics.ops import is_symbolic
from iptm_core.physics.power_thermal import Smoothing
from iptm_core.state import FloatArray


@dataclass(frozen=True)
class OptimalControlProblem:
    """Horizon, vehicle and formulation; the numbers of a tick come as ``ProblemData``."""

    horizon: Horizon
    model: ModelParameters
    smoothing: Smoothing = DEFAULT_SMOOTHING
    penalties: PenaltyWeights = field(default_factory=PenaltyWeights)

    @cached_property
    def grid(self) -> ProblemGrid:
        """Order of the flat vectors."""
        return ProblemGrid(self.horizon)

    @property
    def shape(self) -> OptimalControlProblem:
        """What problems with the same code have in common; step counts and numbers of the model are not."""
        phases = tuple(replace(phase, steps=1) for phase in self.horizon.phases)
        return replace(self, horizon=Horizon(phases), model=shape_of(self.model))

    @cached_property
    def numbers(self) -> FloatArray:
        """What the functions of the stages take for the model."""
        return numbers_of(self.model, shape_of(self.model))

    def stage_expressions(self, model: SymbolicModel | None = None) -> list[StageExpressions]:
        """Return the symbolic stages, one per kind of the grid.

        Args:
            model: whose numbers are used; by default a symbol that the stages share stands for them.
        """
        model = model or SymbolicModel.of(shape_of(self.model))
        return [
            (build_thermal_stage if kind.thermal else build_stage)(
                kind.step_s, kind.samples, model, self.smoothing, self.penalties
            )
            for kind in self.grid.stages
        ]


@dataclass(frozen=True)
class Bounds:
    """Bounds of variables and rows in scaled units; infinite for none."""

    variables_low: FloatArray
    variables_high: FloatArray
    rows_low: FloatArray
    rows_high: FloatArray


def stage_bounds(model: ModelParameters) -> Bounds:
    """Return the bounds of one stage: of its states and inputs, and of its rows.

    Physical limits of the inputs are hard; everything else goes through rows that a slack softens. States
    are free: the present one is put into the bounds of x_0 for every problem. The compressor is not driven
    harder than it is of use. Bounds of a model of expressions are expressions.
    """
    limits = model.limits
    accelerations = limits.min_acceleration_m_s2, limits.max_acceleration_m_s2
    largest_w = largest_useful_power_w(model.chiller, limits)
    powers = limits.lowest_thermal_power_w, largest_w
    kind = object if is_symbolic(*accelerations, *powers) else float
    variables_low = np.full(layout.BLOCK, -np.inf, kind)
    variables_high = np.full(layout.BLOCK, np.inf, kind)
    variables_low[layout.STATES :] = 0.0
    given = {InputIndex.ACCELERATION: accelerations, InputIndex.COMPRESSOR_POWER: powers}
    for index, (low, high) in given.items():
        place, scale = layout.STATES + index, float(layout.INPUT_SCALE[index])
        variables_low[place], variables_high[place] = low / scale, high / scale
    rows_low, rows_high = np.zeros(layout.ROWS), np.full(layout.ROWS, np.inf)
    rows_high[: layout.STATES] = 0.0
    for rate in (LimitIndex.ACCELERATION_RATE, LimitIndex.COMPRESSOR_RATE):
        rows_low[layout.STATES + rate] = -1.0
        rows_high[layout.STATES + rate] = 1.0
    return Bounds(variables_low, variables_high, rows_low, rows_high)
