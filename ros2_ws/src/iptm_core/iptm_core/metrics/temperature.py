"""Temperatures of the pack during a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.metrics.time_integrals import mean_of_states
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory


@dataclass(frozen=True)
class ValueRange:
    """Smallest, time-averaged and largest value of a quantity, in its unit."""

    minimum: float
    mean: float
    maximum: float


@dataclass(frozen=True)
class TemperatureMetrics:
    """Temperatures of a run in kelvin.

    Attributes:
        cell_1_k: first cell of a coolant channel.
        cell_n_k: last cell.
        spread_k: last minus first cell, which drives the inconsistency of degradation.
        coolant_outlet_k: coolant leaving the pack.
    """

    cell_1_k: ValueRange
    cell_n_k: ValueRange
    spread_k: ValueRange
    coolant_outlet_k: ValueRange


def temperature_metrics(trajectory: Trajectory) -> TemperatureMetrics:
    """Summarise the temperatures of a run.

    Args:
        trajectory: the run.

    Returns:
        Its temperatures.
    """
    cell_1, cell_n = trajectory.cell_1_temperature_k, trajectory.cell_n_temperature_k
    return TemperatureMetrics(
        cell_1_k=_range(trajectory, cell_1),
        cell_n_k=_range(trajectory, cell_n),
        spread_k=_range(trajectory, cell_n - cell_1),
        coolant_outlet_k=_range(trajectory, trajectory.coolant_outlet_temperature_k),
    )


def _range(trajectory: Trajectory, values: FloatArray) -> ValueRange:
    return ValueRange(
        minimum=float(np.min(values)),
        mean=mean_of_states(trajectory, values),
        maximum=float(np.max(values)),
    )
