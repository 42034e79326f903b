"""The scalar figures of a run that tables, plots and verdicts speak about, by key.

They are those of `iptm_core.metrics.figures`.
"""

from __future__ import annotations

from iptm_core.metrics import FIGURES, PAPER_TABLE, figure_values

MEASURES = FIGURES
TABLE_MEASURES = PAPER_TABLE
measures_of = figure_values


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
