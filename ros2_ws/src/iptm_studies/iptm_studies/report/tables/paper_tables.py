"""The tables of the paper, with this project's numbers beside the printed ones."""

from __future__ import annotations

from iptm_controller.strategy import STRATEGIES
from iptm_core.parameters import describe_parameters, load_parameters
from iptm_core.parameters.units import to_model_unit
from iptm_studies.report.document import Cell, Table
from iptm_studies.report.measures import (
    MEASURES,
    TABLE_MEASURES,
    change_text,
    relative_change,
)
from iptm_studies.report.naming import STRATEGY_NAMES
from iptm_studies.report.paper import PaperClaims, ParameterTable
from iptm_studies.report.runs import REFERENCE_RUN, Results
from iptm_studies.report.tables.cells import DASH, figure_and_change, figure_cell, share_cell
from iptm_studies.report.verdict import Verdict

_SAME = 1e-9
_FURTHER_ROWS = (
    "battery_energy",
    "total_degradation",
    "cell_1_temperature_mean",
    "cell_n_temperature_mean",
    "cell_n_temperature_max",
    "smallest_margin",
    "mean_gap",
    "solve_total",
    "gap_violations",
    "hard_violations",
    "soft_violations",
    "fallbacks",
    "failed_solves",
)


def parameter_table(table: ParameterTable) -> Table:
    """A printed table of parameters beside the values of the default set."""
    used = load_parameters()
    ours = {row.key: row for row in describe_parameters(used)}
    rows = []
    for printed in table.rows:
        row = ours[printed.key]
        wanted = to_model_unit(printed.printed, printed.unit, row.unit)
        same = abs(row.value - wanted) <= _SAME * max(1.0, abs(wanted))
        rows.append(
            (
                Cell(row.symbol),
                Cell(printed.key),
                Cell(_with_unit(printed.printed, printed.unit)),
                Cell(
                    _with_unit(used.sources[row.key].value, used.sources[row.key].unit),
                    Verdict.REPRODUCED if same else Verdict.NOT_REPRODUCED,
                ),
            )
        )
    return Table(
        f"parameters-{table.table.lower().replace(' ', '-')}",
        table.title,
        ("symbol", "parameter", "printed", "used"),
        tuple(rows),
        paper=table.table,
    )


def omitted_parameter_table(paper: PaperClaims) -> Table:
    """Every parameter in use that the paper's tables do not state, and where its value comes from."""
    stated = {row.key for table in paper.parameter_tables for row in table.rows}
    rows = [
        (
            Cell(row.symbol),
            Cell(row.key),
            Cell(_with_unit(row.value, row.unit)),
            Cell(row.source),
            Cell(row.note or DASH),
        )
        for row in describe_parameters(load_parameters())
        if row.key not in stated
    ]
    return Table(
        "parameters-omitted",
        "Parameters that the paper's tables do not state",
        ("symbol", "parameter", "used", "source", "remark"),
        tuple(rows),
    )


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.10g}" if unit == "1" else f"{value:.10g} {unit}"


def formulation_table(paper: PaperClaims) -> Table:
    """Cost terms of the six formulations, printed and used."""
    rows = []
    for printed in paper.formulations.rows:
        used = _terms(printed.strategy)
        rows.append(
            (
                Cell(printed.label),
                Cell(" + ".join(f"J{term}" for term in printed.terms)),
                Cell(
                    " + ".join(f"J{term}" for term in used),
                    Verdict.REPRODUCED if used == printed.terms else Verdict.NOT_REPRODUCED,
                ),
            )
        )
    return Table(
        "formulations",
        paper.formulations.title,
        ("formulation", "printed", "used"),
        tuple(rows),
        paper=paper.formulations.table,
    )


def _terms(name: str) -> tuple[int, ...]:
    """Numbers of the cost terms that a strategy has."""
    strategy = STRATEGIES[name]
    weights = (
        strategy.speed_weight,
        strategy.temperature_weight,
        strategy.energy_weight_1_j,
        strategy.aging_weight,
    )
    return tuple(number for number, weight in enumerate(weights, start=1) if weight > 0.0)


def strategy_table(results: Results, paper: PaperClaims) -> Table:
    """The results table: found above printed, with the change against the reference."""
    printed = paper.strategy_table
    addresses = [f"strategies/{name}" for name in printed.order]
    rows = [
        (
            Cell("weights λ_P, λ_Q"),
            Cell("used"),
            *(Cell(_weights_text(results, address)) for address in addresses),
        )
    ]
    for key in TABLE_MEASURES:
        rows.append(
            (
                Cell(MEASURES[key].title, strong=True),
                Cell("found"),
                *(_found_cell(results, paper, address, key) for address in addresses),
            )
        )
        rows.append(
            (
                Cell(""),
                Cell("printed"),
                *(Cell(_printed_text(paper, index, key)) for index, _ in enumerate(printed.order)),
            )
        )
    rows += [
        (
            Cell(MEASURES[key].title),
            Cell("found"),
            *(figure_cell(results, address, key) for address in addresses),
        )
        for key in _FURTHER_ROWS
    ]
    rows.append(
        (
            Cell("part of the possible saving of degradation"),
            Cell("found"),
            *(share_cell(results, address) for address in addresses),
        )
    )
    return Table(
        "strategies",
        printed.title,
        ("figure", "", *(paper.formulations.label(name) for name in printed.order)),
        tuple(rows),
        note=(
            "In brackets the change against the reference; its mark compares it with the printed "
            "change. The paper labels its total ∫P_b dt, but its numbers are the sum of traction and "
            f"cooling energy; both are given. {printed.note}"
        ),
        paper=printed.table,
    )


def _found_cell(results: Results, paper: PaperClaims, address: str, key: str) -> Cell:
    text = figure_and_change(results, address, REFERENCE_RUN, key)
    change = relative_change(results.measure(address, key), results.measure(REFERENCE_RUN, key))
    if address == REFERENCE_RUN or change is None:
        return Cell(text)
    place = paper.strategy_table.order.index(address.split("/")[1]) - 1
    return Cell(
        text, paper.change_tolerance.judge(change, paper.strategy_table.changes[key][place])
    )


def _printed_text(paper: PaperClaims, index: int, key: str) -> str:
    table = paper.strategy_table
    text = MEASURES[key].text(table.values[key][index])
    return text if index == 0 else f"{text} ({change_text(table.changes[key][index - 1])})"


def _weights_text(results: Results, address: str) -> str:
    run = results.get(address)
    if run is None:
        return DASH
    parts = (run.strategy.energy_weight_1_j, run.strategy.aging_weight)
    return ", ".join(f"{weight:g}" if weight > 0.0 else DASH for weight in parts)


def headline_table(results: Results, paper: PaperClaims) -> Table:
    """The headline comparison: values of both runs, the change found and the printed one."""
    headline = paper.headline
    rows = []
    for key, printed in headline.changes.items():
        change = relative_change(
            results.measure(headline.run, key), results.measure(headline.base, key)
        )
        verdict = None if change is None else paper.change_tolerance.judge(change, printed)
        rows.append(
            (
                Cell(MEASURES[key].title),
                figure_cell(results, headline.base, key),
                figure_cell(results, headline.run, key),
                Cell(change_text(change), verdict),
                Cell(change_text(printed)),
            )
        )
    rows.append(
        (
            Cell("part of the possible saving of degradation"),
            share_cell(results, headline.base),
            share_cell(results, headline.run),
            Cell(DASH),
            Cell(DASH),
        )
    )
    return Table(
        "headline",
        "Headline comparison: aging on 3 × 1 s + 5 × 5 s against the reference on 15 × 1 s",
        ("figure", "Reference, SH 15", "Aging, MH 3+5", "change found", "change printed"),
        tuple(rows),
        paper=headline.where,
    )


def ranking_text(results: Results) -> str:
    """The strategies in the order of a few figures, best first, in words."""
    sentences = []
    for key in ("total_degradation", "total_energy_printed", "cooling_energy", "inconsistency"):
        found = {name: results.measure(f"strategies/{name}", key) for name in STRATEGY_NAMES}
        known = {name: value for name, value in found.items() if value is not None}
        order = ", ".join(
            f"{STRATEGY_NAMES[name]} ({MEASURES[key].text(known[name])})"
            for name in sorted(known, key=known.__getitem__)
        )
        sentences.append(f"{MEASURES[key].title}: {order}." if order else "")
    return f"The strategies in order, lowest first. {' '.join(filter(None, sentences))}"
