"""Integration of the exact model over one interval of prescribed motion.

Classical Runge-Kutta of order four on the four cell states; energies, heat and charge are quadratures of
the same stages. What depends on the state of charge is taken at the start of the interval. The sub-steps are
unrolled once into a compiled expression graph of the very functions that the rest of the project uses, and
evaluated on a fixed pair of buffers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from operator import attrgetter
from typing import Any

import casadi as ca
import numpy as np

from iptm_core.frozen import light
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import at_charge, cell_heat_w, cell_resistance_ohm
from iptm_core.physics.ops import BufferedFunction, Scalar, maximum, named_function, where
from iptm_core.physics.power_thermal import (
    CellPair,
    electric_traction_power_w,
    rates_at_traction_power,
)
from iptm_core.physics.thermal_loop import reduce_channel
from iptm_core.state import ChannelCells, FloatArray
from iptm_plant_sim.actuators import Motion

STATES = (
    "cell_1_temperature_k",
    "cell_n_temperature_k",
    "cell_1_capacity_loss",
    "cell_n_capacity_loss",
)
INTEGRALS = (
    "traction_energy_j",
    "regenerated_energy_j",
    "battery_energy_j",
    "chiller_heat_j",
    "battery_heat_j",
    "charge_c",
)

AT_END = (
    "pack_current_a",
    "cell_current_a",
    "coolant_inlet_k",
    "coolant_outlet_k",
    "cell_1_voltage_v",
    "cell_n_voltage_v",
    "pack_voltage_v",
)

_POWER_RESOLUTION_W = 1e-6
_states_of = attrgetter(*STATES)


@light
@dataclass(frozen=True)
class IntervalResult:
    """Cell states and electrics at the end of an interval, and energies over it.

    Attributes:
        traction_energy_j: electric traction energy, regeneration counted negative.
        regenerated_energy_j: its negative part, before the regenerative efficiency.
        battery_energy_j: energy at the terminals, positive when discharging.
        chiller_heat_j: heat taken from the coolant.
        battery_heat_j: heat generated in all cells, ohmic and entropic.
        pack_current_a: pack current at the end, positive when discharging.
        cell_current_a: cell current at the end.
        coolant_inlet_k: channel inlet temperature at the end.
        coolant_outlet_k: channel outlet temperature at the end.
        channel: all cells of a channel at the end; None where only two are integrated.
    """

    cell_1_temperature_k: float
    cell_n_temperature_k: float
    cell_1_capacity_loss: float
    cell_n_capacity_loss: float
    traction_energy_j: float
    regenerated_energy_j: float
    battery_energy_j: float
    chiller_heat_j: float
    battery_heat_j: float
    charge_c: float
    pack_current_a: float
    cell_current_a: float
    coolant_inlet_k: float
    coolant_outlet_k: float
    cell_1_voltage_v: float
    cell_n_voltage_v: float
    pack_voltage_v: float
    channel: ChannelCells | None = None

    @property
    def finite(self) -> bool:
        """False if the pack could not deliver the power asked for at some stage."""
        return math.isfinite(self.battery_energy_j + self.charge_c + self.pack_current_a)


@dataclass(frozen=True)
class PowerBounds:
    """What of the powers is possible in an interval.

    Attributes:
        traction_w: least traction power (negative): friction brakes supply the rest.
        battery_w: largest terminal power; an interval that asks for more is not `finite`.
    """

    traction_w: float
    battery_w: float


class IntervalIntegrator:
    """Integrates intervals of a fixed number of sub-steps for one parameter set.

    Args:
        bounded: whether intervals have `PowerBounds`.
    """

    def __init__(
        self, parameters: ModelParameters, sub_steps: int, *, bounded: bool = False
    ) -> None:
        function = _build(parameters, sub_steps, bounded=bounded)
        self._found = np.empty(function.n_out())
        names = function.name_out()
        places = {name: self._found[place : place + 1] for place, name in enumerate(names)}
        self._start = np.empty(len(STATES))
        places |= {
            f"start_{name}": self._start[place : place + 1] for place, name in enumerate(STATES)
        }
        self._function, self._names = BufferedFunction(function, places), names

    def integrate(
        self,
        cells: CellPair,
        compressor_power_w: float,
        motion: Motion,
        slopes_rad: FloatArray,
        charge: float = math.nan,
        bounds: PowerBounds | None = None,
    ) -> IntervalResult:
        """Integrate one interval.

        Args:
            cells: cell states at the start.
            motion: the motion, laid out for the same number of sub-steps n.
            slopes_rad: slope at ``motion.positions_m``, shape (2 n + 1,).
            charge: state of charge at the start; NaN where nothing depends on it.
            bounds: of the interval, where it is bounded.
        """
        given = self._function.arguments
        if bounds is not None:
            given["least_traction_w"][0] = bounds.traction_w
            given["most_battery_w"][0] = bounds.battery_w
        self._start[:] = _states_of(cells)
        given["compressor_power_w"][0] = compressor_power_w
        given["lengths_s"][:] = motion.lengths_s
        given["accelerations_m_s2"][:] = motion.accelerations_m_s2
        given["slopes_rad"][:] = slopes_rad
        given["speeds_m_s"][:] = motion.speeds_m_s.ravel()
        given["charge"][0] = charge
        self._function()
        found: dict[str, Any] = dict(zip(self._names, self._found.tolist(), strict=True))
        return IntervalResult(**found)


def bound_symbols() -> dict[str, ca.SX]:
    """Return the symbols of `PowerBounds`."""
    return {name: ca.SX.sym(name) for name in ("least_traction_w", "most_battery_w")}


def deliverable(value: Scalar, battery_w: Scalar, bounds: Mapping[str, Scalar]) -> Scalar:
    """Return a value that is NaN where more power is drawn from the pack than it gives."""
    if not bounds:
        return value
    return where(battery_w > bounds["most_battery_w"] + _POWER_RESOLUTION_W, math.nan, value)


def motion_symbols(n: int) -> dict[str, ca.SX]:
    """Return the symbols of compressor power, charge and motion of an interval of n sub-steps."""
    sizes = {
        "compressor_power_w": 1,
        "lengths_s": n,
        "accelerations_m_s2": n,
        "slopes_rad": 2 * n + 1,
        "speeds_m_s": 3 * n,
        "charge": 1,
    }
    return {name: ca.SX.sym(name, size) for name, size in sizes.items()}


@lru_cache(maxsize=16)
def _build(parameters: ModelParameters, n: int, *, bounded: bool = False) -> ca.Function:
    """Return the function from the cells and `motion_symbols` to the fields of `IntervalResult`.

    Kept for the next vehicle with the same parameters, because building takes much longer than a step.
    """
    bounds = bound_symbols() if bounded else {}
    given = motion_symbols(n) | bounds
    start = {name: ca.SX.sym(f"start_{name}") for name in STATES}
    stage = _stage(parameters, bounded=bounded)

    def derivatives(step: int, stage_index: int, cells: dict[str, Scalar]) -> dict[str, Scalar]:
        # Called with symbols, a function repeats its operations, which is faster than building them.
        found = stage(
            given["speeds_m_s"][3 * step + stage_index],
            given["accelerations_m_s2"][step],
            given["slopes_rad"][2 * step + stage_index],
            given["compressor_power_w"],
            given["charge"],
            *(cells[name] for name in STATES),
            *bounds.values(),
        )
        return dict(zip(stage.name_out(), found, strict=True))

    values: dict[str, Scalar] = start | dict.fromkeys(INTEGRALS, ca.SX(0.0))
    for step in range(n):
        h = given["lengths_s"][step]
        now = {name: values[name] for name in STATES}

        def moved(
            slope: dict[str, Scalar], by: Scalar, origin: dict[str, Scalar] = now
        ) -> dict[str, Scalar]:
            return {name: origin[name] + by * slope[name] for name in STATES}

        k1 = derivatives(step, 0, now)
        k2 = derivatives(step, 1, moved(k1, 0.5 * h))
        k3 = derivatives(step, 1, moved(k2, 0.5 * h))
        k4 = derivatives(step, 2, moved(k3, h))
        for name, value in values.items():
            mean = (k1[name] + 2.0 * (k2[name] + k3[name]) + k4[name]) / 6.0
            values[name] = value + h * mean

    last = derivatives(n - 1, 2, values)
    at_end = {name: last[name] for name in AT_END}
    starts = {f"start_{name}": symbol for name, symbol in start.items()}
    return named_function("interval", starts | given, values | at_end, cse=True)


def _stage(parameters: ModelParameters, *, bounded: bool) -> ca.Function:
    """Return the function from motion and cells to the rates of STATES and INTEGRALS, and to AT_END."""
    channel = reduce_channel(parameters.cooling, parameters.pack)
    motion = ("speed_m_s", "acceleration_m_s2", "slope_rad", "compressor_power_w", "charge")
    given = {name: ca.SX.sym(name) for name in (*motion, *STATES)}
    parameters = at_charge(parameters, given["charge"])
    cells = CellPair(**{name: given[name] for name in STATES})
    speed, bounds = given["speed_m_s"], bound_symbols() if bounded else {}
    traction = electric_traction_power_w(
        speed, given["acceleration_m_s2"], given["slope_rad"], parameters
    )
    if bounds:
        traction = maximum(traction, bounds["least_traction_w"])
    rates = rates_at_traction_power(
        traction, speed, given["compressor_power_w"], cells, parameters, channel
    )
    current = rates.cell_current_a
    voltage_1, voltage_n = (
        cell_voltage_v(current, temperature_k, loss, parameters)
        for temperature_k, loss in (
            (cells.cell_1_temperature_k, cells.cell_1_capacity_loss),
            (cells.cell_n_temperature_k, cells.cell_n_capacity_loss),
        )
    )
    found = {
        "cell_1_temperature_k": rates.cell_1_temperature_rate_k_s,
        "cell_n_temperature_k": rates.cell_n_temperature_rate_k_s,
        "cell_1_capacity_loss": rates.cell_1_capacity_loss_rate_1_s,
        "cell_n_capacity_loss": rates.cell_n_capacity_loss_rate_1_s,
        "traction_energy_j": rates.traction_power_w,
        "regenerated_energy_j": rates.traction_power_w - maximum(rates.traction_power_w, 0.0),
        "battery_energy_j": rates.battery_power_w,
        "chiller_heat_j": rates.coolant.cooling_rate_w,
        "battery_heat_j": _pack_heat_w(current, cells, parameters),
        "charge_c": deliverable(rates.pack_current_a, rates.battery_power_w, bounds),
        "pack_current_a": rates.pack_current_a,
        "cell_current_a": current,
        "coolant_inlet_k": rates.coolant.inlet_k,
        "coolant_outlet_k": rates.coolant.outlet_k,
        "cell_1_voltage_v": voltage_1,
        "cell_n_voltage_v": voltage_n,
        "pack_voltage_v": 0.5 * (voltage_1 + voltage_n) * parameters.pack.cells_in_series,
    }
    arguments = {f"at_{name}": symbol for name, symbol in (given | bounds).items()}
    return named_function("stage", arguments, found)


def _pack_heat_w(current_a: Scalar, cells: CellPair, parameters: ModelParameters) -> Scalar:
    """Heat of all cells, taken as evenly spread between the two modelled ones."""
    cell, pack = parameters.cell, parameters.pack

    def heat_w(temperature_k: Scalar, capacity_loss: Scalar) -> Scalar:
        ohm = cell_resistance_ohm(temperature_k, capacity_loss, cell)
        return cell_heat_w(current_a, ohm, temperature_k, cell)

    heat_1 = heat_w(cells.cell_1_temperature_k, cells.cell_1_capacity_loss)
    heat_n = heat_w(cells.cell_n_temperature_k, cells.cell_n_capacity_loss)
    return 0.5 * (heat_1 + heat_n) * pack.cells


def cell_voltage_v(
    current_a: Scalar, temperature_k: Scalar, capacity_loss: Scalar, parameters: ModelParameters
) -> Scalar:
    """Terminal voltage of one cell in the sense of eq. (7): source less entropic and ohmic part.

    The parameters are those at a state of charge, see ``at_charge``.
    """
    cell = parameters.cell
    source = parameters.pack.open_circuit_voltage_v / parameters.pack.cells_in_series
    resistance = cell_resistance_ohm(temperature_k, capacity_loss, cell)
    return source - cell.entropic_coefficient_v_k * temperature_k - resistance * current_a
