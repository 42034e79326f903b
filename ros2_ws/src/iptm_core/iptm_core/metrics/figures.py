"""Every figure of a run that anything shows: of the trip, of the decisions, and of two runs compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

from iptm_core.decision_record import DecisionStatistics, Rung, SolveStatus
from iptm_core.metrics.figure import Better, Figure
from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.metrics.trip_figures import TRIP_FIGURES


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


_ENDS = (
    "with the end of both runs made equal: packs cooled to the same temperature, motion given back"
)
_AGING = "Share of the other run's capacity loss by driving that this run avoided, below zero if it lost more"
_ENERGY = (
    "Share of the other run's battery energy per distance that this run avoided, below zero if it "
)
"took more"
SAVINGS = {
    key: Figure(key, label, "%", 1, f"{what}, {ends}.", _of_two_runs, better=Better.MORE)
    for key, label, what, ends in (
        ("aging_saved", "Ageing saved", _AGING, _ENDS),
        ("energy_saved", "Energy saved", _ENERGY, _ENDS),
        ("aging_saved_as_driven", "Ageing saved, as driven", _AGING, "whatever the ends"),
        ("energy_saved_as_driven", "Energy saved, as driven", _ENERGY, "whatever the ends"),
    )
}
"""Figures of two runs compared, by key, with the values from `Saving.values`."""

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
