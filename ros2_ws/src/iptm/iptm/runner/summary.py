"""The result of a run: in a few lines, in the units people use, on the terminal and below the picture.

The same figures stand in results.json.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from iptm.run import Run
from iptm.runner.run_folder import LOGS, RunFolder
from iptm_core.decision_record import DecisionStatistics
from iptm_core.metrics.figures import PPM, figure_values
from iptm_core.metrics.run_metrics import NO_VALUE, RunMetrics, significant
from iptm_core.metrics.saving import ENERGY_SAVED, Saving
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH
from iptm_ros.topics import PLANT

OWN_AGING = "both cells, as your plant reports it"
PAPER_AGING = (
    "both cells: cyclic ageing by the paper's law while driving, not calendar ageing (studies/life)"
)


@dataclass(frozen=True)
class Summary:
    """Figures of a run for its headline; unknown ones are NaN.

    Attributes:
        values: figures by name, with units in the names.
        lines: label and text of each line.
        judgement: of the saving of ageing, empty without another run.
    """

    values: Mapping[str, float]
    lines: Sequence[tuple[str, str]]
    judgement: str = ""


def headline(run: Run) -> Summary:
    """Return the headline of a run, against the other strategy if there is one."""
    is_own = run.trip is not None and PLANT in run.trip.foreign
    return summarise(run, run.other, OWN_AGING if is_own else PAPER_AGING)


def summarise(run: Run, against: Run | None, aging_counts: str = PAPER_AGING) -> Summary:
    """Return the headline of a run."""
    metrics = run.metrics
    decisions = DecisionStatistics.of(run.decisions, run.trajectory)
    values = {**_of_run(metrics), **_of_decisions(decisions)}
    lines: list[tuple[str, str]] = []
    found: Saving | None = None
    other: dict[str, float] | None = None
    name = ""
    if against is not None:
        name, other = against.strategy, _of_run(against.metrics)
        values |= {f"{name}_{key}": value for key, value in other.items()}
        found = run.saving(against)
        values |= {f"{key}_percent": value for key, value in found.values.items()}
        values |= _at_equal_ends(found)
        lines += found.lines
        lines.append(("compared", f"with the {name} strategy{_ends(found)}"))
    lines.append(("capacity lost", f"{_aging_text(values, other, name)}, {aging_counts}"))
    lines.append(("energy used", _energy_text(values, other, name)))
    lines.append(("at the end", _end_text(values, other, name)))
    lines.append(("margin", _margin_text(values, metrics)))
    lines.extend(("limit broken", check.text) for check in metrics.broken_limits)
    lines.append(("solver", _solver_text(values, decisions)))
    return Summary(values, lines, "" if found is None else str(found.aging.judgement))


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
        "mean_headway_s": metrics.following.mean_headway_s,
        "median_headway_s": metrics.following.headway_s,
        "below_s_min_s": metrics.following.below_s,
        "longest_below_s_min_s": metrics.following.longest_below_s,
        "smallest_margin_m": metrics.smallest_margin_m,
        "smallest_margin_time_s": metrics.smallest_margin_time_s,
    }


def _of_decisions(decisions: DecisionStatistics) -> dict[str, float]:
    return {
        "solve_median_ms": 1e3 * decisions.solve_time_s["median"],
        "solve_longest_ms": 1e3 * decisions.solve_time_s["largest"],
        "decisions": float(decisions.decisions),
        "fallbacks": float(decisions.fallbacks),
        "held": float(decisions.held),
        "undecided": float(decisions.undecided),
    }


def _at_equal_ends(found: Saving) -> dict[str, float]:
    if found.ends is None:
        return {}
    own = found.ends[0]
    return {
        "equal_ends_aging_ppm": PPM * own.capacity_loss,
        "equal_ends_consumption_kwh_per_100_km": 1e5 / J_PER_KWH * own.energy_per_distance_j_m,
    }


def _ends(found: Saving) -> str:
    if found.repeated is not None:
        own, other = (each.repetitions for each in found.repeated)
        return f", the trip repeated {own} and {other} times"
    if found.ends is None:
        return ""
    cooled = significant(found.ends[0].temperature_k - CELSIUS_ZERO_K)
    return f", with equal ends (both packs cooled to {cooled} °C, motion given back)"


def _aging_text(values: Mapping[str, float], other: Mapping[str, float] | None, name: str) -> str:
    compared = f" ({name} {significant(other['aging_ppm'])})" if other else ""
    return f"{significant(values['aging_ppm'])} ppm{compared}"


def _energy_text(values: Mapping[str, float], other: Mapping[str, float] | None, name: str) -> str:
    text = f"{significant(values['energy_kwh'])} kWh from the battery"
    if math.isfinite(values["cooling_energy_kwh"]):
        text += f", {significant(values['cooling_energy_kwh'])} kWh of it for cooling"
    text += f"; {significant(values['consumption_kwh_per_100_km'])} kWh/100 km"
    if other:
        text += f" ({name} {significant(other['consumption_kwh_per_100_km'])})"
    return text


def _end_text(values: Mapping[str, float], other: Mapping[str, float] | None, name: str) -> str:
    def end(of: Mapping[str, float]) -> str:
        return (
            f"cells {significant(of['final_temperature_c'])} °C, "
            f"{significant(of['final_speed_km_h'], 0.05)} km/h, {significant(of['distance_km'])} km driven"
        )

    return end(values) + (f" ({name} {end(other)})" if other else "")


def _margin_text(values: Mapping[str, float], metrics: RunMetrics) -> str:
    gap = f"smallest gap {significant(values['smallest_gap_m'])} m"
    margin_m = values["smallest_margin_m"]
    if not math.isfinite(margin_m):
        return f"smallest gap {NO_VALUE}"
    above = "above" if margin_m >= 0.0 else "below"
    at_s = metrics.smallest_margin_time_s
    margin = f"{abs(margin_m):.2f} m {above} s_min at {at_s:g} s"
    return f"{margin}, {gap}" + ("" if metrics.broken_limits else "; no limit broken")


def _solver_text(values: Mapping[str, float], decisions: DecisionStatistics) -> str:
    if not decisions.decisions:
        return "no decisions reported"
    return (
        f"{significant(values['solve_median_ms'])} ms median, {significant(values['solve_longest_ms'])} ms "
        f"longest; {decisions.decisions} decisions, {decisions.fallbacks_text}"
    )


def print_results(run: Run, console: Console, *, full: bool = False) -> None:
    """Print the summary of a run; with `full`, all figures, decisions and limits before."""
    console.print()
    if full:
        from iptm.runner.tables import print_tables  # noqa: PLC0415  few ask for them

        print_tables(run, console)
    for warning in run.warnings:
        console.print(Text.assemble(("note  ", "yellow"), warning), soft_wrap=True)
    console.print(Text(run.name, "bold"))
    lines = Table.grid(padding=(0, 2))
    for label, text in headline(run).lines:
        lines.add_row(Text(label, "dim"), Text(text, "bold green" if label == ENERGY_SAVED else ""))
    console.print(lines)


def print_end(run: Run, folder: RunFolder, console: Console) -> None:
    """Print the files of a run, and whether it is sound."""
    # In one piece, so that the path can be copied.
    console.print(Text.assemble(("files          ", "dim"), _files(run, folder)), soft_wrap=True)
    console.print(_verdict(run))


def save_picture(path: Path, run: Run) -> None:
    """Draw a run, as a PNG file; see `Run.plot`."""
    footer = "" if run.trip is None else f"model {run.trip.model.name}"
    if run.trip is not None and math.isfinite(run.speed_up):
        mode = run.trip.conditions.mode.replace("_", "-")
        footer += f"; {mode} over ROS 2, {run.speed_up:.0f} × real time"
    picture = run.plot(run.other, footer=footer)
    path.write_bytes(picture.png({"Software": "iptm"}))


def _files(run: Run, folder: RunFolder) -> str:
    bag = [] if run.bag_messages is None else ["bag"]
    others = [
        path.name
        for path in (folder.picture, folder.report, folder.reference, folder.results)
        if path.exists()
    ]
    return f"{folder.output} ({', '.join([*bag, *others, LOGS])})"


def _verdict(run: Run) -> Text:
    if run.problems:
        return Text("\n".join(f"PROBLEM  {problem}" for problem in run.problems), "bold red")
    bag = "not recorded" if run.bag_messages is None else "bag complete"
    return Text(f"trip finished, no hard limit broken, {bag}", "bold green")
