"""One cell: charge and voltage, resistance (13), heat and temperature (8), capacity loss (12) and (11).

The paper has a constant open-circuit voltage and one resistance (eqs. 6, 7 and 13). Here both depend on the
state of charge, the resistance falls exponentially with temperature to an offset, and RC branches follow the
current. Current is positive when discharging.

``V = OCV(s) - I R_0(T, s) - eta(I, T, s) - sum_j R_j(T, s) x_j``, ``dx_j/dt = (I - x_j) / tau_j``

Temperatures are kelvin, the C-rate is ``|I| / Q_nom`` in 1/h and the loss a fraction of nominal; with these
the printed constants reproduce the size of the paper's degradation rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

from iptm_core.declaration import has_effect
from iptm_core.parameters.model import (
    AgingParameters,
    CellParameters,
    ChargeParameters,
    CoolingParameters,
    ModelParameters,
)
from iptm_core.physics.ops import Scalar, absolute, exp, maximum, minimum
from iptm_core.units import SECONDS_PER_HOUR

GAS_CONSTANT_J_MOL_K = 8.314462618
ROUNDING = 1e-9
"""Of a state of charge: a pack that is as full or empty as it may be is not beyond."""


@dataclass(frozen=True)
class ChargeTable:
    """A quantity over the state of charge, linear between its nodes and constant outside."""

    charges: tuple[float, ...]
    values: tuple[float, ...]

    def at(self, charge: Scalar) -> Scalar:
        """Return the quantity at a state of charge."""
        result = self.values[0]
        nodes = list(zip(self.charges, self.values, strict=True))
        for (start, low), (end, high) in pairwise(nodes):
            within = minimum(maximum(charge - start, 0.0), end - start)
            result = result + within * ((high - low) / (end - start))
        return result


def exponential_growth(temperature_k: Scalar, coefficient_1_k: float, reference_k: float) -> Scalar:
    """Factor by which a resistance exceeds that at the reference temperature."""
    return exp(-coefficient_1_k * (temperature_k - reference_k))


def charge_rate_1_s(current_a: Scalar, capacity_ah: float) -> Scalar:
    """Rate of the state of charge, negative when discharging, in 1/s."""
    return -current_a / (3600.0 * capacity_ah)


def heat_from_surroundings_w(
    temperature_k: Scalar, ambient_k: Scalar, exchange_w_k: float
) -> Scalar:
    """Heat that a cell or pack takes from the air around it, in W."""
    return exchange_w_k * (ambient_k - temperature_k)


_NODES = tuple(0.1 * tenth for tenth in range(11))
_MIDDLE = 0.5


def at_charge(parameters: ModelParameters, charge: Scalar) -> ModelParameters:
    """Return the parameters whose open-circuit voltage and resistance are those at a state of charge.

    Args:
        parameters: a parameter set; one without these laws, as the paper's, is returned as it is.
        charge: state of charge, 0 to 1; the voltage is constant outside.
    """
    law, pack, cell = parameters.charge, parameters.pack, parameters.cell
    if not depends_on_charge(law):
        return parameters
    if _voltage_varies(law):
        voltage = pack.open_circuit_voltage_v * ChargeTable(_NODES, law.voltage_shares).at(charge)
        pack = replace(pack, open_circuit_voltage_v=voltage)
    if has_effect(law.resistance_slope):
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

    It is bounded but for rounding by what a pack takes and gives, see ``pack_limits``.
    """
    end = charge + float(charge_rate_1_s(drawn_c, capacity_ah))
    within = min(max(end, 0.0), 1.0)
    return within if abs(end - within) < ROUNDING else end


def depends_on_charge(law: ChargeParameters) -> bool:
    """Return whether anything of the pack depends on its state of charge."""
    return _voltage_varies(law) or has_effect(law.resistance_slope)


def _voltage_varies(law: ChargeParameters) -> bool:
    return any(has_effect(share, 1.0) for share in law.voltage_shares)


def cell_resistance_ohm(
    temperature_k: Scalar, capacity_loss: Scalar, cell: CellParameters
) -> Scalar:
    """Internal resistance R_bc with both effects acting at once.

    ``R_0 (1 + kappa (T - T_0)) mu (Q_nom / Q_bc)^lambda`` with ``Q_bc = Q_nom (1 - Q_loss)``. Where the
    cell has an exponent ``k_R``, its thermal factor is ``r_0 + (1 - r_0) exp(-k_R (T - T_0))``, as measured.
    """
    if has_effect(cell.resistance_exponent_1_k):
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
    """Rate of a cell's temperature (eq. 8)."""
    convection = cooling.convective_coefficient_w_k * (coolant_temperature_k - temperature_k)
    return (heat_w + convection) / cell.heat_capacity_j_k


def heat_from_air_w(temperature_k: Scalar, parameters: ModelParameters) -> Scalar:
    """Heat that a cell takes from the ambient air, its share of the exchange of the pack, in W.

    The paper has none: exactly 0 without an exchange.
    """
    exchange_w_k = parameters.cooling.air_exchange_w_k
    if not has_effect(exchange_w_k):
        return 0.0
    ambient_k = parameters.environment.ambient_temperature_k
    return heat_from_surroundings_w(temperature_k, ambient_k, exchange_w_k / parameters.pack.cells)


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
        current_a: signed cell current I_bc, positive while discharging.
        current_smoothing_a: width of the smoothed magnitude in A; 0 is exact.
    """
    magnitude = absolute(current_a, current_smoothing_a)
    z = aging.throughput_exponent
    counted_a = aging_current_a(current_a, magnitude, aging)
    c_rate_1_h = counted_a / cell.nominal_capacity_ah
    energy = aging.compensation_factor_j_mol * c_rate_1_h - aging.activation_energy_j_mol
    exponent = energy / (aging.gas_constant_j_mol_k * temperature_k) / z
    memory = capacity_loss ** (1.0 - 1.0 / z)
    scale = z * aging.pre_exponential_factor ** (1.0 / z) / SECONDS_PER_HOUR
    return scale * magnitude * exp(exponent) * memory


def aging_current_a(current_a: Scalar, magnitude_a: Scalar, aging: AgingParameters) -> Scalar:
    """Current in A that counts in the exponent of eq. (12): signed where the set asks for the print."""
    factor = aging.charging_rate_factor
    if not has_effect(factor, 1.0):
        return magnitude_a
    return 0.5 * ((1.0 + factor) * magnitude_a + (1.0 - factor) * current_a)
