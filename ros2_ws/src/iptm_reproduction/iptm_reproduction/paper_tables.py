"""The tables of the paper with this project's numbers next to the printed ones, and what was identified."""

from __future__ import annotations

from typing import Any

import pandas as pd

from iptm.studies.run_spec import REPRODUCED_SET
from iptm_controller.strategy import STRATEGIES as COST_TERMS
from iptm_core.metrics.figures import FIGURES
from iptm_core.parameters import describe_parameters, load_parameters
from iptm_core.parameters.model import to_model_unit
from iptm_reproduction import names
from iptm_reproduction.names import (
    MULTI_HORIZON,
    REFERENCE,
    STRATEGIES,
    name_of,
)
from iptm_reproduction.printed import (
    FORMULATIONS,
    PARAMETER_TABLES,
    compared,
    graded,
    printed_change,
    printed_value,
)
from iptm_reproduction.results import Results
from iptm_reproduction.tables import (
    SAVING,
    marked,
    share_text,
    strong,
    table_of,
    weight_text,
)

_SAME = 1e-9
_FURTHER_ROWS = (
    "traction_energy",
    "total_energy_printed",
    names.DEGRADATION,
    "cell_1_temperature_mean",
    names.CELL_N_MEAN,
    names.CELL_N_MAX,
    names.SMALLEST_MARGIN,
    "mean_gap",
    names.COMPUTING_TIME,
    "gap_violations",
    "hard_violations",
    "soft_violations",
    "fallbacks",
    "failed_solves",
)


def parameters(table: str) -> list[tuple[dict[str, Any], str, str]]:
    """Return a printed table of parameters: each, its printed value, and that of the reproduction, marked."""
    used = load_parameters(REPRODUCED_SET)
    ours = {row["key"]: row for row in describe_parameters(used)}
    rows = []
    for key, (printed, unit) in PARAMETER_TABLES[table].items():
        row, source = ours[key], used.sources[key]
        wanted = to_model_unit(printed, unit, row["unit"])
        same = abs(row["value"] - wanted) <= _SAME * max(1.0, abs(wanted))
        found = marked(with_unit(source.value, source.unit), graded(same))
        rows.append((row, with_unit(printed, unit), found))
    return rows


def omitted_parameters() -> list[dict[str, Any]]:
    """Return every parameter that the paper's tables do not state, and where its value comes from."""
    stated = {key for table in PARAMETER_TABLES.values() for key in table}
    rows = describe_parameters(load_parameters(REPRODUCED_SET))
    return [row for row in rows if row["key"] not in stated]


def with_unit(value: float, unit: str, text: str = ".10g") -> str:
    """Return a number with its unit, if it has one."""
    return format(value, text) if unit == "1" else f"{format(value, text)} {unit}"


def cost_terms(strategy: str) -> list[int]:
    """Return the numbers of the cost terms that a strategy has here."""
    weights = COST_TERMS[strategy].weights.values()
    return [number for number, weight in enumerate(weights, start=1) if weight > 0.0]


def terms_text(terms: list[int]) -> str:
    """Return cost terms by their symbols."""
    return " + ".join(f"J{term}" for term in terms)


def strategies(results: Results) -> pd.DataFrame:
    """Return the results table: found above printed, with the change against the reference."""
    rows: list[tuple[str, ...]] = [
        ("weights λ_P, λ_Q", "used", *(_weights(results, run) for run in STRATEGIES))
    ]
    for figure in names.TABLE_FIGURES:
        found = (_with_change(results, run, figure) for run in STRATEGIES)
        rows.append((strong(FIGURES[figure].title), "found", *found))
        rows.append(("", "printed", *(_printed(run, figure) for run in STRATEGIES)))
    for figure in _FURTHER_ROWS:
        found = (results.text(run, figure) for run in STRATEGIES)
        rows.append((FIGURES[figure].title, "found", *found))
    rows.append((SAVING, "found", *(share_text(results, run) for run in STRATEGIES)))
    return table_of(("figure", "", *(name for name, _ in FORMULATIONS.values())), rows)


def _with_change(results: Results, run: str, figure: str) -> str:
    text = results.text(run, figure)
    change = results.change(run, REFERENCE, figure)
    if run == REFERENCE or change is None:
        return text
    verdict = compared(change, printed_change(run, figure))
    return marked(f"{text} ({names.change_text(change)})", verdict)


def _printed(run: str, figure: str) -> str:
    text = FIGURES[figure].text(printed_value(run, figure))
    return (
        text if run == REFERENCE else f"{text} ({names.change_text(printed_change(run, figure))})"
    )


def _weights(results: Results, run: str) -> str:
    if run not in results:
        return names.DASH
    strategy = results.cases[run].spec.strategy
    return ", ".join(map(weight_text, (strategy.energy_weight_1_j, strategy.aging_weight)))


def headline_change(results: Results, run: str, base: str, figure: str) -> str:
    """Return a change, marked by how it compares with that of the headline."""
    change = results.change(run, base, figure)
    verdict = None if change is None else compared(change, printed_change(MULTI_HORIZON, figure))
    return marked(names.change_text(change), verdict)


def ranking_text(results: Results) -> str:
    """Return the strategies in the order of a few figures, best first, in words."""
    sentences = []
    for figure in (names.DEGRADATION, names.TOTAL, names.COOLING, names.INCONSISTENCY):
        shown = FIGURES[figure]
        known = {
            run: value for run in STRATEGIES if (value := results.find(run, figure)) is not None
        }
        order = ", ".join(
            f"{name_of(run)} ({shown.text(known[run])})"
            for run in sorted(known, key=known.__getitem__)
        )
        sentences += [f"{shown.title}: {order}."] if order else []
    return f"The strategies in order, lowest first. {' '.join(sentences)}"
