"""Tables of runs: the figures of each, or their changes against a base run; and of whole studies.

A table is a data frame of texts as in Markdown: ``**set off**``, and a mark after what is compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import yaml

from iptm.channel_record import ChannelRecord
from iptm.studies.run import Run
from iptm_core.metrics import cold_compressor_energies_j
from iptm_core.metrics.figures import FIGURES
from iptm_reproduction.names import (
    DASH,
    OPTIMUM,
    REFERENCE,
    STUDIES,
    change_text,
    controller_name,
    name_of,
    relative_change,
    words,
)
from iptm_reproduction.printed import Verdict, graded
from iptm_reproduction.results import Results
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
                results.text(run, figure)
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
    strategy = results.cases[run].spec.strategy
    return strategy.energy_weight_1_j, strategy.aging_weight


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


def _of_all_cells(value: Callable[[list[float]], float]) -> Callable[..., str]:
    """Write a degradation over all cells of a channel, a dash where there are but two."""

    def write(results: Results, run: str, base: str) -> str:
        record, other = results[run].channel, results[base].channel
        if record is None or other is None:
            return DASH
        found = value(record["capacity_losses"])
        if run == base:
            return f"{1e5 * found:.4f}"
        return change_text(relative_change(found, value(other["capacity_losses"])))

    return write


def _of_trip(write: Callable[[Run], str]) -> Callable[..., str]:
    return lambda results, run, _base: write(results[run])


def _energy(run: Run, power_w: Any, decimals: int) -> str:
    """Write the energy of a power of a trip, shape (n,), in kJ."""
    energy_kj = 1e-3 * float(np.dot(power_w[1:], run.trajectory.intervals_s))
    return f"{energy_kj:.{decimals}f}"


def _braking_share(run: Run) -> str:
    share = share_while_braking(run.trajectory)
    return DASH if share is None else f"{100.0 * share:.1f} %"


_CELLS: dict[str, Callable[..., str]] = {
    "name": lambda _results, run, _base: name_of(run),
    "controller": _part(controller_name),
    "words": _part(words),
    "grid": _part(lambda grid: f"MH {grid}"),
    "fine_grid": _part(lambda length: f"{length} × 1 s"),
    "plant": _part({"two_cell": "two cells", "full_channel": "full channel"}.__getitem__),
    "route": lambda results, run, _base: results.cases[run].route.name,
    "figure": lambda results, run, _base, figure: results.text(run, figure),
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


class Conclusion(NamedTuple):
    """A comparison that should hold whatever varies: ``better`` is lower than ``worse`` in all figures."""

    text: str
    better: str
    worse: str
    figures: list[str]

    def holds(self, results: Results, case: str) -> bool | None:
        """Return whether it holds in a case, the address without controller; None where a run is missing."""
        pairs = [
            [results.find(f"{case}/{name}", figure) for name in (self.better, self.worse)]
            for figure in self.figures
        ]
        known = [(low, high) for low, high in pairs if low is not None and high is not None]
        return all(low < high for low, high in known) if len(known) == len(pairs) else None


@cache
def _conclusions() -> dict[str, list[Conclusion]]:
    source = Path(__file__).with_name("conclusions.yaml").read_text(encoding="utf-8")
    return {
        study: [Conclusion(*entry) for entry in entries]
        for study, entries in yaml.safe_load(source).items()
    }


def _outcomes(results: Results, study: str) -> dict[str, dict[str, bool | None]]:
    """Return whether each conclusion holds in each case, except those that no run can decide."""
    cases = dict.fromkeys(run.split("/")[1] for run in results.matching(f"{study}/*"))
    table = {
        conclusion.text: {case: conclusion.holds(results, f"{study}/{case}") for case in cases}
        for conclusion in _conclusions()[study]
    }
    return {text: marks for text, marks in table.items() if set(marks.values()) - {None}}


def conclusions(results: Results, study: str) -> pd.DataFrame:
    """Return the conclusions of a study as rows, its cases as columns."""
    outcomes = _outcomes(results, study)
    cases = dict.fromkeys(case for marks in outcomes.values() for case in marks)
    rows = []
    for text, marks in outcomes.items():
        known = [mark for mark in marks.values() if mark is not None]
        cells = (
            DASH if holds is None else marked("yes" if holds else "no", graded(holds))
            for holds in marks.values()
        )
        rows.append((text, *cells, f"{sum(known)} of {len(known)}"))
    return table_of(("conclusion", *map(words, cases), "holds in"), rows)


def conclusions_text(results: Results, study: str) -> str:
    """Return which conclusions hold throughout and which do not, in words."""
    throughout, others = [], []
    for text, marks in _outcomes(results, study).items():
        failing = [words(name) for name, mark in marks.items() if mark is False]
        if failing:
            others.append(f"{text} (not with: {', '.join(failing)})")
        else:
            throughout.append(text)
    sentences = []
    if throughout:
        sentences.append(f"Hold in every case that was run: {'; '.join(throughout)}.")
    if others:
        sentences.append(f"Depend on the case: {'; '.join(others)}.")
    return " ".join(sentences) or "Nothing to conclude from yet."


_RELIABILITY = (
    "gap_violations",
    "hard_violations",
    "soft_violations",
    "fallbacks",
    "failed_solves",
    "solves_feasible",
    "limiter_ticks",
)
_LONGEST_SOLVE = "solve_max"


def reliability(results: Results) -> pd.DataFrame:
    """Return what went wrong in any run, by study: sums and the worst run."""
    table = results.figures.reindex(columns=[*_RELIABILITY, _LONGEST_SOLVE])
    rows = []
    for study, title in STUDIES.items():
        found = table[table.index.str.startswith(f"{study}/")]
        missing = sum(address.startswith(f"{study}/") for address in results.missing)
        if len(found) or missing:
            longest = FIGURES[_LONGEST_SOLVE].text(found[_LONGEST_SOLVE].max())
            sums = (_sum_and_worst(found[figure].dropna()) for figure in _RELIABILITY)
            rows.append((title, str(len(found)), str(missing), *sums, longest))
    labels = (FIGURES[figure].label for figure in _RELIABILITY)
    return table_of(("study", "runs", "missing", *labels, "longest solve [ms]"), rows)


def _sum_and_worst(values: pd.Series) -> str:
    total = values.sum()
    if values.empty or total == 0.0:
        return DASH if values.empty else "0"
    return f"{total:.0f} ({name_of(values.idxmax())}: {values.max():.0f})"


def channel_records(results: Results) -> dict[str, ChannelRecord]:
    """Return what all cells went through, by controller."""
    runs = results.matching("full_channel/full_channel/*")
    records = {run.split("/")[2]: results[run].channel for run in runs}
    return {name: record for name, record in records.items() if record is not None}
