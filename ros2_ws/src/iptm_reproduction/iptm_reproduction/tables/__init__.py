"""Tables of the report, and the cells that they share: figures, changes, shares of the possible saving."""

from __future__ import annotations

from collections.abc import Iterable

from iptm_core.metrics.figures import Figure
from iptm_reproduction.document import Cell, Row
from iptm_reproduction.figures import DASH, DEGRADATION, TABLE_FIGURES, change_text, share_of_saving
from iptm_reproduction.runs import OPTIMUM, REFERENCE, Results

CHANGED = (*TABLE_FIGURES, DEGRADATION)
"""Figures whose changes the tables of the project's own studies show."""
SAVING = "part of the possible saving of degradation"


def figure_cell(results: Results, run: str, figure: Figure) -> Cell:
    """Return a figure of a run."""
    return Cell(figure.text(results.find(run, figure)))


def change_cell(results: Results, run: str, base: str, figure: Figure) -> Cell:
    """Return the change of a figure against a base run."""
    return Cell(change_text(results.change(run, base, figure)))


def figure_cells(results: Results, run: str, figures: Iterable[Figure]) -> Row:
    """Return several figures of a run."""
    return tuple(figure_cell(results, run, figure) for figure in figures)


def change_cells(results: Results, run: str, base: str, figures: Iterable[Figure]) -> Row:
    """Return the changes of several figures against a base run; for the base itself, its figures."""
    if run == base:
        return figure_cells(results, run, figures)
    return tuple(change_cell(results, run, base, figure) for figure in figures)


def share_cell(
    results: Results, run: str, reference: str = REFERENCE, optimum: str = OPTIMUM
) -> Cell:
    """Return the part of the possible saving of degradation that a run reaches, in percent."""
    value, nothing, everything = (
        results.find(address, DEGRADATION) for address in (run, reference, optimum)
    )
    if value is None or nothing is None or everything is None:
        return Cell(DASH)
    share = share_of_saving(value, nothing, everything)
    return Cell(DASH if share is None else f"{100.0 * share:.1f} %")
