"""The map of the paper's Fig. aging: degradation of a cell over current and temperature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.parameters.model import ModelParameters
from iptm_core.parameters.units import CELSIUS_ZERO_K
from iptm_core.physics.aging import SECONDS_PER_HOUR, capacity_loss_rate_1_s
from iptm_core.state import FloatArray

CURRENT_STEPS = 41
TEMPERATURE_STEPS = 31
LARGEST_RATE_1_H = 2.0
"""The figure reaches 10 A = 2C."""


@dataclass(frozen=True, eq=False)
class AgingMap:
    """Capacity loss per hour at the initial loss of the parameters.

    Attributes:
        currents_a: cell currents, shape (n,), from 0 to 2C.
        temperatures_c: cell temperatures, shape (m,), over the permitted range.
        loss_per_hour: capacity loss in one hour as a fraction of nominal, shape (m, n).
        nominal_capacity_ah: what 1C is.
    """

    currents_a: FloatArray
    temperatures_c: FloatArray
    loss_per_hour: FloatArray
    nominal_capacity_ah: float


def aging_map(parameters: ModelParameters) -> AgingMap:
    """Evaluate the aging model over current and temperature.

    Args:
        parameters: the aging model, the cell and the permitted temperatures.

    Returns:
        The map.
    """
    capacity_ah = parameters.cell.nominal_capacity_ah
    currents = np.linspace(0.0, LARGEST_RATE_1_H * capacity_ah, CURRENT_STEPS, dtype=np.float64)
    temperatures = np.linspace(
        parameters.limits.min_temperature_k,
        parameters.limits.max_temperature_k,
        TEMPERATURE_STEPS,
        dtype=np.float64,
    )
    rates = capacity_loss_rate_1_s(
        currents[np.newaxis, :],
        temperatures[:, np.newaxis],
        parameters.aging.initial_capacity_loss,
        parameters.aging,
        parameters.cell,
    )
    return AgingMap(
        currents_a=currents,
        temperatures_c=temperatures - CELSIUS_ZERO_K,
        loss_per_hour=np.asarray(rates) * SECONDS_PER_HOUR,
        nominal_capacity_ah=capacity_ah,
    )
