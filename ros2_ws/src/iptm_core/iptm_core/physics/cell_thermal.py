"""Heat of one cell and its temperature, paper eq. (8)."""

from __future__ import annotations

from iptm_core.parameters.model import CellParameters, CoolingParameters, ModelParameters
from iptm_core.physics.cell_voltage import heat_from_surroundings_w
from iptm_core.physics.ops import Scalar


def cell_heat_w(
    current_a: Scalar, resistance_ohm: Scalar, temperature_k: Scalar, cell: CellParameters
) -> Scalar:
    """Heat generated in a cell: ohmic ``I^2 R`` plus entropic ``I T dV/dT``, in W.

    The entropic part takes the sign of the current: with a positive coefficient it is negative
    (cooling) while charging.
    """
    entropic = cell.entropic_coefficient_v_k * temperature_k
    return current_a * (current_a * resistance_ohm + entropic)


def cell_temperature_rate_k_s(
    heat_w: Scalar,
    temperature_k: Scalar,
    coolant_temperature_k: Scalar,
    cell: CellParameters,
    cooling: CoolingParameters,
) -> Scalar:
    """Rate of a cell's temperature (eq. 8).

    Args:
        heat_w: heat generated in the cell.
        temperature_k: cell temperature T_bc,i.
        coolant_temperature_k: coolant temperature where it reaches the cell, T_c,i.
        cell: heat capacity C_c.
        cooling: convective coefficient h.

    Returns:
        Rate in K/s.
    """
    convection = cooling.convective_coefficient_w_k * (coolant_temperature_k - temperature_k)
    return (heat_w + convection) / cell.heat_capacity_j_k


def heat_from_air_w(temperature_k: Scalar, parameters: ModelParameters) -> Scalar:
    """Heat that a cell takes from the ambient air, its share of the exchange of the pack, in W.

    The paper has none: exactly 0 without an exchange.
    """
    exchange_w_k = parameters.cooling.air_exchange_w_k
    if exchange_w_k == 0.0:
        return 0.0
    cells = parameters.pack.cells_in_series * parameters.pack.parallel
    ambient_k = parameters.environment.ambient_temperature_k
    return heat_from_surroundings_w(temperature_k, ambient_k, exchange_w_k / cells)
