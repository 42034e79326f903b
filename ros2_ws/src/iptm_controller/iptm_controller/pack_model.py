"""Model of the two cells between ticks: how fast they warm up, and the heat that cooling takes.

Built once as expressions of the physics: a Python call per equation would be a fifth of a tick.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache

import casadi as ca

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import (
    cell_heat_w,
    cell_resistance_ohm,
    cell_temperature_rate_k_s,
    heat_from_air_w,
)
from iptm_core.physics.electrical import (
    cell_current_a,
    extended_pack_current_a,
    pack_resistance_ohm,
)
from iptm_core.physics.ops import BufferedFunction, Scalar, named_function, where
from iptm_core.physics.power_thermal import (
    CellPair,
    Smoothing,
    electric_traction_power_w,
    rates_at_traction_power,
)
from iptm_core.physics.thermal_loop import reduce_channel
from iptm_core.state import FloatArray, VehicleState

_MARGIN = 0.05
_PACK = ("speed_m_s", "compressor_power_w", "cell_1_capacity_loss", "cell_n_capacity_loss")
_RATES = ("cell_1_k_s", "cell_n_k_s")


class PackModel:
    """Evaluates the model of a parameter set."""

    def __init__(self, parameters: ModelParameters) -> None:
        self._rates, self._cooling = (BufferedFunction(each) for each in _build(parameters))

    def rates_k_s(
        self,
        state: VehicleState,
        cells_k: tuple[float, float],
        slope_rad: float | None,
        battery_power_w: float = math.nan,
        coolant_inlet_k: float = math.nan,
    ) -> tuple[float, float]:
        """Return how fast the temperatures of both cells change.

        Args:
            state: motion, compressor power and capacity losses.
            cells_k: temperatures of the cells.
            slope_rad: slope of the road; None for an impossible road, which takes no traction.
            battery_power_w: measured at the terminals; NaN takes the one of the motion.
            coolant_inlet_k: measured; NaN takes the one of the coolant loop.
        """
        given = {"acceleration_m_s2": state.acceleration_m_s2, "slope_rad": slope_rad or 0.0}
        given["has_road"] = float(slope_rad is not None)
        for name, value in (("power", battery_power_w), ("inlet", coolant_inlet_k)):
            given[f"has_{name}"] = float(math.isfinite(value))
            given[name] = value
        found = _called(self._rates, state, cells_k, given)
        return float(found[_RATES[0]][0]), float(found[_RATES[1]][0])

    def cooling_w(self, state: VehicleState, cells_k: tuple[float, float]) -> float:
        """Return the heat that the coolant loses on its way round, negative where it is heated."""
        return float(_called(self._cooling, state, cells_k, {})["cooling_w"][0])


def _called(
    function: BufferedFunction,
    state: VehicleState,
    cells_k: tuple[float, float],
    given: Mapping[str, float],
) -> dict[str, FloatArray]:
    """Return the results, which the next call overwrites."""
    arguments = function.arguments
    for name in _PACK:
        arguments[name][0] = getattr(state, name)
    arguments["speed_m_s"][0] = max(state.speed_m_s, 0.0)
    arguments["cell_1_k"][0], arguments["cell_n_k"][0] = cells_k
    for name, value in given.items():
        arguments[name][0] = value
    function()
    return function.results


@lru_cache(maxsize=16)
def _build(parameters: ModelParameters) -> tuple[ca.Function, ca.Function]:
    """Return the functions to the rates of the cells, and to the heat that the coolant loses."""
    cell, pack = parameters.cell, parameters.pack
    channel = reduce_channel(parameters.cooling, pack)
    given = {name: ca.SX.sym(name) for name in (*_PACK, "cell_1_k", "cell_n_k")}
    motion = {name: ca.SX.sym(name) for name in ("acceleration_m_s2", "slope_rad", "has_road")}
    measured = {name: ca.SX.sym(name) for name in ("has_power", "power", "has_inlet", "inlet")}
    speed, cells_k = given["speed_m_s"], (given["cell_1_k"], given["cell_n_k"])
    losses = given["cell_1_capacity_loss"], given["cell_n_capacity_loss"]

    def rates_at(traction_w: Scalar) -> Scalar:
        return rates_at_traction_power(
            traction_w,
            speed,
            given["compressor_power_w"],
            CellPair(*cells_k, *losses),
            parameters,
            channel,
            Smoothing(deliverable_margin=_MARGIN),
        )

    traction = electric_traction_power_w(
        speed, motion["acceleration_m_s2"], motion["slope_rad"], parameters
    )
    rates = rates_at(where(motion["has_road"], traction, 0.0))
    ohms = [
        cell_resistance_ohm(kelvin, loss, cell)
        for kelvin, loss in zip(cells_k, losses, strict=True)
    ]
    ohm = pack_resistance_ohm(0.5 * (ohms[0] + ohms[1]), pack)
    at_terminals = measured["power"], ohm, 0.5 * (cells_k[0] + cells_k[1]), cell, pack
    by_power = cell_current_a(extended_pack_current_a(*at_terminals, _MARGIN), pack)
    current = where(measured["has_power"], by_power, rates.cell_current_a)
    inlet_k = where(measured["has_inlet"], measured["inlet"], rates.coolant.inlet_k)
    coolants_k = inlet_k, channel.last_cell.temperature_k(inlet_k, *cells_k)
    found = {}
    for name, kelvin, ohm, coolant_k in zip(_RATES, cells_k, ohms, coolants_k, strict=True):
        heat_w = cell_heat_w(current, ohm, kelvin, cell) + heat_from_air_w(kelvin, parameters)
        found[name] = cell_temperature_rate_k_s(heat_w, kelvin, coolant_k, cell, parameters.cooling)
    cooling = {"cooling_w": rates_at(0.0).coolant.cooling_rate_w}
    return (
        named_function("pack_rates", given | motion | measured, found, cse=True),
        named_function("pack_cooling", given, cooling, cse=True),
    )
