"""Tables of what the paper has no counterpart for: the whole-trip optimum, and the price of long steps."""

from __future__ import annotations

from iptm_studies.report.document import Cell, Table, cells
from iptm_studies.report.measures import MEASURES, TABLE_MEASURES, change_text, relative_change
from iptm_studies.report.naming import name_of
from iptm_studies.report.runs import OPTIMUM_RUN, PROPOSED_RUN, REFERENCE_RUN, STUDIES, Results
from iptm_studies.report.tables.cells import (
    AGING_KEY,
    DASH,
    change_cell,
    figure_cell,
    saving_share,
)
from iptm_studies.report.verdict import Verdict

LONG_STEP_PRICE = 0.01
"""Degradation that a multi-horizon grid may cost against 1 s steps over the same length."""


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
