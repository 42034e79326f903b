"""Cooling rate of the chiller from compressor power, paper eq. (14).

The fitted map is linear in the outlet coolant temperature, which lets the coolant loop be solved in
closed form: the map is therefore given as offset and slope. Its temperatures are degrees Celsius.
"""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.parameters.model import (
    ChillerParameters,
    CoolingParameters,
    EnvironmentParameters,
)
from iptm_core.physics.ops import Scalar, exp

CELSIUS_ZERO_K = 273.15
KM_H_PER_M_S = 3.6


@dataclass(frozen=True)
class ChillerLine:
    """Cooling rate as a line over the outlet coolant temperature.

    Attributes:
        offset_w: cooling rate at an outlet temperature of 0 degC.
        slope_w_k: change with the outlet temperature.
    """

    offset_w: Scalar
    slope_w_k: Scalar

    def cooling_rate_w(self, outlet_k: Scalar) -> Scalar:
        """Heat taken from the coolant (Q_co) in W at an outlet temperature."""
        return self.offset_w + self.slope_w_k * (outlet_k - CELSIUS_ZERO_K)


def air_mass_flow_kg_s(speed_m_s: Scalar, chiller: ChillerParameters) -> Scalar:
    """Air through the condenser (m_a); the printed coefficient takes the speed in km/h."""
    speed_km_h = KM_H_PER_M_S * speed_m_s
    return chiller.air_flow_at_rest_kg_s + chiller.air_flow_per_speed_kg_s_per_km_h * speed_km_h


def compressor_gate(power_w: Scalar, chiller: ChillerParameters) -> Scalar:
    """Smooth switch from 0 (compressor off) to 1 (running), ``1 - exp(-(P_cp / P_gate)^2)``.

    The fitted map alone would cool with the compressor off.
    """
    relative = power_w / chiller.gate_power_w
    return 1.0 - exp(-relative * relative)


def chiller_line(
    compressor_power_w: Scalar,
    speed_m_s: Scalar,
    chiller: ChillerParameters,
    cooling: CoolingParameters,
    environment: EnvironmentParameters,
) -> ChillerLine:
    """The gated chiller map (eq. 14) at a compressor power and a vehicle speed."""
    ambient_c = environment.ambient_temperature_k - CELSIUS_ZERO_K
    gate = compressor_gate(compressor_power_w, chiller)
    offset = (
        chiller.xi_1 * compressor_power_w
        + chiller.xi_2_1_w * compressor_power_w * compressor_power_w
        + chiller.xi_4_j_kg_k * ambient_c * air_mass_flow_kg_s(speed_m_s, chiller)
        + chiller.xi_6_w
    )
    # A difference of two large numbers: both coefficients keep every published digit.
    slope = chiller.xi_3_w_k + chiller.xi_5_j_kg_k * cooling.coolant_mass_flow_kg_s
    return ChillerLine(gate * offset, gate * slope)
