"""One interval of the simulated vehicle: its rates and sub-steps as expression graphs, and its results."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from iptm_core.frozen import replace
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import at_charge, cell_heat_w, cell_resistance_ohm, pack_capacity_ah
from iptm_core.physics.model_numbers import NUMBERS, SymbolicModel
from iptm_core.physics.ops import Scalar, maximum, named_function, where
from iptm_core.physics.power_thermal import (
    CellPair,
    electric_traction_power_w,
    rates_at_traction_power,
)
from iptm_core.state import BatteryReading, ChannelCells, FullChannelState, PlantObservation
from iptm_plant_sim.actuators import ActuatorReport
from iptm_plant_sim.safety_monitor import MonitorMemory

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


def sub_step(model: SymbolicModel, *, bounded: bool) -> tuple[ca.Function, ca.Function]:
    """Return the functions of a sub-step, of STATES and INTEGRALS, and of AT_END at the end of the last."""
    stage = _stage(model, bounded=bounded)
    values = ca.SX.sym("values", len(STATES) + len(INTEGRALS))
    held = ca.SX.sym("held", 4 if bounded else 2)
    h, acceleration = ca.SX.sym("length_s"), ca.SX.sym("acceleration_m_s2")
    slopes, speeds = ca.SX.sym("slopes_rad", 3), ca.SX.sym("speeds_m_s", 3)

    def derivatives(place: int, cells: Sequence[Scalar]) -> Scalar:
        # Called with symbols, a function repeats its operations, which is faster than building them.
        given = speeds[place], acceleration, slopes[place], *ca.vertsplit(held)
        return ca.vertcat(*stage(*given, *cells, model.numbers))

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
    over[NUMBERS] = last[NUMBERS] = model.numbers
    return (
        named_function("sub_step", given | over, {"moved": moved}, cse=True),
        named_function("interval_end", given | last, {"at_end": at_end}),
    )


def _stage(model: SymbolicModel, *, bounded: bool) -> ca.Function:
    """Return the function from motion and cells to the rates of STATES and INTEGRALS, and to AT_END."""
    motion = ("speed_m_s", "acceleration_m_s2", "slope_rad", "compressor_power_w", "charge")
    bounds = bound_symbols() if bounded else {}
    given = {name: ca.SX.sym(name) for name in motion} | bounds
    given |= {name: ca.SX.sym(name) for name in STATES}
    parameters = at_charge(model.parameters, given["charge"])
    cells = CellPair(**{name: given[name] for name in STATES})
    speed = given["speed_m_s"]
    traction = electric_traction_power_w(
        speed, given["acceleration_m_s2"], given["slope_rad"], parameters
    )
    if bounds:
        traction = maximum(traction, bounds["least_traction_w"])
    rates = rates_at_traction_power(
        traction, speed, given["compressor_power_w"], cells, parameters, model.channel
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
    return named_function("stage", {**arguments, NUMBERS: model.numbers}, found)


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


@dataclass(frozen=True)
class PlantStep(PlantObservation):
    """Observation at the end of an interval, and quantities available only in simulation.

    Powers are means over the interval; currents are positive when discharging.

    Attributes:
        regenerative_power_w: negative part of the traction power, before the regenerative efficiency.
        report: what the actuators made of the command.
        standstill: the vehicle stands at the end, held by its brakes.
        memory: what the safety monitor remembers at the end.
    """

    regenerative_power_w: float
    charge_c: float
    cell_current_a: float
    pack_current_a: float
    pack_voltage_v: float
    cell_1_voltage_v: float
    cell_n_voltage_v: float
    report: ActuatorReport
    standstill: bool
    memory: MonitorMemory


def joined(
    pieces: Sequence[tuple[PlantStep, float]], report: ActuatorReport, end_s: float
) -> PlantStep:
    """Return one step made of consecutive ones.

    Args:
        pieces: steps and their durations in s, in order.
        report: the command of the whole interval; limits that changed a piece only are added.
        end_s: trip time at the end.
    """
    duration_s = sum(length_s for _, length_s in pieces)
    last = pieces[-1][0]
    means = {
        name: sum(getattr(step.powers, name) * part_s for step, part_s in pieces) / duration_s
        for name in ("traction_power_w", "battery_power_w", "chiller_heat_w", "battery_heat_w")
    }
    clamps = dict.fromkeys(clamp for step, _ in pieces for clamp in step.report.clamps)
    regenerated_j = sum(step.regenerative_power_w * part_s for step, part_s in pieces)
    return replace(
        last,
        state=replace(last.state, time_s=end_s),
        powers=replace(last.powers, **means),
        regenerative_power_w=regenerated_j / duration_s,
        charge_c=sum(step.charge_c for step, _ in pieces),
        report=replace(report, clamps=tuple(clamps)),
    )


def battery_reading(step: PlantStep, parameters: ModelParameters) -> BatteryReading:
    """Return what can be measured at the terminals of the pack and of its cells at the end of a step."""
    state = step.state
    losses = (state.cell_1_capacity_loss, state.cell_n_capacity_loss)
    temperatures_k = (state.cell_1_temperature_k, state.cell_n_temperature_k)
    voltages_v = (step.cell_1_voltage_v, step.cell_n_voltage_v)
    if isinstance(state, FullChannelState):
        cells = state.cells
        losses = tuple(cells.capacity_losses.tolist())
        temperatures_k = tuple(cells.temperatures_k.tolist())
        voltages_v = tuple(
            cell_voltage_v(
                step.cell_current_a,
                cells.temperatures_k,
                cells.capacity_losses,
                at_charge(parameters, state.state_of_charge),
            ).tolist()
        )
    capacity_ah = pack_capacity_ah(parameters, sum(losses) / len(losses))
    return BatteryReading(
        time_s=state.time_s,
        pack_voltage_v=step.pack_voltage_v,
        pack_current_a=step.pack_current_a,
        cell_voltages_v=voltages_v,
        cell_temperatures_k=temperatures_k,
        charge_ah=state.state_of_charge * capacity_ah,
        capacity_ah=capacity_ah,
        design_capacity_ah=pack_capacity_ah(parameters, 0.0),
    )


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
