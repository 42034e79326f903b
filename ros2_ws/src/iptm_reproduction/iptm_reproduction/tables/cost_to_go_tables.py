"""What the cost to go saves, with good and bad forecasts, on other trips, and on cold days."""

from __future__ import annotations

from iptm_core.metrics import cold_compressor_energies_j
from iptm_reproduction import figures as fig
from iptm_reproduction.document import Cell, Row, Table
from iptm_reproduction.runs import (
    COST_TO_GO_OPTIMUM,
    Results,
    controller_name,
    cost_to_go_run,
    warm_run,
    words,
)
from iptm_reproduction.tables import CHANGED, SAVING, change_cells, figure_cells, share_cell

_MARKS = (fig.SMALLEST_MARGIN, fig.GAP_VIOLATIONS, fig.FALLBACKS)
_MAIN_TRIP = "comprehensive"


def saving_table(results: Results) -> Table:
    """Return the changes of every case on the main trip, and its part of the possible saving."""
    reference = cost_to_go_run("reference")
    rows: list[Row] = []
    for run in results.study("cost_to_go"):
        _, trip, controller, preview = run.address.split("/")
        if trip == _MAIN_TRIP:
            names = (Cell(controller_name(controller), strong=run.address == reference),)
            rows.append((*names, Cell(words(preview)), *_figures(results, run.address, reference)))
    return Table(
        "cost-to-go",
        "The saving with a cost to go, by horizon and by what is known of the leader",
        (
            "controller",
            "preview",
            *(figure.title for figure in CHANGED),
            SAVING,
            *(figure.title for figure in _MARKS),
        ),
        tuple(rows),
        note=(
            "The reference has figures, the others their change against it. A preview of some seconds "
            "is exact and ends there; a perfect one and one with noise reach to the end of the horizon. The "
            "trip and the parameters are those of the suite, not the identified ones."
        ),
    )


def _figures(results: Results, run: str, reference: str) -> Row:
    return (
        *change_cells(results, run, reference, CHANGED),
        share_cell(results, run, reference, COST_TO_GO_OPTIMUM),
        *figure_cells(results, run, _MARKS),
    )


def trips_table(results: Results) -> Table:
    """Return the changes of each controller on the other trips, against the reference on the same one."""
    rows: list[Row] = []
    for run in results.study("cost_to_go"):
        _, trip, controller, _ = run.address.split("/")
        if trip == _MAIN_TRIP:
            continue
        reference = cost_to_go_run("reference", trip)
        rows.append(
            (
                Cell(run.route.name),
                Cell(controller_name(controller), strong=run.address == reference),
                *change_cells(results, run.address, reference, CHANGED),
                *figure_cells(results, run.address, _MARKS),
            )
        )
    return Table(
        "cost-to-go-trips",
        "The saving with a cost to go on other trips",
        ("trip", "controller", *(figure.title for figure in (*CHANGED, *_MARKS))),
        tuple(rows),
        note="The reference has figures, the others their change against it on the same trip.",
    )


def cold_days_table(results: Results) -> Table:
    """Return what cold days change for the default controller, against the warm trip without limits."""
    rows: list[Row] = []
    for run in results.study("cold_days"):
        _, trip, slope, day = run.address.split("/")
        warm = warm_run(trip, slope)
        below_j = cold_compressor_energies_j(run.trajectory, run.parameters).sum()
        rows.append(
            (
                Cell(run.route.name),
                Cell(words(day), strong=run.address == warm),
                *change_cells(results, run.address, warm, (fig.MOTOR_TRACTION,)),
                Cell(f"{1e-3 * below_j:.1f}"),
                *figure_cells(results, run.address, _MARKS),
            )
        )
    return Table(
        "cold-days",
        "The default controller on cold days",
        (
            "trip",
            "air and cells first",
            fig.MOTOR_TRACTION.title,
            "Compressor while both cells are below T_b,min [kJ]",
            *(figure.title for figure in _MARKS),
        ),
        tuple(rows),
        note=(
            "The trip without limits has air and cells at 35 °C first and no temperature limits; the others "
            "have their change of traction energy against it."
        ),
    )
