"""Internal resistance of a cell under temperature and ageing, paper eq. (13), and its exponential form."""

from __future__ import annotations

from iptm_core.parameters.model import CellParameters
from iptm_core.physics.cell_voltage import exponential_growth
from iptm_core.physics.ops import Scalar


def cell_resistance_ohm(
    temperature_k: Scalar, capacity_loss: Scalar, cell: CellParameters
) -> Scalar:
    """Internal resistance R_bc with both effects acting at once.

    ``R_0 (1 + kappa (T - T_0)) mu (Q_nom / Q_bc)^lambda`` with ``Q_bc = Q_nom (1 - Q_loss)``. Where the
    cell has an exponent ``k_R``, its thermal factor is ``r_0 + (1 - r_0) exp(-k_R (T - T_0))``, as measured.

    Args:
        temperature_k: cell temperature T_bc.
        capacity_loss: capacity loss Q_loss as a fraction of nominal.
        cell: coefficients.

    Returns:
        Resistance in ohm.
    """
    if cell.resistance_exponent_1_k > 0.0:
        constant = cell.resistance_offset_share
        thermal = constant + (1.0 - constant) * exponential_growth(
            temperature_k, cell.resistance_exponent_1_k, cell.nominal_temperature_k
        )
    else:
        thermal = 1.0 + cell.resistance_temperature_coefficient_1_k * (
            temperature_k - cell.nominal_temperature_k
        )
    ageing = cell.resistance_aging_factor * (1.0 - capacity_loss) ** -cell.resistance_aging_exponent
    return cell.nominal_resistance_ohm * thermal * ageing
