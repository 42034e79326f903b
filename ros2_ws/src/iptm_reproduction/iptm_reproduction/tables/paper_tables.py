"""The tables of the paper, with this project's numbers next to the printed ones."""

from __future__ import annotations

from iptm_controller.strategy import STRATEGIES as COST_TERMS
from iptm_core.metrics.figures import Figure
from iptm_core.parameters import describe_parameters, load_parameters
from iptm_core.parameters.model import to_model_unit
from iptm_reproduction import figures as fig
from iptm_reproduction.check import compared, graded
from iptm_reproduction.document import Cell, Row, Table, cells
from iptm_reproduction.figures import change_text
from iptm_reproduction.printed import (
    FORMULATIONS,
    HEADLINE_CHANGES,
    HEADLINE_WHERE,
    PARAMETER_TABLES,
    STRATEGY_NOTE,
    ParameterTable,
    printed_change,
    printed_value,
)
from iptm_reproduction.runs import MULTI_HORIZON, REFERENCE, STRATEGIES, STRATEGY_NAMES, Results
from iptm_reproduction.tables import SAVING, figure_cell, share_cell
from iptm_studies.run_spec import REPRODUCED_SET

_SAME = 1e-9
_FURTHER_ROWS = (
    fig.MOTOR_TRACTION,
    fig.MOTOR_TOTAL,
    fig.DEGRADATION,
    fig.CELL_1_MEAN,
    fig.CELL_N_MEAN,
    fig.CELL_N_MAX,
    fig.SMALLEST_MARGIN,
    fig.MEAN_GAP,
    fig.COMPUTING_TIME,
    fig.GAP_VIOLATIONS,
    fig.HARD_VIOLATIONS,
    fig.SOFT_VIOLATIONS,
    fig.FALLBACKS,
    fig.FAILED_SOLVES,
)


def parameter_table(table: ParameterTable) -> Table:
    """Return a printed table of parameters with the values of the set of the reproduction."""
    used = load_parameters(REPRODUCED_SET)
    ours = {row.key: row for row in describe_parameters(used)}
    rows = []
    for key, printed, unit in table.rows:
        row, source = ours[key], used.sources[key]
        wanted = to_model_unit(printed, unit, row.unit)
        same = abs(row.value - wanted) <= _SAME * max(1.0, abs(wanted))
        rows.append(
            (
                *cells(row.symbol, key, _with_unit(printed, unit)),
                Cell(_with_unit(source.value, source.unit), graded(same)),
            )
        )
    return Table(
        f"parameters-{table.name.lower().replace(' ', '-')}",
        table.title,
        ("symbol", "parameter", "printed", "used"),
        tuple(rows),
        paper=table.name,
    )


def omitted_parameter_table() -> Table:
    """Return every parameter that the paper's tables do not state, and where its value comes from."""
    stated = {key for table in PARAMETER_TABLES for key, _, _ in table.rows}
    return Table(
        "parameters-omitted",
        "Parameters that the paper's tables do not state",
        ("symbol", "parameter", "used", "source", "remark"),
        tuple(
            cells(
                row.symbol,
                row.key,
                _with_unit(row.value, row.unit),
                row.source,
                row.note or fig.DASH,
            )
            for row in describe_parameters(load_parameters(REPRODUCED_SET))
            if row.key not in stated
        ),
    )


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.10g}" if unit == "1" else f"{value:.10g} {unit}"


def formulation_table() -> Table:
    """Return the cost terms of the six formulations, printed and used."""
    rows = []
    for strategy, (name, printed) in FORMULATIONS.items():
        used = _terms(strategy)
        rows.append(
            (*cells(name, _terms_text(printed)), Cell(_terms_text(used), graded(used == printed)))
        )
    return Table(
        "formulations",
        "Formulation settings: objective function",
        ("formulation", "printed", "used"),
        tuple(rows),
        paper="Table III",
    )


def _terms(name: str) -> tuple[int, ...]:
    """Return the numbers of the cost terms that a strategy has."""
    weights = COST_TERMS[name].weights.values()
    return tuple(number for number, weight in enumerate(weights, start=1) if weight > 0.0)


def _terms_text(terms: tuple[int, ...]) -> str:
    return " + ".join(f"J{term}" for term in terms)


def strategy_table(results: Results) -> Table:
    """Return the results table: found above printed, with the change against the reference."""
    rows: list[Row] = [
        cells("weights λ_P, λ_Q", "used", *(_weights_text(results, run) for run in STRATEGIES))
    ]
    for figure in fig.TABLE_FIGURES:
        found = (_found_cell(results, run, figure) for run in STRATEGIES)
        rows.append((Cell(figure.title, strong=True), Cell("found"), *found))
        rows.append(cells("", "printed", *(_printed_text(run, figure) for run in STRATEGIES)))
    for figure in _FURTHER_ROWS:
        found = (figure_cell(results, run, figure) for run in STRATEGIES)
        rows.append((*cells(figure.title, "found"), *found))
    rows.append((*cells(SAVING, "found"), *(share_cell(results, run) for run in STRATEGIES)))
    return Table(
        "strategies",
        "Comparisons among different strategies",
        ("figure", "", *(name for name, _ in FORMULATIONS.values())),
        tuple(rows),
        note=(
            "In brackets the change against the reference; its mark compares it with the printed "
            "change. The paper labels its total ∫P_b dt, and its numbers are the sum of traction and "
            "cooling energy: both hold if the traction row is what the pack gives for traction, with what "
            "is fed back counted by the efficiency of regeneration. It is read so; the rows with what is "
            f"fed back counted in full are given, too. {STRATEGY_NOTE}"
        ),
        paper="Table IV",
    )


def _found_cell(results: Results, run: str, figure: Figure) -> Cell:
    text = figure.text(results.find(run, figure))
    change = results.change(run, REFERENCE, figure)
    if run == REFERENCE or change is None:
        return Cell(text)
    return Cell(f"{text} ({change_text(change)})", compared(change, printed_change(run, figure)))


def _printed_text(run: str, figure: Figure) -> str:
    text = figure.text(printed_value(run, figure))
    return text if run == REFERENCE else f"{text} ({change_text(printed_change(run, figure))})"


def _weights_text(results: Results, address: str) -> str:
    run = results.get(address)
    if run is None:
        return fig.DASH
    parts = (run.strategy.energy_weight_1_j, run.strategy.aging_weight)
    return ", ".join(f"{weight:g}" if weight > 0.0 else fig.DASH for weight in parts)


def headline_table(results: Results) -> Table:
    """Return the headline comparison: values of both runs, the change found and the printed one."""
    both = (REFERENCE, MULTI_HORIZON)
    rows: list[Row] = []
    for figure, printed in HEADLINE_CHANGES.items():
        change = results.change(MULTI_HORIZON, REFERENCE, figure)
        rows.append(
            (
                Cell(figure.title),
                *(figure_cell(results, run, figure) for run in both),
                Cell(change_text(change), None if change is None else compared(change, printed)),
                Cell(change_text(printed)),
            )
        )
    rows.append(
        (Cell(SAVING), *(share_cell(results, run) for run in both), *cells(fig.DASH, fig.DASH))
    )
    return Table(
        "headline",
        "Headline comparison: aging on 3 × 1 s + 5 × 5 s against the reference on 15 × 1 s",
        ("figure", "Reference, SH 15", "Aging, MH 3+5", "change found", "change printed"),
        tuple(rows),
        paper=HEADLINE_WHERE,
    )


def ranking_text(results: Results) -> str:
    """Return the strategies in the order of a few figures, best first, in words."""
    sentences = []
    names = dict(zip(STRATEGIES, STRATEGY_NAMES.values(), strict=True))
    for figure in (fig.DEGRADATION, fig.TOTAL, fig.COOLING, fig.INCONSISTENCY):
        known = {run: value for run in names if (value := results.find(run, figure)) is not None}
        order = ", ".join(
            f"{names[run]} ({figure.text(known[run])})"
            for run in sorted(known, key=known.__getitem__)
        )
        sentences += [f"{figure.title}: {order}."] if order else []
    return f"The strategies in order, lowest first. {' '.join(sentences)}"
