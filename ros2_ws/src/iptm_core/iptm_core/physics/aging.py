"""Capacity loss of a cell, paper eq. (12): the slope of the closed form (11) over the throughput.

Temperatures are kelvin, the C-rate is ``|I| / Q_nom`` in 1/h and the loss a fraction of nominal; with
these the printed constants reproduce the size of the paper's degradation rows.
"""

from __future__ import annotations

from iptm_core.parameters.model import AgingParameters, CellParameters
from iptm_core.physics.ops import Scalar, absolute, exp

SECONDS_PER_HOUR = 3600.0


def capacity_loss_rate_1_s(
    current_a: Scalar,
    temperature_k: Scalar,
    capacity_loss: Scalar,
    aging: AgingParameters,
    cell: CellParameters,
    *,
    current_smoothing_a: float = 0.0,
) -> Scalar:
    """Rate of the capacity loss (eq. 12 divided by the time step).

    Args:
        current_a: signed cell current I_bc; charging ages like discharging.
        temperature_k: cell temperature T_bc.
        capacity_loss: present loss Q_loss, positive.
        aging: coefficients.
        cell: nominal capacity.
        current_smoothing_a: width of the smoothed magnitude in A; 0 is exact.

    Returns:
        Rate in 1/s, never negative.
    """
    magnitude = absolute(current_a, current_smoothing_a)
    z = aging.throughput_exponent
    c_rate_1_h = magnitude / cell.nominal_capacity_ah
    energy = aging.compensation_factor_j_mol * c_rate_1_h - aging.activation_energy_j_mol
    exponent = energy / (aging.gas_constant_j_mol_k * temperature_k) / z
    memory = capacity_loss ** (1.0 - 1.0 / z)
    scale = z * aging.pre_exponential_factor ** (1.0 / z) / SECONDS_PER_HOUR
    return scale * magnitude * exp(exponent) * memory
