"""The result of a run in a few lines, in the units people use; the same figures stand in results.json."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from iptm.run import Run
from iptm_core.decision_record import DecisionStatistics
from iptm_core.metrics import CorrectedFigures, RunMetrics, at_equal_end, figure_values
from iptm_core.metrics.figures import J_PER_KWH, NO_VALUE, significant
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_ros.topics import PLANT

AGING_SAVED = "driving aging"
PPM = 1e6
OWN_AGING = "both cells, as your plant reports it"
PAPER_AGING = (
    "both cells: cyclic aging by the paper's law while driving, not calendar aging (studies/life)"
)
EQUAL_TEMPERATURE_K = 0.1
EQUAL_SPEED_M_S = 0.1
EQUAL_DISTANCE = 1e-3
"""Differences between the ends of two runs up to which nothing is corrected; of distances, relative."""
Ends = tuple[CorrectedFigures, CorrectedFigures]
"""Figures of a run and of the one that it is compared with, corrected for their ends."""


@dataclass(frozen=True)
class Summary:
    """Figures of a run for its headline; what is unknown is NaN.

    Attributes:
        values: figures by name, with units in the names.
        lines: label and text of each line.
    """

    values: Mapping[str, float]
    lines: Sequence[tuple[str, str]]


def headline(run: Run) -> Summary:
    """Return the headline of a run, against the other strategy if there is one."""
    is_own = run.trip is not None and PLANT in run.trip.foreign
    return summarise(run, run.other, OWN_AGING if is_own else PAPER_AGING)


def summarise(run: Run, against: Run | None, aging_counts: str = PAPER_AGING) -> Summary:
    """Return the headline of a run."""
    metrics, decisions = run.metrics, DecisionStatistics.of(run.decisions)
    values = {**_of_run(metrics), **_of_decisions(decisions)}
    lines: list[tuple[str, str]] = []
    ends: Ends | None = None
    other: dict[str, float] | None = None
    name = ""
    if against is not None:
        name, other = against.strategy, _of_run(against.metrics)
        values |= {f"{name}_{key}": value for key, value in other.items()}
        values["aging_saved_percent"] = _saved_percent(values["aging_ppm"], other["aging_ppm"])
        values["consumption_saved_percent"] = _saved_percent(
            values["consumption_kwh_per_100_km"], other["consumption_kwh_per_100_km"]
        )
        if not ends_are_equal(metrics, against.metrics):
            ends = at_equal_end(metrics, against.metrics, run.parameters)
        if ends is not None:
            values |= _corrected(ends)
        lines.append((AGING_SAVED, _saved_text(values, name, ends)))
    lines.append(("capacity lost", f"{_aging_text(values, other, name)}, {aging_counts}"))
    lines.append(("energy", _energy_text(values, other, name)))
    lines.append(("at the end", _end_text(values, other, name)))
    if ends is not None:
        lines.append(("equal ends", _corrected_text(values, ends, name)))
    lines.append(("margin", _margin_text(values, metrics)))
    lines.append(("solver", _solver_text(values, decisions)))
    return Summary(values, lines)


def ends_are_equal(own: RunMetrics, other: RunMetrics) -> bool:
    """Return whether two runs end alike, so that nothing needs to be corrected."""
    return (
        abs(own.final_temperature_k - other.final_temperature_k) <= EQUAL_TEMPERATURE_K
        and abs(own.final_speed_m_s - other.final_speed_m_s) <= EQUAL_SPEED_M_S
        and abs(own.distance_m - other.distance_m) <= EQUAL_DISTANCE * other.distance_m
    )


def _of_run(metrics: RunMetrics) -> dict[str, float]:
    figures = figure_values(metrics)
    return {
        "aging_ppm": PPM * metrics.degradation,
        "energy_kwh": metrics.battery_energy_j / J_PER_KWH,
        "cooling_energy_kwh": metrics.cooling_energy_j / J_PER_KWH,
        "consumption_kwh_per_100_km": figures.get("consumption", math.nan),
        "distance_km": 1e-3 * metrics.distance_m,
        "final_temperature_c": metrics.final_temperature_k - CELSIUS_ZERO_K,
        "final_speed_km_h": figures.get("final_speed", math.nan),
        "final_kinetic_energy_kwh": metrics.final_kinetic_energy_j / J_PER_KWH,
        "smallest_gap_m": metrics.smallest_gap_m,
        "smallest_margin_m": metrics.smallest_margin_m,
        "smallest_margin_time_s": metrics.smallest_margin_time_s,
    }


def _of_decisions(decisions: DecisionStatistics) -> dict[str, float]:
    return {
        "solve_median_ms": 1e3 * decisions.solve_time_s["median"],
        "solve_longest_ms": 1e3 * decisions.solve_time_s["largest"],
        "decisions": float(decisions.decisions),
        "fallbacks": float(decisions.fallbacks),
    }


def _corrected(ends: Ends) -> dict[str, float]:
    own, other = ends
    per_100_km = 1e5 / J_PER_KWH
    return {
        "corrected_aging_ppm": PPM * own.capacity_loss,
        "corrected_aging_saved_percent": _saved_percent(own.capacity_loss, other.capacity_loss),
        "corrected_consumption_kwh_per_100_km": per_100_km * own.energy_per_distance_j_m,
        "corrected_consumption_saved_percent": _saved_percent(
            own.energy_per_distance_j_m, other.energy_per_distance_j_m
        ),
    }


def _saved_percent(own: float, other: float) -> float:
    return 100.0 * (1.0 - own / other) if other else math.nan


def _percent(saved: float) -> str:
    """Return a saving in words, such as ``49.8 % saved``."""
    if not math.isfinite(saved):
        return NO_VALUE
    return f"{significant(abs(saved), 0.05)} % {'saved' if saved >= 0.0 else 'lost'}"


def _saved_text(values: Mapping[str, float], name: str, ends: Ends | None) -> str:
    text = f"{_percent(values['aging_saved_percent'])} against the {name} strategy"
    if ends is None:
        return text
    return f"{text}, {_percent(values['corrected_aging_saved_percent'])} with equal ends"


def _aging_text(values: Mapping[str, float], other: Mapping[str, float] | None, name: str) -> str:
    compared = f" ({name} {significant(other['aging_ppm'])})" if other else ""
    return f"{significant(values['aging_ppm'])} ppm{compared}"


def _energy_text(values: Mapping[str, float], other: Mapping[str, float] | None, name: str) -> str:
    text = f"{significant(values['energy_kwh'])} kWh from the battery"
    if math.isfinite(values["cooling_energy_kwh"]):
        text += f", {significant(values['cooling_energy_kwh'])} kWh of it for cooling"
    text += f"; {significant(values['consumption_kwh_per_100_km'])} kWh/100 km"
    if other:
        reference = significant(other["consumption_kwh_per_100_km"])
        text += f" ({name} {reference}, {_percent(values['consumption_saved_percent'])})"
    return text


def _end_text(values: Mapping[str, float], other: Mapping[str, float] | None, name: str) -> str:
    def end(of: Mapping[str, float]) -> str:
        return (
            f"cells {significant(of['final_temperature_c'])} °C, "
            f"{significant(of['final_speed_km_h'], 0.05)} km/h, {significant(of['distance_km'])} km driven"
        )

    return end(values) + (f" ({name} {end(other)})" if other else "")


def _corrected_text(values: Mapping[str, float], ends: Ends, name: str) -> str:
    cooled = significant(ends[0].temperature_k - CELSIUS_ZERO_K)
    other = significant(ends[1].energy_per_distance_j_m * 1e5 / J_PER_KWH)
    return (
        f"both packs cooled to {cooled} °C, kinetic energy returned: "
        f"{significant(values['corrected_consumption_kwh_per_100_km'])} kWh/100 km "
        f"({name} {other}, {_percent(values['corrected_consumption_saved_percent'])})"
    )


def _margin_text(values: Mapping[str, float], metrics: RunMetrics) -> str:
    gap = f"smallest gap {significant(values['smallest_gap_m'])} m"
    margin_m = values["smallest_margin_m"]
    if not math.isfinite(margin_m):
        return f"smallest gap {NO_VALUE}"
    above = "above" if margin_m >= 0.0 else "below"
    at_s = metrics.smallest_margin_time_s
    margin = f"{abs(margin_m):.2f} m {above} s_min at {at_s:g} s"
    soft = metrics.soft_violations
    return f"{margin}, {gap}; " + (
        f"soft limits broken in {soft} rows" if soft else "no soft limit broken"
    )


def _solver_text(values: Mapping[str, float], decisions: DecisionStatistics) -> str:
    if not decisions.decisions:
        return "no decisions reported"
    failed = f", {decisions.fallbacks} on a fallback" if decisions.fallbacks else ", no fallback"
    return (
        f"{significant(values['solve_median_ms'])} ms median, {significant(values['solve_longest_ms'])} ms "
        f"longest; {decisions.decisions} decisions{failed}"
    )
