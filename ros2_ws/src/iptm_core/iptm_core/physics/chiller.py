"""Cooling rate of the chiller from compressor power, paper eq. (14).

The fitted map is linear in the outlet coolant temperature, which lets the coolant loop be solved in
closed form: the map is therefore given as offset and slope. Its temperatures are degrees Celsius.

The map is a parabola over the compressor power and a fit: it is used only where it makes sense. Beyond the
power of its vertex it is held, because a compressor does not cool less for being driven harder; and a
chiller never heats the coolant, so that what it takes is not negative. Both keep the rate monotone in power.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_core.declaration import has_effect
from iptm_core.parameters.model import (
    ChillerParameters,
    CoolingParameters,
    EnvironmentParameters,
    LimitParameters,
)
from iptm_core.physics.ops import Scalar, exp, is_symbolic, maximum, minimum, where
from iptm_core.units import CELSIUS_ZERO_K, KM_H_PER_M_S


@dataclass(frozen=True)
class ChillerLine:
    """Cooling rate at one compressor power: ``gate max(offset + slope T_c,out, 0)``.

    Attributes:
        offset_w: rate of the fitted map at an outlet temperature of 0 degC.
        slope_w_k: its change with the outlet temperature, not negative.
        gate: 0 with the compressor off, 1 while it runs.
    """

    offset_w: Scalar
    slope_w_k: Scalar
    gate: Scalar

    def cooling_rate_w(self, outlet_k: Scalar, smoothing_w: float = 0.0) -> Scalar:
        """Heat taken from the coolant (Q_co) in W at an outlet temperature, never negative."""
        fitted = self.offset_w + self.slope_w_k * (outlet_k - CELSIUS_ZERO_K)
        return self.gate * maximum(fitted, 0.0, smoothing_w)


def air_mass_flow_kg_s(speed_m_s: Scalar, chiller: ChillerParameters) -> Scalar:
    """Air through the condenser (m_a); the printed coefficient takes the speed in km/h."""
    speed_km_h = KM_H_PER_M_S * speed_m_s
    return chiller.air_flow_at_rest_kg_s + chiller.air_flow_per_speed_kg_s_per_km_h * speed_km_h


def compressor_gate(power_w: Scalar, chiller: ChillerParameters) -> Scalar:
    """Smooth switch from 0 (compressor off) to 1 (running), ``1 - exp(-(P_cp / P_gate)^2)``.

    The fitted map alone would cool with the compressor off. Without a gate (P_gate = 0) it does: 1.
    """
    if not has_effect(chiller.gate_power_w):
        return 1.0
    relative = power_w / chiller.gate_power_w
    return 1.0 - exp(-relative * relative)


def largest_useful_power_w(chiller: ChillerParameters, limits: LimitParameters) -> Scalar:
    """Return the compressor power beyond which more is of no use: the vertex of the map or the limit."""
    return minimum(_vertex_w(chiller), limits.max_compressor_power_w)


def chiller_line(
    compressor_power_w: Scalar,
    speed_m_s: Scalar,
    chiller: ChillerParameters,
    cooling: CoolingParameters,
    environment: EnvironmentParameters,
) -> ChillerLine:
    """The gated chiller map (eq. 14) at a compressor power and a vehicle speed."""
    ambient_c = environment.ambient_temperature_k - CELSIUS_ZERO_K
    # The slope of the parabola vanishes at its vertex: holding it there leaves the map differentiable.
    power = compressor_power_w
    vertex = _vertex_w(chiller)
    if is_symbolic(vertex) or math.isfinite(vertex):
        power = -maximum(-power, -vertex)
    offset = (
        chiller.xi_1 * power
        + chiller.xi_2_1_w * power * power
        + chiller.xi_4_j_kg_k * ambient_c * air_mass_flow_kg_s(speed_m_s, chiller)
        + chiller.xi_6_w
    )
    # A difference of two large numbers: both coefficients keep every published digit.
    slope = chiller.xi_3_w_k + chiller.xi_5_j_kg_k * cooling.coolant_mass_flow_kg_s
    return ChillerLine(offset, slope, compressor_gate(compressor_power_w, chiller))


def _vertex_w(chiller: ChillerParameters) -> Scalar:
    """Return the power of the parabola's vertex, infinite where it opens upwards or is a line."""
    bend = chiller.xi_2_1_w
    if not is_symbolic(bend) and bend >= 0.0:
        return math.inf
    vertex = maximum(-chiller.xi_1 / (2.0 * bend), 0.0)
    return where(bend >= 0.0, math.inf, vertex) if is_symbolic(bend) else vertex
