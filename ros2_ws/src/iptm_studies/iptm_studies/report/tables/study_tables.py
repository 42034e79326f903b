"""Tables of the sensitivity studies and of what lies beyond the paper."""

from __future__ import annotations

from collections.abc import Sequence

from iptm_studies.report.document import Cell, Table
from iptm_studies.report.measures import MEASURES, TABLE_MEASURES
from iptm_studies.report.naming import name_of
from iptm_studies.report.runs import (
    REFERENCE_RUN,
    STUDIES,
    ReportRun,
    Results,
)
from iptm_studies.report.tables.cells import (
    DASH,
    change_cell,
    figure_cell,
    share_cell,
)

_RELIABILITY = (
    "gap_violations",
    "hard_violations",
    "soft_violations",
    "fallbacks",
    "failed_solves",
    "solves_feasible",
    "limiter_ticks",
)
_MARKS = ("gap_violations", "fallbacks")


def run_table(
    results: Results,
    key: str,
    title: str,
    addresses: Sequence[str],
    base: str = REFERENCE_RUN,
    *,
    paper: str = "",
    note: str = "",
) -> Table:
    """Runs as rows: changes of the printed figures against a base, shares, and what went wrong.

    Args:
        results: the runs; a missing one has dashes.
        key: identifier of the table.
        title: its heading.
        addresses: the rows.
        base: run that the changes refer to; it comes first with its figures.
        paper: where the table or its figure stands in the paper.
        note: remark.
    """
    compared = (*TABLE_MEASURES, "solve_total")
    units = {name: f"{MEASURES[name].title}" for name in compared}
    rows = [
        (
            Cell(name_of(base), strong=True),
            *(Cell(MEASURES[name].text(results.measure(base, name))) for name in compared),
            share_cell(results, base),
            *(figure_cell(results, base, name) for name in _MARKS),
        )
    ]
    rows += [
        (
            Cell(name_of(address)),
            *(change_cell(results, address, base, name) for name in compared),
            share_cell(results, address),
            *(figure_cell(results, address, name) for name in _MARKS),
        )
        for address in addresses
        if address != base
    ]
    return Table(
        key,
        title,
        (
            "run",
            *units.values(),
            "part of the possible saving",
            *(MEASURES[name].label for name in _MARKS),
        ),
        tuple(rows),
        note=f"The first row has figures, the others their change against it. {note}".strip(),
        paper=paper,
    )


def weight_table(results: Results, paper: str) -> Table:
    """The weights of each strategy and what they lead to; the chosen one is set off."""
    head = (
        "strategy",
        "λ_P [1/J]",
        "λ_Q",
        *(MEASURES[key].label for key in TABLE_MEASURES),
        "part of the possible saving",
        "highest temperature [°C]",
        *(MEASURES[name].label for name in _MARKS),
    )
    rows = []
    for run in results.study("weighting"):
        strategy = run.address.split("/")[1]
        chosen = results.get(f"strategies/{strategy}")
        best = chosen is not None and _same_weights(chosen, run)
        rows.append(
            (
                Cell(name_of(f"strategies/{strategy}"), strong=best),
                Cell(_weight(run.strategy.energy_weight_1_j), strong=best),
                Cell(_weight(run.strategy.aging_weight), strong=best),
                *(change_cell(results, run.address, REFERENCE_RUN, key) for key in TABLE_MEASURES),
                share_cell(results, run.address),
                figure_cell(results, run.address, "cell_n_temperature_max"),
                *(figure_cell(results, run.address, name) for name in _MARKS),
            )
        )
    return Table(
        "weights",
        "Weights of the weighted strategies",
        head,
        tuple(rows),
        note=(
            "Changes against the reference. The weights set off are those of the strategy table: the "
            "least degradation of both cells together among the runs that break no hard limit."
        ),
        paper=paper,
    )


def _weight(value: float) -> str:
    return f"{value:g}" if value > 0.0 else DASH


def _same_weights(first: ReportRun, second: ReportRun) -> bool:
    return (first.strategy.energy_weight_1_j, first.strategy.aging_weight) == (
        second.strategy.energy_weight_1_j,
        second.strategy.aging_weight,
    )


def reliability_table(results: Results) -> Table:
    """What went wrong in any run, by study: sums and the worst run."""
    rows = []
    for study, title in STUDIES.items():
        runs = results.study(study)
        gaps = sum(gap.study == study for gap in results.gaps)
        if not runs and not gaps:
            continue
        rows.append(
            (
                Cell(title),
                Cell(str(len(runs))),
                Cell(str(gaps)),
                *(Cell(_sum_and_worst(runs, key)) for key in _RELIABILITY),
                Cell(MEASURES["solve_max"].text(_largest(runs, "solve_max"))),
            )
        )
    return Table(
        "reliability",
        "Limits kept and solver outcomes, by study",
        (
            "study",
            "runs",
            "missing",
            *(MEASURES[key].label for key in _RELIABILITY),
            "longest solve [ms]",
        ),
        tuple(rows),
        note="Sums over the runs of a study; in brackets the run with the most.",
    )


def _sum_and_worst(runs: Sequence[ReportRun], key: str) -> str:
    known = {run.address: run.measures[key] for run in runs if key in run.measures}
    if not known:
        return DASH
    total = sum(known.values())
    if total == 0.0:
        return "0"
    worst = max(known, key=known.__getitem__)
    return f"{total:.0f} ({name_of(worst)}: {known[worst]:.0f})"


def _largest(runs: Sequence[ReportRun], key: str) -> float | None:
    return max((run.measures[key] for run in runs if key in run.measures), default=None)
