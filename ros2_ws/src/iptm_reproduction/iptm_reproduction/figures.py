"""The figures of a run that the report is about, by key, and how they and changes are put into words."""

from __future__ import annotations

from collections.abc import Iterable

from iptm_core.metrics.figures import FIGURES, NO_VALUE

COOLING = "cooling_energy"
TRACTION = "traction_energy_battery"
TOTAL = "battery_energy"
"""The printed total is labelled the integral of P_b and equals traction plus cooling to the last digit. Both
hold if traction is what the pack gives for it, with what is fed back counted as the pack receives it."""
CELL_1 = "cell_1_degradation"
CELL_N = "cell_n_degradation"
INCONSISTENCY = "inconsistency"
DEGRADATION = "total_degradation"
"""Of both cells together: what the whole-trip optimum minimises."""
CELL_N_MEAN = "cell_n_temperature_mean"
CELL_N_MAX = "cell_n_temperature_max"
MEAN_POWER = "mean_power"
SMALLEST_GAP = "smallest_gap"
SMALLEST_MARGIN = "smallest_margin"
MEAN_COP = "mean_cop"
COMPUTING_TIME = "solve_total"

TABLE_FIGURES = (COOLING, TRACTION, TOTAL, CELL_1, CELL_N, INCONSISTENCY)
"""The rows of the paper's results table, in its order."""
FOUR = (COOLING, TRACTION, CELL_1, CELL_N)
"""What most of the paper's sensitivity figures show."""
HEADLINE_FIGURES = (COMPUTING_TIME, *TABLE_FIGURES)
"""What the paper's headline comparison states."""

DASH = NO_VALUE


def relative_change(value: float | None, base: float | None) -> float | None:
    """Return the change of a figure relative to a base, None where it does not exist."""
    if value is None or base is None or base == 0.0:
        return None
    return value / base - 1.0


def change_text(change: float | None) -> str:
    """Return a relative change in percent with its sign; a dash for None."""
    return DASH if change is None else f"{100.0 * change:+.2f} %"


def label(figure: str) -> str:
    """Return the name of a figure as it stands inside a sentence."""
    text = FIGURES[figure].label
    return text[0].lower() + text[1:]


def labels(figures: Iterable[str]) -> str:
    """Return the names of several figures as they stand inside a sentence."""
    return ", ".join(map(label, figures))
