"""State of charge of the pack, and what depends on it: open-circuit voltage and resistance."""

from __future__ import annotations

from dataclasses import replace

from iptm_core.parameters.model import ChargeParameters, ModelParameters
from iptm_core.physics.cell_voltage import ChargeTable, charge_rate_1_s
from iptm_core.physics.ops import Scalar

_NODES = tuple(0.1 * tenth for tenth in range(11))
_MIDDLE = 0.5


def at_charge(parameters: ModelParameters, charge: Scalar) -> ModelParameters:
    """Return the parameters whose open-circuit voltage and resistance are those at a state of charge.

    Args:
        parameters: a parameter set; one without these laws, as the paper's, is returned as it is.
        charge: state of charge, 0 to 1; the voltage is constant outside.

    Returns:
        Parameters for the functions of ``iptm_core.physics``; symbols where the charge is one.
    """
    law, pack, cell = parameters.charge, parameters.pack, parameters.cell
    if not depends_on_charge(law):
        return parameters
    if _voltage_varies(law):
        voltage = pack.open_circuit_voltage_v * ChargeTable(_NODES, law.voltage_shares).at(charge)
        pack = replace(pack, open_circuit_voltage_v=voltage)
    if law.resistance_slope != 0.0:
        factor = 1.0 + law.resistance_slope * (charge - _MIDDLE)
        cell = replace(cell, nominal_resistance_ohm=cell.nominal_resistance_ohm * factor)
    return replace(parameters, pack=pack, cell=cell)


def nominal_charge_parameters(parameters: ModelParameters) -> ModelParameters:
    """Return the parameters at the charge at which a trip begins, for a model without state of charge."""
    return at_charge(parameters, parameters.charge.initial_charge)


def pack_capacity_ah(parameters: ModelParameters, mean_capacity_loss: float) -> float:
    """Return the capacity of the pack at present, in Ah."""
    nominal_ah = parameters.cell.nominal_capacity_ah * parameters.pack.parallel
    return nominal_ah * (1.0 - mean_capacity_loss)


def charge_after(charge: float, drawn_c: float, capacity_ah: float) -> float:
    """Return the state of charge after a charge in C has been drawn from the pack.

    It is not bounded: a pack that is asked for more than it has shows in a negative charge.
    """
    return charge + float(charge_rate_1_s(drawn_c, capacity_ah))


def depends_on_charge(law: ChargeParameters) -> bool:
    """Return whether anything of the pack depends on its state of charge."""
    return _voltage_varies(law) or law.resistance_slope != 0.0


def _voltage_varies(law: ChargeParameters) -> bool:
    return any(share != 1.0 for share in law.voltage_shares)
