"""The scalar figures of a run that tables, plots and verdicts speak about, by key.

The keys are those of the rows that `iptm_studies.summary` works out for every run; here they get the names
and digits of a printed table.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_controller.solvers.result import SolveStatus
from iptm_studies.summary import RunSummary


@dataclass(frozen=True)
class Measure:
    """How a figure is called and printed.

    Attributes:
        key: identifier.
        label: text of a table row.
        unit: unit, empty for a count.
        decimals: digits after the point in tables.
        compared: whether its change relative to a reference run says something.
        short: label for narrow places; empty for the label itself.
    """

    key: str
    label: str
    unit: str
    decimals: int
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
        """Print a value without its unit; a dash where there is none."""
        if value is None or not np.isfinite(value):
            return "–"
        return f"{value:,.{self.decimals}f}".replace(",", " ")

    def with_unit(self, value: float | None) -> str:
        """Print a value with its unit; powers of ten are factors."""
        joint = "·" if self.unit.startswith("10") else " "
        return f"{self.text(value)}{joint}{self.unit}" if self.unit else self.text(value)


MEASURES: dict[str, Measure] = {
    measure.key: measure
    for measure in (
        Measure("cooling_energy", "Cooling energy", "kJ", 2, compared=True),
        Measure("traction_energy", "Traction energy", "kJ", 2, compared=True),
        Measure(
            "total_energy_printed",
            "Traction + cooling energy",
            "kJ",
            2,
            compared=True,
            short="Total energy",
        ),
        Measure("battery_energy", "Battery energy ∫P_b dt", "kJ", 2, compared=True),
        Measure("cell_1_degradation", "Degradation of cell 1", "10⁻⁵", 4, compared=True),
        Measure("cell_n_degradation", "Degradation of cell N", "10⁻⁵", 4, compared=True),
        Measure(
            "inconsistency",
            "Degradation inconsistency",
            "10⁻⁷",
            3,
            compared=True,
            short="Inconsistency",
        ),
        Measure(
            "total_degradation",
            "Degradation, both cells",
            "10⁻⁵",
            4,
            compared=True,
            short="Degradation",
        ),
        Measure("mean_cop", "Mean coefficient of performance", "", 2),
        Measure("smallest_gap", "Smallest gap", "m", 2),
        Measure("mean_gap", "Mean gap", "m", 1),
        Measure("largest_gap", "Largest gap", "m", 1),
        Measure("smallest_margin", "Smallest margin to s_min", "m", 3),
        Measure("cell_1_temperature_min", "Cell 1, lowest temperature", "°C", 2),
        Measure("cell_1_temperature_mean", "Cell 1, mean temperature", "°C", 2),
        Measure("cell_1_temperature_max", "Cell 1, highest temperature", "°C", 2),
        Measure("cell_n_temperature_min", "Cell N, lowest temperature", "°C", 2),
        Measure("cell_n_temperature_mean", "Cell N, mean temperature", "°C", 2),
        Measure("cell_n_temperature_max", "Cell N, highest temperature", "°C", 2),
        Measure("mean_power", "Mean battery power", "kW", 3, compared=True),
        Measure("peak_power", "Peak battery power", "kW", 2),
        Measure("lowest_power", "Lowest battery power", "kW", 2),
        Measure("hard_violations", "Hard limits broken", "rows", 0),
        Measure("soft_violations", "Soft limits broken", "rows", 0),
        Measure("gap_violations", "Gap limit broken", "rows", 0),
        Measure("distance", "Distance", "km", 3),
        Measure("duration", "Duration", "s", 0),
        Measure("solve_total", "Computing time", "s", 2, compared=True),
        Measure("solve_median", "Time of a solve, median", "ms", 3),
        Measure("solve_p99", "Time of a solve, 99th percentile", "ms", 3),
        Measure("solve_max", "Time of a solve, longest", "ms", 3),
        Measure("mean_iterations", "Solver iterations, mean", "", 2),
        Measure("fallbacks", "Ticks on a fallback", "ticks", 0),
        Measure("failed_solves", "Solves without a usable iterate", "ticks", 0),
        Measure("solves_feasible", "Solves stopped early, iterate usable", "ticks", 0),
        Measure("limiter_ticks", "Ticks changed by the last limiter", "ticks", 0),
    )
}
"""Every figure that a run can have, by key."""

TABLE_MEASURES = (
    "cooling_energy",
    "traction_energy",
    "total_energy_printed",
    "cell_1_degradation",
    "cell_n_degradation",
    "inconsistency",
)
"""The rows of the paper's results table, in its order."""

_UNUSABLE = tuple(status.name.lower() for status in SolveStatus if not status.usable)


def measures_of(summary: RunSummary) -> dict[str, float]:
    """Pick the figures of a run.

    Args:
        summary: what the studies work out for a stored run.

    Returns:
        Figure by key, in the unit that `MEASURES` says; keys without a value are left out.
    """
    values = summary.values()
    failed = [values.get(f"solves_{status}") for status in _UNUSABLE]
    values["failed_solves"] = None if None in failed else sum(filter(None, failed))
    return {key: value for key, value in values.items() if key in MEASURES and value is not None}


def relative_change(value: float | None, base: float | None) -> float | None:
    """Change of a figure relative to a base, None where it does not exist."""
    if value is None or base is None or base == 0.0:
        return None
    return value / base - 1.0


def change_text(change: float | None) -> str:
    """Print a relative change in percent with its sign."""
    return "–" if change is None else f"{100.0 * change:+.2f} %"


def share_of_saving(value: float, reference: float, optimum: float) -> float | None:
    """Part of the possible saving that a run reaches.

    Args:
        value: figure of the run.
        reference: figure of the reference strategy, where nothing is saved.
        optimum: figure of the whole-trip optimum, where everything possible is saved.

    Returns:
        0 for the reference, 1 for the optimum; None if the optimum saves nothing.
    """
    possible = reference - optimum
    return None if possible <= 0.0 else (reference - value) / possible
