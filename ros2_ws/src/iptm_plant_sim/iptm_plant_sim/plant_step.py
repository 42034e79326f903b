"""What is known of an interval that the simulated vehicle has driven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from iptm_core.state import PlantObservation
from iptm_plant_sim.actuators import ActuatorReport
from iptm_plant_sim.safety_monitor import MonitorMemory


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
    battery_heat_w: float
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

    Returns:
        Means of the powers, the sum of the charges, and the values at the end.
    """
    duration_s = sum(length_s for _, length_s in pieces)
    last = pieces[-1][0]
    means = {
        name: sum(getattr(step.powers, name) * part_s for step, part_s in pieces) / duration_s
        for name in ("traction_power_w", "battery_power_w", "chiller_heat_w")
    }
    clamps = dict.fromkeys(clamp for step, _ in pieces for clamp in step.report.clamps)
    regenerated_j = sum(step.regenerative_power_w * part_s for step, part_s in pieces)
    return replace(
        last,
        state=replace(last.state, time_s=end_s),
        powers=replace(last.powers, **means),
        regenerative_power_w=regenerated_j / duration_s,
        battery_heat_w=sum(step.battery_heat_w * part_s for step, part_s in pieces) / duration_s,
        charge_c=sum(step.charge_c for step, _ in pieces),
        report=replace(report, clamps=tuple(clamps)),
    )
