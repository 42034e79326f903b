"""Coolant in channels and loop, paper eqs. (9), (10), (14) and (15), with heater and radiator.

Along a channel the coolant passes the cells one after the other and takes up ``h (T_bc - T_c)`` from each;
the channel is computed in full or reduced to its first and last cell. ``C_f`` of eq. (10) is a heat-capacity
rate in W/K (``C_p m_c / N_m``), independent of any sampling time. All cells carry the same current, as the
paper assumes under eq. (6).

One signed power acts on the loop: positive for the compressor, negative for the heater of the coolant (an
electric resistance, or a heat pump with a constant coefficient of performance). To heat and to cool at once
only wastes energy, so one signed input loses nothing against two. The radiator needs air that moves: its
conductance rises with the power of pump and fan, the first part of the positive power, and the compressor
map begins above it,

    Q_h = COP_h max(-P, 0),    Q_r = G_r (1 - exp(-max(P, 0) / P_r)) max(T_c,out - T_a, 0).

Neither is in the paper: with P_h,max = 0 and G_r = 0 both change nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from iptm_core.declaration import has_effect
from iptm_core.errors import ParameterError
from iptm_core.parameters.model import (
    CellParameters,
    CoolingParameters,
    ModelParameters,
    PackParameters,
)
from iptm_core.physics.chiller import (
    ChillerLine,
    chiller_line,
    largest_useful_power_w,
)
from iptm_core.physics.ops import Scalar, exp, maximum
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K


def exchange_ratio(cooling: CoolingParameters, pack: PackParameters) -> float:
    """Share of the temperature difference that the coolant takes up at one cell, r = h / C_f."""
    capacity_rate_w_k = (
        cooling.coolant_specific_heat_j_kg_k * cooling.coolant_mass_flow_kg_s / pack.modules
    )
    return cooling.convective_coefficient_w_k / capacity_rate_w_k


@dataclass(frozen=True)
class ChannelWeights:
    """A coolant temperature as a weighted mean of inlet, first and last cell; the weights add up to 1."""

    inlet: Scalar
    cell_1: Scalar
    cell_n: Scalar

    def temperature_k(self, inlet_k: Scalar, cell_1_k: Scalar, cell_n_k: Scalar) -> Scalar:
        """Coolant temperature in K."""
        return self.inlet * inlet_k + self.cell_1 * cell_1_k + self.cell_n * cell_n_k


@dataclass(frozen=True)
class Channel:
    """The two-cell reduction of a channel: coolant at the last cell (T_c,Nc) and at the outlet (T_c,out)."""

    last_cell: ChannelWeights
    outlet: ChannelWeights


def reduce_channel(cooling: CoolingParameters, pack: PackParameters) -> Channel:
    """Weights of eq. (9) for a linear temperature profile between the first and the last cell.

    The linear profile is what the channel settles to when all cells heat alike; the full sum over all
    cells then collapses to three fixed weights.
    """
    ratio = exchange_ratio(cooling, pack)
    cells = pack.cells_per_channel
    return Channel(_weights_behind(cells - 1, cells, ratio), _weights_behind(cells, cells, ratio))


def _weights_behind(passed: int, cells: int, ratio: float) -> ChannelWeights:
    """Weights of the coolant temperature after ``passed`` of ``cells`` cells."""
    order = np.arange(passed)
    shares = ratio * (1.0 - ratio) ** (passed - 1 - order)
    last = order / (cells - 1)
    return ChannelWeights(
        inlet=float((1.0 - ratio) ** passed),
        cell_1=float(np.sum(shares * (1.0 - last))),
        cell_n=float(np.sum(shares * last)),
    )


@dataclass(frozen=True)
class FullChannel:
    """One coolant channel; at each cell the coolant takes up the share ``ratio`` of the difference."""

    cells: int
    ratio: float

    @classmethod
    def of(cls, cooling: CoolingParameters, pack: PackParameters) -> FullChannel:
        """Return the channel of a parameter set."""
        return cls(pack.cells_per_channel, exchange_ratio(cooling, pack))

    def coolant_k(self, inlet_k: Scalar, cells_k: Any) -> list[Scalar]:
        """Coolant temperature in front of each cell and behind the last one (eq. 9), N_c + 1 of them.

        The recursion of which eq. (9) is the sum: each cell warms the coolant by its share of the difference.
        """
        reaching = [inlet_k]
        for i in range(self.cells):
            reaching.append(reaching[-1] + self.ratio * (cells_k[i] - reaching[-1]))
        return reaching

    @property
    def outlet(self) -> ChannelWeights:
        """Weights of the outlet temperature for a channel whose cells have one temperature.

        With `equivalent_cell_k` for it they hold for any cells: the outlet is affine in the inlet, so that
        the loop closes with the chiller just as it does in the reduced channel.
        """
        passed = (1.0 - self.ratio) ** self.cells
        return ChannelWeights(inlet=passed, cell_1=1.0 - passed, cell_n=0.0)

    def equivalent_cell_k(self, cells_k: Any) -> Scalar:
        """Mean of the cell temperatures, weighted with what of each gets as far as the outlet."""
        return self.coolant_k(0.0, cells_k)[-1] / self.outlet.cell_1


def mean_cell_heat_w(
    mean_current_a: Scalar,
    mean_square_current_a2: Scalar,
    resistance_ohm: Scalar,
    temperature_k: Scalar,
    cell: CellParameters,
) -> Scalar:
    """Mean heat of a cell over instants of different current; ``cell_heat_w`` is quadratic in it."""
    entropic = mean_current_a * cell.entropic_coefficient_v_k
    return mean_square_current_a2 * resistance_ohm + entropic * temperature_k


@dataclass(frozen=True)
class ThermalActuation:
    """What becomes of the power of the actuator.

    Attributes:
        drawn_w: electric power, not negative.
        compressor_w: power of compressor, pump and fan, not negative.
        heating_w: heat into the coolant.
        radiator_w_k: conductance between the coolant outlet, where that is warmer, and the air; None
            without a radiator.
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
        smoothing_w: width of the smoothed sign change; each of the two powers is too large by half of it at
            zero power and by less than width^2 / (4 |P|) elsewhere. 0 is exact.
    """
    cooling = parameters.cooling
    drawn_w = compressor_w = power_w
    heating_w: Scalar = 0.0
    if has_effect(parameters.limits.max_heater_power_w):
        compressor_w = maximum(power_w, 0.0, smoothing_w)
        heater_w = maximum(-power_w, 0.0, smoothing_w)
        drawn_w = compressor_w + heater_w
        heating_w = cooling.heater_performance * heater_w
    radiator_w_k = None
    if has_effect(cooling.radiator_w_k):
        blown = 1.0 - exp(-compressor_w / cooling.radiator_fan_power_w)
        radiator_w_k = cooling.radiator_w_k * blown
    air_k = parameters.environment.ambient_temperature_k
    return ThermalActuation(drawn_w, compressor_w, heating_w, radiator_w_k, air_k)


_POWERS = 200
_SPEED_M_S = 10.0
_COOL_CELLS_K = 298.15


@dataclass(frozen=True)
class CoolantLoop:
    """Quasi-steady coolant temperatures around the loop.

    Attributes:
        inlet_k: channel inlet T_c,in, behind the chiller.
        outlet_k: channel outlet T_c,out, in front of the chiller.
        cooling_rate_w: heat taken from the coolant, Q_co: by the chiller, and by a radiator less the one of a
            heater.
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
    cooling_smoothing_w: float = 0.0,
    actuation: ThermalActuation | None = None,
) -> CoolantLoop:
    """Inlet and outlet temperature that agree with the chiller (eq. 15), in closed form.

    The outlet is a weighted mean of inlet and cells, the inlet is the outlet less what the chiller
    takes, and the chiller is linear in the outlet temperature: one linear equation. Where it would heat
    the coolant the chiller takes nothing; the fitted rate has the same sign in the loop and at its solution.

    Args:
        cooling_smoothing_w: width of the smoothed bound at zero cooling; 0 is exact.
    """
    flow_w_k = cooling.coolant_mass_flow_kg_s * cooling.coolant_specific_heat_j_kg_k
    recirculated = outlet.inlet / flow_w_k
    # Degrees Celsius, because the chiller map is; the weights add up to one.
    cells_c = outlet.cell_1 * (cell_1_k - CELSIUS_ZERO_K) + outlet.cell_n * (
        cell_n_k - CELSIUS_ZERO_K
    )
    taken_w: Scalar = 0.0 if actuation is None else -actuation.heating_w

    def chilled_w(cells_c: Scalar, kept: Scalar) -> Scalar:
        """What the chiller takes where the outlet is at cells_c / kept without it."""
        fitted_outlet_c = (cells_c - recirculated * chiller.gate * chiller.offset_w) / (
            kept + recirculated * chiller.gate * chiller.slope_w_k
        )
        return chiller.cooling_rate_w(fitted_outlet_c + CELSIUS_ZERO_K, cooling_smoothing_w)

    kept = 1.0 - outlet.inlet
    if actuation is not None and actuation.radiator_w_k is not None:
        # Solved as if the radiator took heat in both directions, the outlet is on the side of the air on
        # which it is without a radiator: then what the radiator takes is a heat like another.
        conductance, air_k = actuation.radiator_w_k, actuation.air_k
        open_c = cells_c + recirculated * (conductance * (air_k - CELSIUS_ZERO_K) - taken_w)
        open_kept = kept + recirculated * conductance
        open_k = (open_c - recirculated * chilled_w(open_c, open_kept)) / open_kept + CELSIUS_ZERO_K
        smoothing_k = cooling_smoothing_w / cooling.radiator_w_k
        taken_w = taken_w + conductance * maximum(open_k - air_k, 0.0, smoothing_k)
    cells_c = cells_c - recirculated * taken_w
    cooling_rate_w = chilled_w(cells_c, kept)
    outlet_k = (cells_c - recirculated * cooling_rate_w) / kept + CELSIUS_ZERO_K
    cooling_rate_w = cooling_rate_w + taken_w
    return CoolantLoop(outlet_k - cooling_rate_w / flow_w_k, outlet_k, cooling_rate_w)


def most_efficient_cooling(
    temperature_k: float, parameters: ModelParameters
) -> tuple[float, float]:
    """Return the most efficient chiller power (W) at 10 m/s, and its COP; zero if it cannot cool."""
    powers_w, loop = _cooled(temperature_k, parameters)
    rates_w = loop.cooling_rate_w
    performance = rates_w / powers_w
    best = int(np.argmax(performance))
    return float(powers_w[best]), float(performance[best])


def cooling_supply(
    temperature_k: float, parameters: ModelParameters
) -> tuple[FloatArray, FloatArray]:
    """Return what the chiller removes at 10 m/s, and the power that a watt more of it takes.

    Returns:
        Cooling rates in W, increasing from the most efficient power's, which can also be had for a part
        of the time, and the power per cooling rate at the margin, not decreasing; both empty if the
        chiller cannot cool.
    """
    powers_w, loop = _cooled(temperature_k, parameters)
    rates_w = loop.cooling_rate_w
    best = int(np.argmax(rates_w / powers_w))
    top = int(np.argmax(rates_w))
    if rates_w[best] <= 0.0:
        return np.empty(0), np.empty(0)
    margins = np.diff(powers_w[best : top + 1]) / np.diff(rates_w[best : top + 1])
    margins = np.concatenate(([powers_w[best] / rates_w[best]], margins))
    return rates_w[best : top + 1], np.maximum.accumulate(margins)


def refuse_freezing_coolant(parameters: ModelParameters, origin: str) -> None:
    """Refuse parameters with which the coolant freezes while there is still something to cool.

    The loop is taken at full useful power and 10 m/s, beside cells of 25 degC or the lower limit above it. A
    pack that passes little heat is one whose cells were exchanged and whose coefficient was not. The map as
    printed, without a gate, serves the reproduction of the paper only and is not judged.

    Raises:
        ParameterError: the coolant into the pack would be below 0 degC.
    """
    if parameters.chiller.gate_power_w == 0.0:
        return
    cells_k = max(_COOL_CELLS_K, parameters.limits.min_temperature_k)
    coolant_c = float(np.min(_cooled(cells_k, parameters)[1].inlet_k)) - CELSIUS_ZERO_K
    if coolant_c < 0.0:
        raise ParameterError(
            f"{origin}: cooling.convective_coefficient_w_k = "
            f"{parameters.cooling.convective_coefficient_w_k!r} passes too little heat from "
            f"{parameters.pack.cells} cells: at full compressor power the coolant would fall to "
            f"{coolant_c:.0f} degC beside cells of {cells_k - CELSIUS_ZERO_K:.0f} degC; allowed: coolant "
            "above freezing, by a coefficient that belongs to the size of the cell (see iptm.Vehicle), or by "
            "less limits.max_compressor_power_w"
        )


def _cooled(temperature_k: float, parameters: ModelParameters) -> tuple[FloatArray, CoolantLoop]:
    """Return powers up to the largest useful one, shape (n,), and the loop at each."""
    chiller, cooling = parameters.chiller, parameters.cooling
    largest_w = largest_useful_power_w(chiller, parameters.limits)
    powers_w = np.linspace(largest_w / _POWERS, largest_w, _POWERS, dtype=np.float64)
    line = chiller_line(powers_w, _SPEED_M_S, chiller, cooling, parameters.environment)
    outlet = reduce_channel(cooling, parameters.pack).outlet
    return powers_w, solve_coolant_loop(temperature_k, temperature_k, line, outlet, cooling)
