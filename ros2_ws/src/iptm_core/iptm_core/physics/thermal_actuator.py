"""The thermal actuator: one signed power for compressor and heater, and the radiator in parallel.

Positive power drives the compressor, negative power the heater of the coolant (an electric resistance, or a
heat pump with a constant coefficient of performance). To heat and to cool at once only wastes energy, so that
one signed input loses nothing against two. The radiator needs air that moves: its conductance rises with the
power of pump and fan, which is the first part of the positive power, and the compressor map begins above it,

    Q_h = COP_h max(-P, 0),    Q_r = G_r (1 - exp(-max(P, 0) / P_r)) max(T_c,out - T_a, 0).

Neither is in the paper: with P_h,max = 0 and G_r = 0 the functions of this file change nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.ops import Scalar, exp, maximum


@dataclass(frozen=True)
class ThermalActuation:
    """What becomes of the power of the actuator.

    Attributes:
        drawn_w: electric power, not negative.
        compressor_w: power of compressor, pump and fan, not negative.
        heating_w: heat into the coolant.
        radiator_w_k: conductance between the coolant outlet, where that is warmer, and the air; None
            without a radiator.
        air_k: temperature of the air.
    """

    drawn_w: Scalar
    compressor_w: Scalar
    heating_w: Scalar
    radiator_w_k: Scalar | None
    air_k: float


def thermal_actuation(
    power_w: Scalar, parameters: ModelParameters, smoothing_w: float = 0.0
) -> ThermalActuation:
    """Split the power of the actuator.

    Args:
        power_w: power P, positive for the compressor, negative for the heater.
        parameters: of heater, radiator and air.
        smoothing_w: width of the smoothed sign change; each of the two powers is too large by half of it at
            zero power and by less than width^2 / (4 |P|) elsewhere. 0 is exact.
    """
    cooling = parameters.cooling
    drawn_w = compressor_w = power_w
    heating_w: Scalar = 0.0
    if parameters.limits.max_heater_power_w > 0.0:
        compressor_w = maximum(power_w, 0.0, smoothing_w)
        heater_w = maximum(-power_w, 0.0, smoothing_w)
        drawn_w = compressor_w + heater_w
        heating_w = cooling.heater_performance * heater_w
    radiator_w_k = None
    if cooling.radiator_w_k > 0.0:
        blown = 1.0 - exp(-compressor_w / cooling.radiator_fan_power_w)
        radiator_w_k = cooling.radiator_w_k * blown
    air_k = parameters.environment.ambient_temperature_k
    return ThermalActuation(drawn_w, compressor_w, heating_w, radiator_w_k, air_k)
