"""Cells that tables share: figures with their change, shares of the possible saving."""

from __future__ import annotations

from iptm_studies.report.document import Cell
from iptm_studies.report.measures import (
    MEASURES,
    change_text,
    relative_change,
    share_of_saving,
)
from iptm_studies.report.runs import OPTIMUM_RUN, REFERENCE_RUN, Results

DASH = "–"
AGING_KEY = "total_degradation"
"""Figure by which the distance to the optimum is measured: it is what the optimum minimises."""


def figure_cell(results: Results, address: str, key: str) -> Cell:
    """A figure of a run."""
    return Cell(MEASURES[key].text(results.measure(address, key)))


def change_cell(results: Results, address: str, base: str, key: str) -> Cell:
    """Change of a figure against a base run."""
    return Cell(
        change_text(relative_change(results.measure(address, key), results.measure(base, key)))
    )


def figure_and_change(results: Results, address: str, base: str, key: str) -> str:
    """A figure with its change against a base run in brackets; without it for the base itself."""
    text = MEASURES[key].text(results.measure(address, key))
    change = relative_change(results.measure(address, key), results.measure(base, key))
    return text if address == base or change is None else f"{text} ({change_text(change)})"


def saving_share(
    results: Results, address: str, base: str = REFERENCE_RUN, optimum: str = OPTIMUM_RUN
) -> float | None:
    """Part of the possible saving of degradation that a run reaches, None where it is not known."""
    value, reference, best = (results.measure(run, AGING_KEY) for run in (address, base, optimum))
    if value is None or reference is None or best is None:
        return None
    return share_of_saving(value, reference, best)


def share_cell(results: Results, address: str) -> Cell:
    """Part of the possible saving in percent."""
    share = saving_share(results, address)
    return Cell(DASH if share is None else f"{100.0 * share:.1f} %")
