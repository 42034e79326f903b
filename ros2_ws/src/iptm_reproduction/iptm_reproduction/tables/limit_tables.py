"""Tables of what the paper has no counterpart for: the whole-trip optimum, and the price of long steps."""

from __future__ import annotations

from iptm_reproduction.check import graded
from iptm_reproduction.document import Cell, Row, Table, cells
from iptm_reproduction.figures import (
    CELL_N_MAX,
    COMPUTING_TIME,
    DASH,
    DEGRADATION,
    SMALLEST_MARGIN,
    TABLE_FIGURES,
    change_text,
)
from iptm_reproduction.runs import OPTIMUM, PROPOSED, REFERENCE, STUDIES, Results, name_of
from iptm_reproduction.tables.cells import (
    SAVING,
    change_cell,
    change_cells,
    figure_cell,
    share_cell,
)

LONG_STEP_PRICE = 0.01
"""Degradation that a multi-horizon grid may cost against 1 s steps over the same length."""


def optimum_table(results: Results) -> Table:
    """Return reference, proposed strategy and whole-trip optimum: what can be saved, and what is."""
    runs = (REFERENCE, PROPOSED, OPTIMUM)
    changed = (*TABLE_FIGURES, DEGRADATION)
    rows: list[Row] = []
    for figure in (*changed, CELL_N_MAX, SMALLEST_MARGIN):
        found = (figure_cell(results, run, figure) for run in runs)
        changes = (change_cell(results, run, REFERENCE, figure) for run in runs[1:])
        rows.append(
            (Cell(figure.title), *found, *(changes if figure in changed else cells(DASH, DASH)))
        )
    rows.append((Cell(SAVING), *(share_cell(results, run) for run in runs), *cells(DASH, DASH)))
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
    """Return how the whole trip was solved."""
    record = results[OPTIMUM].whole_trip
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
    """Return multi-horizon grids beside fine grids of the same length."""
    shown = (*TABLE_FIGURES, COMPUTING_TIME)
    rows: list[Row] = []
    for run in results.study("discretisation"):
        _, length, grid = run.address.split("/")
        fine = f"discretisation/{length}/fine"
        change = results.change(run.address, fine, DEGRADATION)
        if grid == "fine" or change is None:
            continue
        rows.append(
            (
                *cells(f"MH {grid}", f"{length} × 1 s"),
                Cell(change_text(change), graded(change <= LONG_STEP_PRICE)),
                *change_cells(results, run.address, fine, shown),
            )
        )
    return Table(
        "discretisation-table",
        STUDIES["discretisation"],
        ("grid", "against", *(figure.label for figure in (DEGRADATION, *shown))),
        tuple(rows),
        note=(
            "Changes of the multi-horizon grid against 1 s steps over the same length. The mark of the "
            f"first figure says whether the long steps cost more than {100.0 * LONG_STEP_PRICE:g} %, "
            "what this project allows."
        ),
    )
