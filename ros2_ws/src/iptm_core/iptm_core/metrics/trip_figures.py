"""The figures of a trip: energy, ageing, gaps, temperatures, limits and the end. Add a further one here."""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter

from iptm_core.metrics.concerns import Concern
from iptm_core.metrics.figure import Better, Figure
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH, KM_H_PER_M_S

PPM = 1e6
_LEAST_DISTANCE_M = 1.0


def _per_distance(energy_j: float, distance_m: float) -> float | None:
    """Return an energy in kWh per 100 km; None for a vehicle that stands."""
    return energy_j / J_PER_KWH * 1e5 / distance_m if distance_m > _LEAST_DISTANCE_M else None


def _temperature_figures() -> Iterator[Figure]:
    for cell, symbol, place in (
        ("1", "T_bc,1", "the first cell of a coolant channel, where the coolant enters"),
        ("N", "T_bc,Nc", "the last cell of a coolant channel, where the coolant leaves"),
    ):
        values_k = attrgetter(f"cell_{cell.lower()}_k")
        for index, (suffix, word) in enumerate(
            (("min", "lowest"), ("mean", "mean"), ("max", "highest"))
        ):
            yield Figure(
                f"cell_{cell.lower()}_temperature_{suffix}",
                f"Cell {cell}, {word} temperature",
                "°C",
                2,
                f"{word.capitalize()} temperature of {place}.",
                lambda run, of=values_k, index=index: of(run)[index] - CELSIUS_ZERO_K,  # type: ignore[misc]
                f"{suffix} {symbol}",
                better=Better.LESS if suffix == "max" else Better.NEITHER,
            )


_CONCERNS = {
    Concern.SHORT_GAP: ("with the gap below s_min", "the gap was below s_min"),
    Concern.LONG_GAP: ("with the gap above s_max", "the gap was above s_max"),
    Concern.SPEED: ("with the speed out of limits", "the speed was out of its limits"),
    Concern.HOT_CELL: ("with a cell above T_b,max", "the warmer cell was above its upper limit"),
    Concern.COOLING: (
        "at full cooling without effect",
        "the compressor ran near its largest useful power and no cell became cooler",
    ),
}


def _concern_figures() -> Iterator[Figure]:
    for concern, (label, clause) in _CONCERNS.items():
        yield Figure(
            f"longest_{concern.value}",
            f"Longest time {label}",
            "s",
            0,
            f"Longest time without a break for which {clause}.",
            lambda run, concern=concern: run.longest_s[concern],  # type: ignore[misc]
            better=Better.LESS,
        )


# fmt: off
_FIGURES = (
    Figure("cooling_energy", "Cooling energy", "kJ", 2,
           "Electric energy of compressor, heater and auxiliaries of the cooling system.",
           lambda run: 1e-3 * run.cooling_energy_j, "∫(P_cp + P_aux) dt", compared=True, better=Better.LESS),
    Figure("traction_energy", "Traction energy", "kJ", 2,
           "Electric energy of the motor, less what it fed back; without the losses of the pack.",
           lambda run: 1e-3 * run.traction_energy_j, "∫P_tra dt", compared=True, better=Better.LESS),
    Figure("total_energy_printed", "Traction + cooling energy", "kJ", 2,
           "Traction and cooling energy added up, which the paper's totals are; without the losses of the "
           "pack.",
           lambda run: 1e-3 * run.total_printed_energy_j, "∫(P_tra + P_cp + P_aux) dt",
           compared=True, better=Better.LESS),
    Figure("battery_energy", "Battery energy ∫P_b dt", "kJ", 2,
           "Energy taken from the pack for driving and cooling, its losses included.",
           lambda run: 1e-3 * run.battery_energy_j, "∫P_b dt", compared=True, better=Better.LESS),
    Figure("traction_energy_battery", "Traction energy at the battery", "kJ", 2,
           "Battery energy less cooling energy: driving, with all losses of the pack.",
           lambda run: 1e-3 * (run.battery_energy_j - run.cooling_energy_j), "∫(P_b - P_cp - P_aux) dt",
           compared=True, better=Better.LESS),
    Figure("cell_1_degradation", "Degradation of cell 1", "ppm", 3,
           "Capacity that the first cell of a channel lost by driving, in millionths of the nominal "
           "capacity.",
           lambda run: PPM * run.cell_1_degradation, "Q_loss,1", compared=True, better=Better.LESS),
    Figure("cell_n_degradation", "Degradation of cell N", "ppm", 3,
           "Capacity that the last cell of a channel lost by driving, in millionths of the nominal capacity.",
           lambda run: PPM * run.cell_n_degradation, "Q_loss,Nc", compared=True, better=Better.LESS),
    Figure("inconsistency", "Degradation inconsistency", "ppm", 4,
           "By how much the last cell of a channel aged more than the first one.",
           lambda run: PPM * run.inconsistency, "Q_loss,Nc - Q_loss,1", compared=True, better=Better.LESS),
    Figure("total_degradation", "Degradation, both cells", "ppm", 3,
           "Capacity lost by driving by the first and the last cell together: the ageing that is saved or "
           "lost.",
           lambda run: PPM * run.degradation, "Q_loss,1 + Q_loss,Nc", compared=True, better=Better.LESS),
    Figure("mean_cop", "Mean coefficient of performance", "", 2,
           "Heat taken from the coolant per energy of the compressor.",
           lambda run: run.mean_cop, "∫Q_co dt / ∫P_cp dt", better=Better.MORE),
    Figure("unbalanced_heat", "Heat that the two-cell model leaves unbalanced", "kJ", 2,
           "Heat made in the cells and taken from the air, less heat taken by the chiller and stored in "
           "the cells: "
           "an error of the model.",
           lambda run: 1e-3 * run.unbalanced_heat_j, "∫(q - Q_co) dt - C ΔT"),
    Figure("smallest_gap", "Smallest gap", "m", 2, "Smallest distance to the rear bumper of the leader.",
           lambda run: run.smallest_gap_m, "min s"),
    Figure("mean_gap", "Mean gap", "m", 1, "Mean distance to the rear bumper of the leader, over time.",
           lambda run: run.mean_gap_m),
    Figure("largest_gap", "Largest gap", "m", 1, "Largest distance to the rear bumper of the leader.",
           lambda run: run.largest_gap_m, "max s"),
    Figure("smallest_margin", "Smallest margin to s_min", "m", 3,
           "Smallest gap less the distance s_min that the speeds require; below zero the limit was broken.",
           lambda run: run.smallest_margin_m, "min(s - s_min)", better=Better.MORE),
    *_temperature_figures(),
    Figure("mean_power", "Mean battery power", "kW", 3, "Battery energy per duration.",
           lambda run: 1e-3 * run.mean_battery_power_w, compared=True, better=Better.LESS),
    Figure("peak_power", "Peak battery power", "kW", 2, "Largest power drawn from the pack, as the mean "
    "of a tick.",
           lambda run: 1e-3 * run.peak_battery_power_w, "max P_b", better=Better.LESS),
    Figure("lowest_power", "Lowest battery power", "kW", 2,
           "Smallest power drawn from the pack, as the mean of a tick; below zero it was charged.",
           lambda run: 1e-3 * run.lowest_battery_power_w, "min P_b"),
    Figure("hard_violations", "Hard limits broken", "rows", 0,
           "Ticks out of a limit that no command may break, added up over these limits: acceleration, "
           "compressor "
           "power, their changes, collision, and a charge outside of 0 to 100 %.",
           lambda run: float(run.hard_violations), better=Better.LESS),
    Figure("soft_violations", "Soft limits broken", "rows", 0,
           "Ticks out of a limit that the controller may break at a price, added up over these limits: "
           "speed, gap, "
           "temperatures, smallest charge.",
           lambda run: float(run.soft_violations), better=Better.LESS),
    Figure("gap_violations", "Gap limit broken", "rows", 0, "Ticks with a gap below s_min or a collision.",
           lambda run: float(run.gap_violations), better=Better.LESS),
    Figure("interventions", "Interventions of the safety monitor", "", 0,
           "How often the safety monitor of the vehicle braked on its own.",
           lambda run: float(run.interventions), better=Better.LESS),
    Figure("service_braking", "Service braking by the safety monitor", "s", 1,
           "For how long the safety monitor braked in all.",
           lambda run: run.service_braking_s, better=Better.LESS),
    *_concern_figures(),
    Figure("distance", "Distance", "km", 3, "Distance driven.", lambda run: 1e-3 * run.distance_m, "p"),
    Figure("consumption", "Battery energy per distance", "kWh/100 km", 2,
           "Battery energy, driving and cooling, per distance driven; motion and heat left at the end are "
           "not "
           "taken into account.",
           lambda run: _per_distance(run.battery_energy_j, run.distance_m), "∫P_b dt / p",
           compared=True, better=Better.LESS),
    Figure("final_charge", "State of charge at the end", "%", 2,
           "Charge left in the pack, of its present capacity.", lambda run: 1e2 * run.final_charge, "s"),
    Figure("final_temperature", "Mean cell temperature at the end", "°C", 2,
           "Mean of the first and the last cell at the end of the trip.",
           lambda run: run.final_temperature_k - CELSIUS_ZERO_K),
    Figure("final_speed", "Speed at the end", "km/h", 1, "Speed in the last row.",
           lambda run: KM_H_PER_M_S * run.final_speed_m_s),
    Figure("final_kinetic_energy", "Kinetic energy at the end", "kJ", 1,
           "Energy of the motion in the last row, rotating parts included.",
           lambda run: 1e-3 * run.final_kinetic_energy_j, "δ m v² / 2"),
    Figure("duration", "Duration", "s", 0, "Time from the first to the last row.",
           lambda run: run.duration_s),
)
# fmt: on

TRIP_FIGURES = {figure.key: figure for figure in _FIGURES}
"""Figures of the trip itself by key, in the order of tables."""
