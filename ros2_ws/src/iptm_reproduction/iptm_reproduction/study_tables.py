"""Tables of what was found over whole studies: conclusions, reliability, every cell of the channel."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import yaml

from iptm_core.metrics.figures import FIGURES
from iptm_reproduction.names import DASH, STUDIES, name_of, words
from iptm_reproduction.printed import graded
from iptm_reproduction.results import Results
from iptm_reproduction.tables import marked, table_of
from iptm_studies.channel_record import ChannelRecord


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
    records = {run.split("/")[2]: results[run].stored.channel for run in runs}
    return {name: record for name, record in records.items() if record is not None}
