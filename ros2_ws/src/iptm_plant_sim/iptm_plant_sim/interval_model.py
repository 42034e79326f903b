"""The model of an interval as expression graphs: rates, and a sub-step of their integration."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import casadi as ca

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import at_charge, cell_heat_w, cell_resistance_ohm
from iptm_core.physics.ops import Scalar, maximum, named_function, where
from iptm_core.physics.power_thermal import (
    CellPair,
    electric_traction_power_w,
    rates_at_traction_power,
)
from iptm_core.physics.thermal_loop import reduce_channel

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


def bound_symbols() -> dict[str, ca.SX]:
    """Return the symbols of `PowerBounds`."""
    return {name: ca.SX.sym(name) for name in ("least_traction_w", "most_battery_w")}


def deliverable(value: Scalar, battery_w: Scalar, bounds: Mapping[str, Scalar]) -> Scalar:
    """Return a value that is NaN where more power is drawn from the pack than it gives."""
    if not bounds:
        return value
    return where(battery_w > bounds["most_battery_w"] + _POWER_RESOLUTION_W, math.nan, value)


def sub_step(parameters: ModelParameters, *, bounded: bool) -> tuple[ca.Function, ca.Function]:
    """Return the functions of a sub-step, of STATES and INTEGRALS, and of AT_END at the end of the last."""
    stage = _stage(parameters, bounded=bounded)
    values = ca.SX.sym("values", len(STATES) + len(INTEGRALS))
    held = ca.SX.sym("held", 4 if bounded else 2)
    h, acceleration = ca.SX.sym("length_s"), ca.SX.sym("acceleration_m_s2")
    slopes, speeds = ca.SX.sym("slopes_rad", 3), ca.SX.sym("speeds_m_s", 3)

    def derivatives(place: int, cells: Sequence[Scalar]) -> Scalar:
        # Called with symbols, a function repeats its operations, which is faster than building them.
        given = speeds[place], acceleration, slopes[place], *ca.vertsplit(held)
        return ca.vertcat(*stage(*given, *cells))

    count, rates = len(STATES), slice(0, values.numel())
    now = values[:count]
    k1 = derivatives(0, ca.vertsplit(now))
    k2 = derivatives(1, ca.vertsplit(now + 0.5 * h * k1[:count]))
    k3 = derivatives(1, ca.vertsplit(now + 0.5 * h * k2[:count]))
    k4 = derivatives(2, ca.vertsplit(now + h * k3[:count]))
    k1, k2, k3, k4 = (each[rates] for each in (k1, k2, k3, k4))
    moved = values + h * ((k1 + 2.0 * (k2 + k3) + k4) / 6.0)
    at_end = derivatives(2, ca.vertsplit(now))[values.numel() :]
    given = {"values": values, "acceleration_m_s2": acceleration, "held": held}
    over = {"length_s": h, "slopes_rad": slopes, "speeds_m_s": speeds}
    last = {"slope_rad": slopes[2], "speed_m_s": speeds[2]}
    return (
        named_function("sub_step", given | over, {"moved": moved}, cse=True),
        named_function("interval_end", given | last, {"at_end": at_end}),
    )


def _stage(parameters: ModelParameters, *, bounded: bool) -> ca.Function:
    """Return the function from motion and cells to the rates of STATES and INTEGRALS, and to AT_END."""
    channel = reduce_channel(parameters.cooling, parameters.pack)
    motion = ("speed_m_s", "acceleration_m_s2", "slope_rad", "compressor_power_w", "charge")
    bounds = bound_symbols() if bounded else {}
    given = {name: ca.SX.sym(name) for name in motion} | bounds
    given |= {name: ca.SX.sym(name) for name in STATES}
    parameters = at_charge(parameters, given["charge"])
    cells = CellPair(**{name: given[name] for name in STATES})
    speed = given["speed_m_s"]
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
    arguments = {f"at_{name}": symbol for name, symbol in given.items()}
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
