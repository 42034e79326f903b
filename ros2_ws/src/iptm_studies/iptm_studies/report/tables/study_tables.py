"""Tables of the sensitivity studies and of what lies beyond the paper."""

from __future__ import annotations

from collections.abc import Sequence

from iptm_studies.report.document import Cell, Table, cells
from iptm_studies.report.measures import MEASURES, TABLE_MEASURES, change_text, relative_change
from iptm_studies.report.naming import name_of
from iptm_studies.report.runs import (
    OPTIMUM_RUN,
    PROPOSED_RUN,
    REFERENCE_RUN,
    STUDIES,
    ReportRun,
    Results,
)
from iptm_studies.report.tables.cells import (
    AGING_KEY,
    DASH,
    change_cell,
    figure_cell,
    saving_share,
    share_cell,
)
from iptm_studies.report.verdict import Verdict

LONG_STEP_PRICE = 0.01
"""Degradation that a multi-horizon grid may cost against 1 s steps over the same length."""

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


def optimum_table(results: Results) -> Table:
    """Reference, proposed strategy and whole-trip optimum: what can be saved, and what is."""
    runs = (REFERENCE_RUN, PROPOSED_RUN, OPTIMUM_RUN)
    keys = (*TABLE_MEASURES, AGING_KEY, "cell_n_temperature_max", "smallest_margin")
    rows = [
        (
            Cell(MEASURES[key].title),
            *(figure_cell(results, run, key) for run in runs),
            *(
                change_cell(results, run, REFERENCE_RUN, key)
                if MEASURES[key].compared
                else Cell(DASH)
                for run in runs[1:]
            ),
        )
        for key in keys
    ]
    shares = [saving_share(results, run) for run in runs]
    rows.append(
        (
            Cell("part of the possible saving of degradation"),
            *(Cell(DASH if share is None else f"{100.0 * share:.1f} %") for share in shares),
            *cells(DASH, DASH),
        )
    )
    return Table(
        "optimum",
        "The whole trip as one problem",
        (
            "figure",
            *(name_of(run) for run in runs),
            *(f"change, {name_of(run)}" for run in runs[1:]),
        ),
        tuple(rows),
        note=(
            "The optimum knows the whole trip and minimises the degradation of both cells together; "
            "its other figures are by-products."
        ),
    )


def optimum_solve_table(results: Results) -> Table:
    """How the whole trip was solved."""
    record = results[OPTIMUM_RUN].whole_trip
    solves = () if record is None else record.solves
    rows = [
        cells(
            str(number),
            solve.status,
            str(solve.iterations),
            f"{solve.time_s:.1f}",
            DASH if solve.objective is None else f"{solve.objective:.9g}",
            DASH if solve.infeasibility is None else f"{solve.infeasibility:.1e}",
            DASH if solve.moved_m is None else f"{solve.moved_m:.2f}",
        )
        for number, solve in enumerate(solves, start=1)
    ]
    note = ""
    if record is not None:
        note = (
            f"Largest violation of a soft limit in the plan: gap {record.gap_slack_m:.2g} m, speed "
            f"{record.speed_slack_m_s:.2g} m/s, temperature {record.temperature_slack_k:.2g} K."
        )
        if not record.settled:
            note += " The last solve is not usable: the optimum is no bound."
    return Table(
        "optimum-solves",
        "Solves of the whole trip, each around the positions of the one before",
        (
            "solve",
            "status",
            "iterations",
            "time [s]",
            "cost",
            "infeasibility",
            "positions moved [m]",
        ),
        tuple(rows),
        note=note,
    )


def discretisation_table(results: Results) -> Table:
    """Multi-horizon grids beside fine grids of the same length."""
    keys = (AGING_KEY, *TABLE_MEASURES, "solve_total")
    rows = []
    for run in results.study("discretisation"):
        _, length, grid = run.address.split("/")
        fine = f"discretisation/{length}/fine"
        change = relative_change(run.measures.get(AGING_KEY), results.measure(fine, AGING_KEY))
        if grid == "fine" or change is None:
            continue
        verdict = Verdict.REPRODUCED if change <= LONG_STEP_PRICE else Verdict.NOT_REPRODUCED
        rows.append(
            (
                Cell(f"MH {grid}"),
                Cell(f"{length} × 1 s"),
                Cell(change_text(change), verdict),
                *(change_cell(results, run.address, fine, key) for key in keys[1:]),
            )
        )
    return Table(
        "discretisation-table",
        STUDIES["discretisation"],
        ("grid", "against", *(MEASURES[key].label for key in keys)),
        tuple(rows),
        note=(
            "Changes of the multi-horizon grid against 1 s steps over the same length. The mark of the "
            f"first figure says whether the long steps cost more than {100.0 * LONG_STEP_PRICE:g} %, "
            "what this project allows."
        ),
    )
