"""Every figure of a run that anything shows: its name, symbol and unit, and how it is computed.

To show a further figure anywhere, add it here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from operator import attrgetter

from iptm_core.decision_record import DecisionStatistics, Rung, SolveStatus
from iptm_core.metrics.concerns import Concern
from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.parameters.model import CELSIUS_ZERO_K, KM_H_PER_M_S

NO_VALUE = "–"


@dataclass(frozen=True)
class Figure:
    """One figure of a run.

    Attributes:
        key: identifier, in files and on command lines.
        unit: unit of the value, empty for a pure number; powers of ten are factors.
        decimals: digits after the point where figures of several runs stand side by side.
        compute: the value from the metrics of a run; None where it does not exist.
        symbol: symbol of the paper, empty where it has none.
        compared: whether its change relative to a reference run is meaningful.
        short: label for narrow places; empty for the label itself.
    """

    key: str
    label: str
    unit: str
    decimals: int
    compute: Callable[[RunMetrics], float | None]
    symbol: str = ""
    compared: bool = False
    short: str = ""

    @property
    def title(self) -> str:
        """Label with unit, for column heads and axes."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    @property
    def short_title(self) -> str:
        """Title for narrow places."""
        label = self.short or self.label
        return f"{label} [{self.unit}]" if self.unit else label

    def text(self, value: float | None) -> str:
        """Print a value without its unit, with the digits that runs are compared by."""
        if value is None or not math.isfinite(value):
            return NO_VALUE
        return f"{value:,.{self.decimals}f}".replace(",", " ")

    def precise_text(self, value: float | None) -> str:
        """Print a value without its unit, with three significant digits, for a run that stands alone."""
        if value is None or not math.isfinite(value):
            return NO_VALUE
        if self.decimals == 0:
            return f"{value:.0f}"
        return significant(value, 10.0 ** -(self.decimals + 2))

    def with_unit(self, value: float | None) -> str:
        """Print a value with its unit."""
        joint = "·" if self.unit.startswith("10") else " "
        return f"{self.text(value)}{joint}{self.unit}" if self.unit else self.text(value)


def significant(value: float, least: float = 0.0) -> str:
    """Print a value with three significant digits, all before the point, and 0 where it is below `least`."""
    if not math.isfinite(value):
        return NO_VALUE
    if value == 0.0 or abs(value) < least:
        return "0"
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:#.3g}".rstrip(".")


def figure_values(metrics: RunMetrics) -> dict[str, float]:
    """Return the figures of a run by key, in the unit of each, but those that do not exist or are unknown."""
    computed = {key: figure.compute(metrics) for key, figure in FIGURES.items()}
    return {
        key: value for key, value in computed.items() if value is not None and not math.isnan(value)
    }


def _temperature_figures() -> Iterator[Figure]:
    for cell, symbol in (("1", "T_bc,1"), ("N", "T_bc,Nc")):
        values_k = attrgetter(f"cell_{cell.lower()}_k")
        for index, (suffix, word) in enumerate(
            (("min", "lowest"), ("mean", "mean"), ("max", "highest"))
        ):
            yield Figure(
                f"cell_{cell.lower()}_temperature_{suffix}",
                f"Cell {cell}, {word} temperature",
                "°C",
                2,
                lambda run, of=values_k, index=index: of(run)[index] - CELSIUS_ZERO_K,  # type: ignore[misc]
                f"{suffix} {symbol}",
            )


_CONCERN_LABELS = {
    Concern.SHORT_GAP: "Longest time with the gap below s_min",
    Concern.LONG_GAP: "Longest time with the gap above s_max",
    Concern.SPEED: "Longest time with the speed out of limits",
    Concern.HOT_CELL: "Longest time with a cell above T_b,max",
    Concern.COOLING: "Longest time at full cooling without effect",
}


def _concern_figures() -> Iterator[Figure]:
    for concern, label in _CONCERN_LABELS.items():
        lasted_s = lambda run, concern=concern: run.longest_s[concern]  # noqa: E731
        yield Figure(f"longest_{concern.value}", label, "s", 0, lasted_s)


def _of_decisions(
    compute: Callable[[DecisionStatistics], float], metrics: RunMetrics
) -> float | None:
    """Return a figure of the decisions; None for a run without any, or where nothing is known."""
    if metrics.decisions is None:
        return None
    value = float(compute(metrics.decisions))
    return value if math.isfinite(value) else None


J_PER_KWH = 3.6e6
_LEAST_DISTANCE_M = 1.0


def _per_distance(energy_j: float, distance_m: float) -> float | None:
    """Return an energy in kWh per 100 km; None for a vehicle that stands."""
    return energy_j / J_PER_KWH * 1e5 / distance_m if distance_m > _LEAST_DISTANCE_M else None


_STATUS_LABELS = {
    SolveStatus.NOT_POSED: "Ticks without a problem to solve",
    SolveStatus.SOLVED: "Solves that converged",
    SolveStatus.FEASIBLE: "Solves stopped early, iterate usable",
    SolveStatus.ITERATION_LIMIT: "Solves at the iteration limit, iterate unusable",
    SolveStatus.DEADLINE: "Solves at the time limit, iterate unusable",
    SolveStatus.NUMERICAL_ERROR: "Solves that broke off",
}


def _decision_figures() -> Iterator[Figure]:
    # fmt: off
    rows: list[tuple[str, str, str, int, Callable[[DecisionStatistics], float]]] = [
        ("solve_total", "Computing time", "s", 2, lambda d: d.solve_time_s["total"]),
        ("solve_median", "Time of a solve, median", "ms", 3, lambda d: 1e3 * d.solve_time_s["median"]),
        ("solve_p99", "Time of a solve, 99th percentile", "ms", 3, lambda d: 1e3 * d.solve_time_s["p99"]),
        ("solve_max", "Time of a solve, longest", "ms", 3, lambda d: 1e3 * d.solve_time_s["largest"]),
        ("mean_iterations", "Solver iterations, mean", "", 2, lambda d: d.iterations["mean"]),
        ("max_iterations", "Solver iterations, most", "", 0, lambda d: d.iterations["largest"]),
        ("fallbacks", "Ticks on a fallback", "ticks", 0, lambda d: d.fallbacks),
        ("failed_solves", "Solves without a usable iterate", "ticks", 0, lambda d: d.failed_solves),
        ("limiter_ticks", "Ticks changed by the last limiter", "ticks", 0, lambda d: d.limited),
    ]
    # fmt: on
    for status, label in _STATUS_LABELS.items():
        count = lambda d, status=status: d.by_status[status]  # noqa: E731
        rows.append((f"solves_{status.name.lower()}", label, "ticks", 0, count))
    for rung in Rung:
        count = lambda d, rung=rung: d.by_rung[rung]  # noqa: E731
        name = rung.name.lower()
        rows.append((f"commands_{name}", f"Commands: {name.replace('_', ' ')}", "ticks", 0, count))
    for key, label, unit, decimals, compute in rows:
        value = partial(_of_decisions, compute)
        yield Figure(key, label, unit, decimals, value, compared=key == "solve_total")


# fmt: off
_TRIP_FIGURES = (
    Figure("cooling_energy", "Cooling energy", "kJ", 2,
           lambda run: 1e-3 * run.cooling_energy_j, "∫(P_cp + P_aux) dt", compared=True),
    Figure("traction_energy", "Traction energy", "kJ", 2,
           lambda run: 1e-3 * run.traction_energy_j, "∫P_tra dt", compared=True),
    Figure("total_energy_printed", "Traction + cooling energy", "kJ", 2,
           lambda run: 1e-3 * run.total_printed_energy_j, "∫(P_tra + P_cp + P_aux) dt",
           compared=True, short="Total energy"),
    Figure("battery_energy", "Battery energy ∫P_b dt", "kJ", 2,
           lambda run: 1e-3 * run.battery_energy_j, "∫P_b dt", compared=True),
    Figure("traction_energy_battery", "Traction energy at the battery", "kJ", 2,
           lambda run: 1e-3 * (run.battery_energy_j - run.cooling_energy_j), "∫(P_b - P_cp - P_aux) dt",
           compared=True),
    Figure("cell_1_degradation", "Degradation of cell 1", "10⁻⁵", 4,
           lambda run: 1e5 * run.cell_1_degradation, "Q_loss,1", compared=True),
    Figure("cell_n_degradation", "Degradation of cell N", "10⁻⁵", 4,
           lambda run: 1e5 * run.cell_n_degradation, "Q_loss,Nc", compared=True),
    Figure("inconsistency", "Degradation inconsistency", "10⁻⁷", 3,
           lambda run: 1e7 * run.inconsistency, "Q_loss,Nc - Q_loss,1",
           compared=True, short="Inconsistency"),
    Figure("total_degradation", "Degradation, both cells", "10⁻⁵", 4,
           lambda run: 1e5 * run.degradation, "Q_loss,1 + Q_loss,Nc",
           compared=True, short="Degradation"),
    Figure("mean_cop", "Mean coefficient of performance", "", 2,
           lambda run: run.mean_cop, "∫Q_co dt / ∫P_cp dt"),
    Figure("unbalanced_heat", "Heat that the two-cell model leaves unbalanced", "kJ", 2,
           lambda run: 1e-3 * run.unbalanced_heat_j, "∫(q - Q_co) dt - C ΔT"),
    Figure("smallest_gap", "Smallest gap", "m", 2, lambda run: run.smallest_gap_m, "min s"),
    Figure("mean_gap", "Mean gap", "m", 1, lambda run: run.mean_gap_m),
    Figure("largest_gap", "Largest gap", "m", 1, lambda run: run.largest_gap_m, "max s"),
    Figure("smallest_margin", "Smallest margin to s_min", "m", 3,
           lambda run: run.smallest_margin_m, "min(s - s_min)"),
    *_temperature_figures(),
    Figure("mean_power", "Mean battery power", "kW", 3,
           lambda run: 1e-3 * run.mean_battery_power_w, compared=True),
    Figure("peak_power", "Peak battery power", "kW", 2,
           lambda run: 1e-3 * run.peak_battery_power_w, "max P_b"),
    Figure("lowest_power", "Lowest battery power", "kW", 2,
           lambda run: 1e-3 * run.lowest_battery_power_w, "min P_b"),
    Figure("hard_violations", "Hard limits broken", "rows", 0, lambda run: float(run.hard_violations)),
    Figure("soft_violations", "Soft limits broken", "rows", 0, lambda run: float(run.soft_violations)),
    Figure("gap_violations", "Gap limit broken", "rows", 0, lambda run: float(run.gap_violations)),
    Figure("interventions", "Interventions of the safety monitor", "", 0,
           lambda run: float(run.interventions), short="Interventions"),
    Figure("service_braking", "Service braking by the safety monitor", "s", 1,
           lambda run: run.service_braking_s),
    *_concern_figures(),
    Figure("distance", "Distance", "km", 3, lambda run: 1e-3 * run.distance_m, "p"),
    Figure("consumption", "Battery energy per distance", "kWh/100 km", 2,
           lambda run: _per_distance(run.battery_energy_j, run.distance_m), "∫P_b dt / p", compared=True),
    Figure("final_charge", "State of charge at the end", "%", 2,
           lambda run: 1e2 * run.final_charge, "s"),
    Figure("final_temperature", "Mean cell temperature at the end", "°C", 2,
           lambda run: run.final_temperature_k - CELSIUS_ZERO_K),
    Figure("final_speed", "Speed at the end", "km/h", 1, lambda run: KM_H_PER_M_S * run.final_speed_m_s),
    Figure("final_kinetic_energy", "Kinetic energy at the end", "kJ", 1,
           lambda run: 1e-3 * run.final_kinetic_energy_j, "δ m v² / 2"),
    Figure("duration", "Duration", "s", 0, lambda run: run.duration_s),
)
# fmt: on

FIGURES: dict[str, Figure] = {
    figure.key: figure for figure in (*_TRIP_FIGURES, *_decision_figures())
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

TRIP_FIGURES = tuple(figure.key for figure in _TRIP_FIGURES)
"""Keys of the figures of the trip itself; the others describe the decisions."""
