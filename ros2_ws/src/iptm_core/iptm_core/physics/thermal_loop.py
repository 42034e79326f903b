"""The closed coolant loop: chiller, channel inlet and channel outlet, paper eqs. (14) and (15)."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.parameters.model import CoolingParameters
from iptm_core.physics.chiller import CELSIUS_ZERO_K, ChillerLine
from iptm_core.physics.coolant import ChannelWeights
from iptm_core.physics.ops import Scalar


@dataclass(frozen=True)
class CoolantLoop:
    """Quasi-steady coolant temperatures around the loop.

    Attributes:
        inlet_k: channel inlet T_c,in, behind the chiller.
        outlet_k: channel outlet T_c,out, in front of the chiller.
        cooling_rate_w: heat that the chiller takes from the coolant, Q_co.
    """

    inlet_k: Scalar
    outlet_k: Scalar
    cooling_rate_w: Scalar


def solve_coolant_loop(
    cell_1_k: Scalar,
    cell_n_k: Scalar,
    chiller: ChillerLine,
    outlet: ChannelWeights,
    cooling: CoolingParameters,
) -> CoolantLoop:
    """Inlet and outlet temperature that agree with the chiller (eq. 15), in closed form.

    The outlet is a weighted mean of inlet and cells, the inlet is the outlet less what the chiller
    takes, and the chiller is linear in the outlet temperature: one linear equation.

    Args:
        cell_1_k: temperature of the first cell.
        cell_n_k: temperature of the last cell.
        chiller: chiller map at the present compressor power and speed.
        outlet: channel weights of the outlet temperature.
        cooling: coolant flow and specific heat.
    """
    flow_w_k = cooling.coolant_mass_flow_kg_s * cooling.coolant_specific_heat_j_kg_k
    recirculated = outlet.inlet / flow_w_k
    # Degrees Celsius, because the chiller map is; the weights add up to one.
    cells_c = outlet.cell_1 * (cell_1_k - CELSIUS_ZERO_K) + outlet.cell_n * (
        cell_n_k - CELSIUS_ZERO_K
    )
    outlet_c = (cells_c - recirculated * chiller.offset_w) / (
        1.0 - outlet.inlet + recirculated * chiller.slope_w_k
    )
    cooling_rate_w = chiller.offset_w + chiller.slope_w_k * outlet_c
    outlet_k = outlet_c + CELSIUS_ZERO_K
    return CoolantLoop(outlet_k - cooling_rate_w / flow_w_k, outlet_k, cooling_rate_w)
