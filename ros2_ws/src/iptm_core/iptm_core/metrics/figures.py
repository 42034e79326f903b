"""All figures of a run: of the trip, of the decisions, and of two runs compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from operator import attrgetter

from iptm_core.decision_record import DecisionStatistics, Rung, SolveStatus
from iptm_core.metrics.constraints import Concern
from iptm_core.metrics.run_metrics import Better, Figure, RunMetrics
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
           "Electric energy of the motor, less what it fed back; without the losses of converters and cells.",
           lambda run: 1e-3 * run.traction_energy_j, "∫P_tra dt", compared=True, better=Better.LESS),
    Figure("total_energy_printed", "Traction + cooling energy", "kJ", 2,
           "Traction and cooling energy added up, which the paper's totals are; without the losses of "
           "converters and cells.",
           lambda run: 1e-3 * run.total_printed_energy_j, "∫(P_tra + P_cp + P_aux) dt",
           compared=True, better=Better.LESS),
    Figure("battery_energy", "Battery energy ∫P_b dt", "kJ", 2,
           "Current times terminal voltage: energy for driving and cooling, with the losses of converters, "
           "without the heat of the cells.",
           lambda run: 1e-3 * run.battery_energy_j, "∫P_b dt", compared=True, better=Better.LESS),
    Figure("cell_energy", "Energy of the cells ∫U_oc I dt", "kJ", 2,
           "Current times open-circuit voltage: the energy at the terminals and the heat of the cells.",
           lambda run: 1e-3 * (run.battery_energy_j + run.cell_heat_j), "∫U_oc I_b dt",
           compared=True, better=Better.LESS),
    Figure("cell_heat", "Losses of the cells", "kJ", 2,
           "Heat of the cells, ohmic and entropic: what the terminals lack of the energy of the cells.",
           lambda run: 1e-3 * run.cell_heat_j, "∫q_b dt", compared=True, better=Better.LESS),
    Figure("traction_energy_battery", "Traction energy at the battery", "kJ", 2,
           "Battery energy less cooling energy: driving at the terminals, with the losses of converters, "
           "without the heat of the cells.",
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
    Figure("unbalanced_heat_share", "Unbalanced heat over heat taken", "%", 1,
           "That heat, per heat taken by the chiller: the cooling that a comparison gets for nothing.",
           lambda run: 1e2 * run.unbalanced_heat_share),
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
    Figure("below_s_min", "Time below s_min", "s", 0, "Time with a gap below s_min in all.",
           lambda run: run.following.below_s, better=Better.LESS),
    Figure("mean_headway", "Mean headway", "s", 2, "Gap over speed, mean of the rows above 5 m/s.",
           lambda run: run.following.mean_headway_s),
    Figure("median_headway", "Median headway", "s", 2, "Gap over speed, median of the rows above 5 m/s.",
           lambda run: run.following.headway_s),
    Figure("interventions", "Interventions of the safety monitor", "", 0,
           "How often the safety monitor of the vehicle braked on its own.",
           lambda run: float(run.interventions), better=Better.LESS),
    Figure("service_braking", "Service braking by the safety monitor", "s", 1,
           "For how long the safety monitor braked in all.",
           lambda run: run.service_braking_s, better=Better.LESS),
    *_concern_figures(),
    Figure("distance", "Distance", "km", 3, "Distance driven.", lambda run: 1e-3 * run.distance_m, "p"),
    Figure("consumption", "Battery energy per distance", "kWh/100 km", 2,
           "Energy at the terminals, driving and cooling, per distance driven; motion and heat at the end "
           "are not taken into account.",
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


def figure_values(metrics: RunMetrics) -> dict[str, float]:
    """Return the figures of a run by key, in the unit of each, but those that do not exist or are unknown."""
    computed = {key: figure.compute(metrics) for key, figure in FIGURES.items()}
    return {
        key: value for key, value in computed.items() if value is not None and not math.isnan(value)
    }


def _of_decisions(
    compute: Callable[[DecisionStatistics], float], metrics: RunMetrics
) -> float | None:
    """Return a figure of the decisions; None for a run without any, or where nothing is known."""
    if metrics.decisions is None:
        return None
    value = float(compute(metrics.decisions))
    return value if math.isfinite(value) else None


_STATUSES = {
    SolveStatus.NOT_POSED: ("Ticks without a problem to solve", "no problem could be posed"),
    SolveStatus.SOLVED: ("Solves that converged", "the solver reached its tolerance"),
    SolveStatus.FEASIBLE: (
        "Solves stopped early, iterate usable",
        "the solver was stopped with an iterate that keeps dynamics and limits",
    ),
    SolveStatus.ITERATION_LIMIT: (
        "Solves at the iteration limit, iterate unusable",
        "the solver reached its largest number of iterations with an iterate that cannot be used",
    ),
    SolveStatus.DEADLINE: (
        "Solves at the time limit, iterate unusable",
        "the time was over with an iterate that cannot be used",
    ),
    SolveStatus.NUMERICAL_ERROR: ("Solves that broke off", "the solver ended with an error"),
}
_RUNGS = {
    Rung.OPTIMAL: "the command is what the strategy decides",
    Rung.SHIFTED_PLAN: "the command is the next step of the plan of an earlier tick",
    Rung.SAFE_LAW: "the safe car-following law and the thermostat give the command",
    Rung.STOP: "the controller stopped the vehicle in comfort",
    Rung.EMERGENCY_BRAKING: "the controller braked in full, as its command would have led into the leader",
}


def _decision_figures() -> Iterator[Figure]:
    # fmt: off
    rows: list[tuple[str, str, str, int, str, Callable[[DecisionStatistics], float]]] = [
        ("solve_total", "Computing time", "s", 2, "Processor time of all solves added up.",
         lambda d: d.solve_time_s["total"]),
        ("solve_median", "Time of a solve, median", "ms", 3, ("Processor time that half of the solves need "
        "at most."),
         lambda d: 1e3 * d.solve_time_s["median"]),
        ("solve_p99", "Time of a solve, 99th percentile", "ms", 3,
         "Processor time that 99 % of the solves need at most.", lambda d: 1e3 * d.solve_time_s["p99"]),
        ("solve_max", "Time of a solve, longest", "ms", 3, "Processor time of the longest solve.",
         lambda d: 1e3 * d.solve_time_s["largest"]),
        ("mean_iterations", "Solver iterations, mean", "", 2, "Iterations of the solver per tick.",
         lambda d: d.iterations["mean"]),
        ("max_iterations", "Solver iterations, most", "", 0, "Largest number of iterations in a tick.",
         lambda d: d.iterations["largest"]),
        ("fallbacks", "Ticks on a fallback", "ticks", 0,
         ("Ticks in which the vehicle carried out another command than a fresh solution: of a fallback of "
         "the controller, an earlier one, or the controlled stop."), lambda d: d.fallbacks),
        ("held", "Ticks on an earlier command", "ticks", 0,
         ("Ticks in which the vehicle carried out an earlier command, as the answer came too late. Part of "
         "the fallbacks."), lambda d: d.held),
        ("undecided", "Ticks without a decision", "ticks", 0,
         ("Ticks in which the vehicle stopped on its own for want of commands. Part of the fallbacks."),
         lambda d: d.undecided),
        ("failed_solves", "Solves without a usable iterate", "ticks", 0,
         "Ticks in which the solver had no result that can be used.", lambda d: d.failed_solves),
        ("limiter_ticks", "Ticks changed by the last limiter", "ticks", 0,
         "Ticks in which the command was cut to its limits after the decision.", lambda d: d.limited),
    ]
    # fmt: on
    for status, (label, clause) in _STATUSES.items():
        count = lambda d, status=status: d.by_status[status]  # noqa: E731
        key = f"solves_{status.name.lower()}"
        rows.append((key, label, "ticks", 0, f"Ticks in which {clause}.", count))
    for rung, clause in _RUNGS.items():
        count = lambda d, rung=rung: d.by_rung[rung]  # noqa: E731
        name = rung.name.lower()
        label = f"Commands: {name.replace('_', ' ')}"
        rows.append((f"commands_{name}", label, "ticks", 0, f"Ticks in which {clause}.", count))
    for key, label, unit, decimals, definition, compute in rows:
        value = partial(_of_decisions, compute)
        wanted = key in {"solves_solved", "commands_optimal"}
        better = Better.MORE if wanted else Better.LESS
        timed = key == "solve_total"
        yield Figure(key, label, unit, decimals, definition, value, compared=timed, better=better)


def _of_two_runs(_: RunMetrics) -> None:
    """A run alone has not saved anything; see `iptm_core.metrics.saving`."""


_ENDS = "with equal ends: packs cooled to the same temperature, motion given back; or of the trip repeated"
_ENERGY = "Share of the other run's battery energy per distance that was saved, below zero if it took more"
_AGING = (
    "Share of the other run's capacity loss by driving, by the law of the paper, that was saved"
)
_CELLS = "Share of the other run's capacity loss that was saved, of a use that charges what the trip took"
_ERROR = "Uncertainty in percentage points"
# fmt: off
SAVINGS = {
    key: Figure(key, label, "%", 1, f"{what}{' ' if what is _ERROR else ', '}{how}.", _of_two_runs,
                better=Better.NEITHER if what is _ERROR else Better.MORE)
    for key, label, what, how in (
        ("energy_saved", "Energy saved", _ENERGY, _ENDS),
        ("energy_saved_uncertainty", "Energy saved, uncertainty", _ERROR,
         "of the energy saved: half of what its ends change"),
        ("energy_saved_as_driven", "Energy saved, as driven", _ENERGY, "whatever the ends"),
        ("aging_saved_by_cells", "Ageing saved, median of cells", _CELLS,
         "median of the laws of measured cells"),
        ("aging_saved_by_cells_lowest", "Ageing saved, lowest of cells", _CELLS, "lowest of these laws"),
        ("aging_saved_by_cells_highest", "Ageing saved, highest of cells", _CELLS, "highest of these laws"),
        ("aging_saved", "Ageing saved, paper's law", _AGING, _ENDS),
        ("aging_saved_uncertainty", "Ageing saved, paper's law, uncertainty", _ERROR,
         "of the ageing saved by the paper's law: half of what its ends change"),
        ("aging_saved_as_driven", "Ageing saved, paper's law, as driven", _AGING, "whatever the ends"),
    )
}
# fmt: on
"""Figures of two runs compared, by key, with the values from `Saving.values`."""

WORTH = Figure(
    "worth",
    "Worth",
    "EUR/100 km",
    3,
    "What energy and capacity cost less than in the other run, by the law of a cell and with the hours after "
    "the trip.",
    _of_two_runs,
    better=Better.MORE,
)
"""Last figure of runs compared, with the value from `iptm_core.metrics.trip_cost`."""

FIGURES: dict[str, Figure] = {
    **TRIP_FIGURES,
    **{figure.key: figure for figure in _decision_figures()},
}
"""Every figure that a run can have, by key, in the order of tables."""

PAPER_TABLE = (
    "cooling_energy",
    "traction_energy",
    "total_energy_printed",
    "cell_1_degradation",
    "cell_n_degradation",
    "inconsistency",
)
"""Keys of the rows of the paper's results table, in its order."""
