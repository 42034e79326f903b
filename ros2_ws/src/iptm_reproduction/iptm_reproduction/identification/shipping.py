"""Writes an identified candidate as a composition and a parameter set, with where each number comes from."""

from __future__ import annotations

import itertools
import textwrap
from pathlib import Path

import pandas as pd

from iptm.studies.run_spec import REPRODUCED_CYCLE, REPRODUCED_SET
from iptm_core.parameters.loading import _sets_folder as sets_folder
from iptm_core.routes.comprehensive import compositions_folder
from iptm_reproduction.identification.evaluations import EvaluationTable, deviations, misfit
from iptm_reproduction.identification.unknowns import COMPOSITION, PARAMETERS, Candidate, Unknowns

EVALUATIONS_NAME = "evaluations.csv"
MISFIT, STRATEGY_COUNT, DEVIATION = "misfit", "strategies", "deviation"
_HEADER = "# Written by `scripts/identify ship`: fitted to the paper's strategy table alone; do not edit.\n"
_WIDTH = 110


def composition_text(candidate: Candidate) -> str:
    """Return the file of the identified composition."""
    composition = candidate.composition(REPRODUCED_CYCLE)
    reasons = _reasons(candidate.unknowns)
    lines = [
        "description: the composition identified from the paper's strategy table",
        f"order: [{', '.join(composition.order)}]",
        f"first_slope: {composition.first_slope}",
    ]
    for key, value in composition.to_dict().items():
        if key not in {"order", "first_slope"}:
            reason = reasons.get(f"{COMPOSITION}.{key}", "")
            lines += [*_wrapped(reason, "# "), f"{key}: {_number(value)}"]
    return _HEADER + "\n".join(lines) + "\n"


def set_text(candidate: Candidate) -> str:
    """Return the file of the identified parameter set."""
    unknowns = candidate.unknowns
    lines = [
        "description: identified from the paper's strategy table, with the identified composition",
        f"base: {unknowns.base_set}",
    ]
    reasons = _reasons(unknowns)
    free = {
        entry.Index.removeprefix(f"{PARAMETERS}."): entry
        for entry in unknowns.free.itertuples()  # what is settled stays as in the base
        if entry.Index.startswith(f"{PARAMETERS}.")
    }
    for group, keys in itertools.groupby(sorted(free), lambda key: key.partition(".")[0]):
        lines += ["", f"{group}:"]
        for key in keys:
            entry = free[key]
            lines += [
                f"  {key.partition('.')[2]}:",
                f"    value: {_number(candidate.values[entry.Index])}",
                f'    unit: "{entry.unit}"',
                "    source: derived",
                "    note: >",
                *_wrapped(reasons[entry.Index], "      "),
            ]
    return _HEADER + "\n".join(lines) + "\n"


def evaluations_text(table: EvaluationTable, unknowns: Unknowns) -> str:
    """Return the candidates that were driven with the aging strategy, as CSV: misfit, numbers, deviations."""
    keys = list(unknowns.free.index)
    rows = []
    for values, runs in table.by_candidate():
        if {"reference", "aging"} <= set(runs) and set(keys) <= set(values):
            pair = {name: runs[name] for name in ("reference", "aging")}
            rows.append(
                {
                    MISFIT: misfit(pair),
                    STRATEGY_COUNT: len(runs),
                    **{key: values[key] for key in keys},
                    **{
                        f"{DEVIATION}.{strategy}.{figure}": value
                        for (strategy, figure), value in deviations(pair).items()
                    },
                }
            )
    rows.sort(key=lambda row: tuple(row.values()))
    text: str = pd.DataFrame(rows).to_csv(index=False, float_format="%.5g")
    return text


def ship(candidate: Candidate, table: EvaluationTable) -> tuple[Path, ...]:
    """Write the identified composition and set where the suite finds them, and the evaluations next to them.

    Returns:
        The files.
    """
    files = {
        compositions_folder() / f"{REPRODUCED_CYCLE}.yaml": composition_text(candidate),
        sets_folder() / f"{REPRODUCED_SET}.yaml": set_text(candidate),
        Path(__file__).parent / EVALUATIONS_NAME: evaluations_text(table, candidate.unknowns),
    }
    for path, text in files.items():
        path.write_text(text, encoding="utf-8")
    return tuple(files)


def _reasons(unknowns: Unknowns) -> dict[str, str]:
    """Return a remark for every number: how it was searched for, or why it was not."""
    remarks = {
        entry.Index: f"identified between {entry.low:g} and {entry.high:g}; {entry.reason}"
        for entry in unknowns.free.itertuples()
    }
    return remarks | dict(unknowns.settled["reason"])


def _number(value: float) -> str:
    text = f"{value:.6g}"
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def _wrapped(text: str, indent: str) -> list[str]:
    lines = textwrap.wrap(" ".join(text.split()), _WIDTH - len(indent))
    return [f"{indent}{line}" for line in lines]
