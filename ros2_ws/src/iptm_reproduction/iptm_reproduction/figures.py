"""The figures of a run that the report speaks about, by name, and how changes of them are put into words."""

from __future__ import annotations

from iptm_core.metrics.figures import FIGURES, NO_VALUE, Figure

COOLING = FIGURES["cooling_energy"]
TRACTION = FIGURES["traction_energy_battery"]
TOTAL = FIGURES["battery_energy"]
"""The printed total is labelled the integral of P_b and equals traction plus cooling to the last digit. Both
hold if traction is what the pack gives for it, with what is fed back counted as the pack receives it."""
MOTOR_TRACTION = FIGURES["traction_energy"]
MOTOR_TOTAL = FIGURES["total_energy_printed"]
"""The other reading: what is fed back counts in full."""
CELL_1 = FIGURES["cell_1_degradation"]
CELL_N = FIGURES["cell_n_degradation"]
INCONSISTENCY = FIGURES["inconsistency"]
DEGRADATION = FIGURES["total_degradation"]
"""Of both cells together: what the whole-trip optimum minimises."""
CELL_1_MIN = FIGURES["cell_1_temperature_min"]
CELL_1_MEAN = FIGURES["cell_1_temperature_mean"]
CELL_N_MIN = FIGURES["cell_n_temperature_min"]
CELL_N_MEAN = FIGURES["cell_n_temperature_mean"]
CELL_N_MAX = FIGURES["cell_n_temperature_max"]
MEAN_POWER = FIGURES["mean_power"]
SMALLEST_GAP = FIGURES["smallest_gap"]
MEAN_GAP = FIGURES["mean_gap"]
SMALLEST_MARGIN = FIGURES["smallest_margin"]
MEAN_COP = FIGURES["mean_cop"]
GAP_VIOLATIONS = FIGURES["gap_violations"]
HARD_VIOLATIONS = FIGURES["hard_violations"]
SOFT_VIOLATIONS = FIGURES["soft_violations"]
COMPUTING_TIME = FIGURES["solve_total"]
LONGEST_SOLVE = FIGURES["solve_max"]
FALLBACKS = FIGURES["fallbacks"]
FAILED_SOLVES = FIGURES["failed_solves"]
SOLVES_FEASIBLE = FIGURES["solves_feasible"]
LIMITER_TICKS = FIGURES["limiter_ticks"]

TABLE_FIGURES = (COOLING, TRACTION, TOTAL, CELL_1, CELL_N, INCONSISTENCY)
"""The rows of the paper's results table, in its order."""
ENERGIES = (COOLING, TRACTION, TOTAL)
CELLS = (CELL_1, CELL_N)
MEAN_TEMPERATURES = (CELL_1_MEAN, CELL_N_MEAN)
FOUR = (COOLING, TRACTION, CELL_1, CELL_N)
"""What most of the paper's sensitivity figures show."""

DASH = NO_VALUE


def relative_change(value: float | None, base: float | None) -> float | None:
    """Return the change of a figure relative to a base, None where it does not exist."""
    if value is None or base is None or base == 0.0:
        return None
    return value / base - 1.0


def change_text(change: float | None) -> str:
    """Return a relative change in percent with its sign; a dash for None."""
    return DASH if change is None else f"{100.0 * change:+.2f} %"


def share_of_saving(value: float, reference: float, optimum: float) -> float | None:
    """Return the part of the possible saving that a run reaches.

    Args:
        value: figure of the run.
        reference: figure of the reference strategy, where nothing is saved.
        optimum: figure of the whole-trip optimum, where everything possible is saved.

    Returns:
        0 for the reference, 1 for the optimum; None if the optimum saves nothing.
    """
    possible = reference - optimum
    return None if possible <= 0.0 else (reference - value) / possible


def label(figure: Figure) -> str:
    """Return the name of a figure as it stands inside a sentence."""
    return figure.label[0].lower() + figure.label[1:]


def labels(figures: tuple[Figure, ...]) -> str:
    """Return the names of several figures as they stand inside a sentence."""
    return ", ".join(map(label, figures))
