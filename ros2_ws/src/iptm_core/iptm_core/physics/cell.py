"""One cell: resistance (13), heat and temperature (8), capacity loss (12) as the slope of (11).

Temperatures are kelvin, the C-rate is ``|I| / Q_nom`` in 1/h and the loss a fraction of nominal; with
these the printed constants reproduce the size of the paper's degradation rows.
"""

from __future__ import annotations

from iptm_core.parameters.model import (
    AgingParameters,
    CellParameters,
    CoolingParameters,
    ModelParameters,
)
from iptm_core.physics.charge import exponential_growth, heat_from_surroundings_w
from iptm_core.physics.ops import Scalar, absolute, exp
from iptm_core.units import SECONDS_PER_HOUR


def cell_resistance_ohm(
    temperature_k: Scalar, capacity_loss: Scalar, cell: CellParameters
) -> Scalar:
    """Internal resistance R_bc with both effects acting at once.

    ``R_0 (1 + kappa (T - T_0)) mu (Q_nom / Q_bc)^lambda`` with ``Q_bc = Q_nom (1 - Q_loss)``. Where the
    cell has an exponent ``k_R``, its thermal factor is ``r_0 + (1 - r_0) exp(-k_R (T - T_0))``, as measured.
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
    if exchange_w_k == 0.0:
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
    if factor == 1.0:
        return magnitude_a
    return 0.5 * ((1.0 + factor) * magnitude_a + (1.0 - factor) * current_a)
