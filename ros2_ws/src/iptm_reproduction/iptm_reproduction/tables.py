"""Tables of runs: the figures of each, or their changes against a base run, and what was found besides.

A table is a data frame of texts as in Markdown: ``**set off**``, and a mark after what is compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from statistics import fmean
from typing import Any

import numpy as np
import pandas as pd

from iptm_core.metrics import cold_compressor_energies_j
from iptm_core.metrics.figures import FIGURES
from iptm_reproduction.names import (
    DASH,
    OPTIMUM,
    REFERENCE,
    change_text,
    controller_name,
    name_of,
    relative_change,
    words,
)
from iptm_reproduction.printed import Verdict, graded
from iptm_reproduction.results import ReportRun, Results
from iptm_reproduction.trips import mean_cell_temperature_c, share_while_braking

SAVING = "part of the possible saving of degradation"
LONG_STEP_PRICE = 0.01
"""Degradation that a multi-horizon grid may cost against 1 s steps over the same length."""
PERCENTILES = (10.0, 50.0, 90.0)
"""Where in the distribution of the power drawn the payback of cooling is looked at."""


def strong(text: str) -> str:
    """Return a text that is set off."""
    return f"**{text}**"


def marked(text: str, verdict: Verdict | None) -> str:
    """Return a text with the mark of a verdict."""
    return text if verdict is None else f"{text} {verdict.symbol}"


def table_of(head: Sequence[str], rows: Sequence[Sequence[str]]) -> pd.DataFrame:
    """Return a table of texts; a ValueError if a row has not as many cells as there are heads."""
    return pd.DataFrame([tuple(row) for row in rows], columns=list(head), dtype=object)


def figure_text(results: Results, run: str, figure: str) -> str:
    """Return a figure of a run."""
    return FIGURES[figure].text(results.find(run, figure))


def share_text(
    results: Results, run: str, reference: str = REFERENCE, optimum: str = OPTIMUM
) -> str:
    """Return the part of the possible saving of degradation that a run reaches, in percent."""
    share = results.share_of_saving(run, reference, optimum)
    return DASH if share is None else f"{100.0 * share:.1f} %"


def run_table(
    results: Results,
    runs: str | list[str],
    columns: Mapping[str, str | list[str]],
    base: str = "",
    without: str = "",
    *,
    needs_base: bool = False,
) -> pd.DataFrame:
    """Return runs as rows.

    Args:
        results: the runs.
        runs: patterns of their addresses.
        columns: a kind of cell by head, with the parts of the address that it takes and a ``!`` where the
            base run is set off; or figures under ``changes``, against the base run, which has its figures,
            and under ``values``. Their heads have units, but for ``changes by label``.
        base: address of the base run of each run; ``{1}`` is the first part of that run's address.
        without: pattern of runs to leave out.
        needs_base: whether runs are left out whose base run is missing.
    """
    patterns = [runs] if isinstance(runs, str) else runs
    bases = {
        run: base.format(*run.split("/")) for run in results.matching(*patterns, without=without)
    }
    if needs_base:
        bases = {run: found for run, found in bases.items() if found in results}
    table: dict[str, list[str]] = {}
    for head, cell in columns.items():
        if isinstance(cell, str):
            kind, *arguments = cell.split()
            write = _CELLS[kind.rstrip("!")]
            texts = {run: write(results, run, found, *arguments) for run, found in bases.items()}
            table[head] = [
                strong(text) if kind.endswith("!") and run == bases[run] else text
                for run, text in texts.items()
            ]
            continue
        what, _, by_label = head.partition(" by ")
        for figure in cell:
            shown = FIGURES[figure]
            table[shown.label if by_label else shown.title] = [
                figure_text(results, run, figure)
                if what == "values" or run == found
                else change_text(results.change(run, found, figure))
                for run, found in bases.items()
            ]
    return pd.DataFrame(table, dtype=object)


def _part(word: Callable[[str], str]) -> Callable[..., str]:
    return lambda _results, run, _base, place: word(run.split("/")[int(place)])


def _weights(results: Results, run: str) -> tuple[float, ...]:
    if run not in results:
        return ()
    return results[run].strategy.energy_weight_1_j, results[run].strategy.aging_weight


def _weighted(text: Callable[[str, tuple[float, ...]], str]) -> Callable[..., str]:
    """Write something of a run's strategy and weights, set off if the strategy table has these weights."""

    def write(results: Results, run: str, _base: str) -> str:
        used, weights = f"strategies/{run.split('/')[1]}", _weights(results, run)
        written = text(used, weights)
        return strong(written) if weights == _weights(results, used) else written

    return write


def weight_text(weight: float) -> str:
    """Return a weight, a dash for a term that a strategy has not."""
    return f"{weight:g}" if weight > 0.0 else DASH


def _cold_compressor(results: Results, run: str, _base: str) -> str:
    found = results[run]
    energies_j = cold_compressor_energies_j(found.trajectory, found.parameters)
    return f"{1e-3 * energies_j.sum():.1f}"


def _graded_change(results: Results, run: str, base: str, figure: str) -> str:
    change = results.change(run, base, figure)
    verdict = None if change is None else graded(change <= LONG_STEP_PRICE)
    return marked(change_text(change), verdict)


def _of_all_cells(value: Callable[[tuple[float, ...]], float]) -> Callable[..., str]:
    """Write a degradation over all cells of a channel, a dash where there are but two."""

    def write(results: Results, run: str, base: str) -> str:
        record, other = results[run].stored.channel, results[base].stored.channel
        if record is None or other is None:
            return DASH
        found = value(record.capacity_losses)
        if run == base:
            return f"{1e5 * found:.4f}"
        return change_text(relative_change(found, value(other.capacity_losses)))

    return write


def _of_trip(write: Callable[[ReportRun], str]) -> Callable[..., str]:
    return lambda results, run, _base: write(results[run])


def _energy(run: ReportRun, power_w: Any, decimals: int) -> str:
    """Write the energy of a power of a trip, shape (n,), in kJ."""
    energy_kj = 1e-3 * float(np.dot(power_w[1:], run.trajectory.intervals_s))
    return f"{energy_kj:.{decimals}f}"


def _braking_share(run: ReportRun) -> str:
    share = share_while_braking(run.trajectory)
    return DASH if share is None else f"{100.0 * share:.1f} %"


_CELLS: dict[str, Callable[..., str]] = {
    "name": lambda _results, run, _base: name_of(run),
    "controller": _part(controller_name),
    "words": _part(words),
    "grid": _part(lambda grid: f"MH {grid}"),
    "fine_grid": _part(lambda length: f"{length} × 1 s"),
    "plant": _part({"two_cell": "two cells", "full_channel": "full channel"}.__getitem__),
    "route": _of_trip(lambda run: run.route.name),
    "figure": lambda results, run, _base, figure: figure_text(results, run, figure),
    "share": lambda results, run, _base, *ends: share_text(results, run, *ends),
    "weighted_strategy": _weighted(lambda used, _: name_of(used)),
    "energy_weight": _weighted(lambda _, weights: weight_text(weights[0])),
    "aging_weight": _weighted(lambda _, weights: weight_text(weights[1])),
    "cold_compressor_energy": _cold_compressor,
    "graded_change": _graded_change,
    "mean_of_all_cells": _of_all_cells(fmean),
    "worst_of_all_cells": _of_all_cells(max),
    "compressor_energy": _of_trip(lambda run: _energy(run, run.trajectory.compressor_power_w, 1)),
    "braking_share": _of_trip(_braking_share),
    "drawn_energy": _of_trip(
        lambda run: _energy(run, np.maximum(run.trajectory.traction_power_w, 0.0), 0)
    ),
    "fed_back_energy": _of_trip(
        lambda run: _energy(run, np.maximum(-run.trajectory.traction_power_w, 0.0), 0)
    ),
    "mean_temperature": _of_trip(
        lambda run: f"{float(np.mean(mean_cell_temperature_c(run.trajectory))):.2f}"
    ),
}
"""Kinds of cells, from the results, a run, its base run, and arguments."""
