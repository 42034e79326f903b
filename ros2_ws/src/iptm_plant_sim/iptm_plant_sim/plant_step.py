"""Results of one interval of the simulated vehicle, and the measurements of its battery."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from iptm_core.frozen import light, replace
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import at_charge, pack_capacity_ah
from iptm_core.state import BatteryReading, FullChannelState, PlantObservation
from iptm_plant_sim.actuators import ActuatorReport
from iptm_plant_sim.interval_model import cell_voltage_v
from iptm_plant_sim.safety_monitor import MonitorMemory


@light
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
