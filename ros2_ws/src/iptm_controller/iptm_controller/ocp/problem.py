"""The problem of a tick in one form for every solver, and its bounds."""

from __future__ import annotations

import math
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
from iptm_core.physics.power_thermal import Smoothing
from iptm_core.physics.powertrain import MASS_LOAD_OF
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
    def without_load(self) -> OptimalControlProblem:
        """The problem without what `MassLoad` is made of, which comes with the data: it has the same code."""
        unknown = dict.fromkeys(MASS_LOAD_OF, math.nan)
        body = replace(self.model.body, **unknown)
        return replace(self, model=replace(self.model, body=body))

    def stage_expressions(self) -> list[StageExpressions]:
        """Return the symbolic stages, one per kind of the grid."""
        return [
            (build_thermal_stage if kind.thermal else build_stage)(
                kind.step_s, kind.samples, self.model, self.smoothing, self.penalties
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
    harder than it is of use.
    """
    limits = model.limits
    variables_low = np.full(layout.BLOCK, -np.inf)
    variables_high = np.full(layout.BLOCK, np.inf)
    inputs_low, inputs_high = np.zeros(layout.INPUTS), np.full(layout.INPUTS, np.inf)
    inputs_low[InputIndex.ACCELERATION] = limits.min_acceleration_m_s2
    inputs_high[InputIndex.ACCELERATION] = limits.max_acceleration_m_s2
    inputs_low[InputIndex.COMPRESSOR_POWER] = limits.lowest_thermal_power_w
    inputs_high[InputIndex.COMPRESSOR_POWER] = largest_useful_power_w(model.chiller, limits)
    variables_low[layout.STATES :] = inputs_low / layout.INPUT_SCALE
    variables_high[layout.STATES :] = inputs_high / layout.INPUT_SCALE
    rows_low, rows_high = np.zeros(layout.ROWS), np.full(layout.ROWS, np.inf)
    rows_high[: layout.STATES] = 0.0
    for rate in (LimitIndex.ACCELERATION_RATE, LimitIndex.COMPRESSOR_RATE):
        rows_low[layout.STATES + rate] = -1.0
        rows_high[layout.STATES + rate] = 1.0
    return Bounds(variables_low, variables_high, rows_low, rows_high)
