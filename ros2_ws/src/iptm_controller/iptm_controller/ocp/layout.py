"""Order and scaling of the variables of one stage, for Python and for C.

The optimiser works on scaled variables of order one; their scales are defined here only. Positions are
relative to the ego vehicle at the present tick, temperatures relative to 30 degC.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, TypeVar

import numpy as np

from iptm_controller.strategy import COST_TERMS
from iptm_core.state import FloatArray

Index = TypeVar("Index", bound=IntEnum)


class StateIndex(IntEnum):
    """States of a node: the paper's x without Q_loss (a parameter), with the inputs last applied."""

    POSITION = 0
    SPEED = 1
    CELL_1_TEMPERATURE = 2
    CELL_N_TEMPERATURE = 3
    LAST_ACCELERATION = 4
    LAST_COMPRESSOR_POWER = 5


class InputIndex(IntEnum):
    """Inputs of a step: the paper's u and the slacks of its soft limits."""

    ACCELERATION = 0
    COMPRESSOR_POWER = 1
    GAP_SHORT = 2
    GAP_LONG = 3
    SPEED_EXCESS = 4
    TEMPERATURE_EXCESS = 5


class LimitIndex(IntEnum):
    """Inequality rows of a step; all but the first two read ``row >= 0``."""

    ACCELERATION_RATE = 0
    COMPRESSOR_RATE = 1
    GAP_MIN = 2
    GAP_FLOOR = 3
    GAP_BRAKING = 4
    GAP_MAX = 5
    SPEED_MIN = 6
    SPEED_MAX = 7
    CELL_1_MAX = 8
    CELL_N_MAX = 9
    OUTLET_MAX = 10


class GlobalIndex(IntEnum):
    """Parameters shared by all steps of one problem, ahead of the weights of the cost terms (`WEIGHTS`).

    The prices of a kelvin and of thermal energy come from ``TemperatureValue``; the price of running the
    compressor is zero unless the cells are at their lower temperature limit, to which cell 1 may be cooled.
    The charging power is the largest that the pack takes; the stages of a pack without limits do not have it.
    The price of a headway other than the desired one is zero where no lead vehicle is followed.
    """

    CELL_1_LOSS = 0
    CELL_N_LOSS = 1
    REFERENCE_TEMPERATURE = 2
    CELL_1_PRICE = 3
    CELL_N_PRICE = 4
    COMPRESSOR_PRICE = 5
    LOWEST_TEMPERATURE = 6
    THERMAL_ENERGY_PRICE = 7
    CHARGE_POWER = 8
    HEADWAY_PRICE = 9


WEIGHTS = {key: len(GlobalIndex) + place for place, key in enumerate(COST_TERMS)}
"""Places of the weights in the shared parameters, by field of `Strategy`."""


class StepIndex(IntEnum):
    """Parameters of one step ahead of its per-sample parameters.

    The intervals are the times in which the inputs change from the step before. ``END_OF_PREVIEW``
    is 1 for the step with which the knowledge of the leader ends, where the braking reserve is asked for, and
    0 for the others: all steps have the same rows, as structure-exploiting solvers require. The largest speed
    holds at the end of the step.
    """

    LEADER_POSITION = 0
    LEADER_SPEED = 1
    ACCELERATION_INTERVAL = 2
    COMPRESSOR_INTERVAL = 3
    END_OF_PREVIEW = 4
    MAX_SPEED = 5


class SampleIndex(IntEnum):
    """Parameters of one sample inside a step; the slope is quadratic around a reference position."""

    SLOPE = 0
    SLOPE_GRADIENT = 1
    SLOPE_CURVATURE = 2
    POSITION = 3
    SPEED_REFERENCE = 4
    LEADER_POSITION = 5
    LEADER_SPEED = 6


class ThermalSampleIndex(IntEnum):
    """Parameters of one sample of a thermal step: a share of the step spent at one traction power.

    They take the first places of ``SampleIndex``; the others are not used.
    """

    TRACTION_POWER = 0
    SPEED = 1


STATES = len(StateIndex)
INPUTS = len(InputIndex)
LIMITS = len(LimitIndex)
GLOBALS = len(GlobalIndex) + len(WEIGHTS)
STEP_PARAMETERS = len(StepIndex)
SAMPLE_PARAMETERS = len(SampleIndex)
SLACKS = INPUTS - InputIndex.GAP_SHORT
BLOCK = STATES + INPUTS
"""Variables of one stage."""
ROWS = STATES + LIMITS
"""Constraint rows of one stage."""

STATE_SCALE = np.array([10.0, 1.0, 1.0, 1.0, 1.0, 1000.0])
STATE_OFFSET = np.array([0.0, 0.0, 303.15, 303.15, 0.0, 0.0])
INPUT_SCALE = np.array([1.0, 1000.0, 1.0, 1.0, 1.0, 1.0])


def in_order(index: type[Index], values: Mapping[Index, Any]) -> list[Any]:
    """Return values in the order of their indices; each has to be there."""
    return [values[each] for each in index]


def step_parameter_count(samples: int) -> int:
    """Return the number of parameters of a step with `samples` samples."""
    return STEP_PARAMETERS + samples * SAMPLE_PARAMETERS


_INDICES = {
    "STATE": StateIndex,
    "INPUT": InputIndex,
    "GLOBAL": GlobalIndex,
    "STEP": StepIndex,
    "SAMPLE": SampleIndex,
}


def layout_header() -> str:
    """Return ``layout.h``: the sizes of a stage, the places in its vectors, and its scales."""
    sizes = {
        "STATES": STATES,
        "INPUTS": INPUTS,
        "SLACKS": SLACKS,
        "GLOBALS": GLOBALS,
        "WEIGHTS": len(WEIGHTS),
        "SAMPLE_PARAMETERS": SAMPLE_PARAMETERS,
    }
    places = {
        f"{prefix}_{entry.name}": int(entry) for prefix, kind in _INDICES.items() for entry in kind
    }
    places |= {f"GLOBAL_{name.upper()}": place for name, place in WEIGHTS.items()}
    scales = {
        "STATE_SCALE": STATE_SCALE,
        "STATE_OFFSET": STATE_OFFSET,
        "INPUT_SCALE": INPUT_SCALE,
    }
    lines = [f"#define IPTM_{name} {value}" for name, value in (sizes | places).items()]
    lines += [f"#define IPTM_{name} {_braced(values)}" for name, values in scales.items()]
    return "\n".join(["#ifndef IPTM_LAYOUT_H", "#define IPTM_LAYOUT_H", *lines, "#endif", ""])


def _braced(values: FloatArray) -> str:
    return "{" + ", ".join(map(repr, values.tolist())) + "}"
