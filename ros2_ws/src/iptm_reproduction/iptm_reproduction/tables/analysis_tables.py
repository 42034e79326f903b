"""Tables beyond the paper: when cooling pays, the whole trip as one problem, the price of long steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iptm_reproduction import figures as fig
from iptm_reproduction.aging import Payback, cooling_payback
from iptm_reproduction.check import graded
from iptm_reproduction.document import Cell, Row, Table, cells
from iptm_reproduction.figures import change_text
from iptm_reproduction.quantities import mean_cell_temperature_c, share_while_braking
from iptm_reproduction.runs import (
    OPTIMUM,
    PROPOSED,
    REFERENCE,
    STUDIES,
    ReportRun,
    Results,
    name_of,
)
from iptm_reproduction.tables import (
    SAVING,
    change_cell,
    change_cells,
    figure_cell,
    share_cell,
)

_PERCENTILES = (10.0, 50.0, 90.0)


def cooling_table(results: Results, key: str, addresses: Sequence[str]) -> Table:
    """Return where the compressor energy of each run goes, and the energy that flows back.

    Args:
        results: the runs.
        key: identifier of the table.
        addresses: the rows; missing runs are left out.
    """
    runs = [run for run in map(results.get, addresses) if run is not None]
    return Table(
        key,
        "When the compressor runs",
        (
            "run",
            "compressor energy [kJ]",
            "of it while braking",
            "traction energy drawn [kJ]",
            "traction energy fed back [kJ]",
            "mean cell temperature [°C]",
            "mean gap [m]",
        ),
        tuple(_cooling_row(run) for run in runs),
        note=(
            "While braking, compressor power is taken from what would otherwise flow into the pack and "
            "age it: the model counts the magnitude of the current."
        ),
    )


def _cooling_row(run: ReportRun) -> Row:
    trip = run.trajectory
    steps, traction = trip.intervals_s, trip.traction_power_w[1:]
    energy = 1e-3 * float(np.dot(trip.compressor_power_w[1:], steps))
    share = share_while_braking(trip)
    drawn = 1e-3 * float(np.dot(np.maximum(traction, 0.0), steps))
    fed_back = 1e-3 * float(np.dot(np.maximum(-traction, 0.0), steps))
    return cells(
        name_of(run.address),
        f"{energy:.1f}",
        fig.DASH if share is None else f"{100.0 * share:.1f} %",
        f"{drawn:.0f}",
        f"{fed_back:.0f}",
        f"{float(np.mean(mean_cell_temperature_c(trip))):.2f}",
        fig.MEAN_GAP.text(run.values.get(fig.MEAN_GAP.key)),
    )


def payback_table(run: ReportRun) -> Table:
    """Return how long cooling takes to pay, by the power at which the compressor runs."""
    found = cooling_payback(run, _PERCENTILES)
    rows = () if found is None else _payback_rows(found)
    note = "The compressor never ran."
    if found is not None:
        note = (
            f"On this trip 1 kJ of compressor energy removes {found.cop:.2f} kJ of heat, cools the "
            f"cells by {1e3 * found.cooling_k_kj:.1f} mK and so slows their aging by "
            f"{1e2 * found.cooling_k_kj * found.aging_per_kelvin:.4f} %, but adds to the current while "
            "it runs. The time until the slower aging has made up for it is a lower bound: the cells "
            "are taken to stay as cool. A horizon that ends earlier sees no gain in cooling, other "
            "than with power that braking feeds back."
        )
    return Table(
        "payback",
        f"How long cooling takes to pay ({name_of(run.address)})",
        ("compressor runs at", "battery power [kW]", "pays after [s]"),
        rows,
        note=note,
    )


def _payback_rows(found: Payback) -> tuple[Row, ...]:
    return tuple(
        cells(
            f"percentile {percentile:g} of the power drawn", f"{1e-3 * power:.2f}", f"{time_s:.0f}"
        )
        for percentile, (power, time_s) in zip(_PERCENTILES, found.times_s.items(), strict=True)
    )


LONG_STEP_PRICE = 0.01
"""Degradation that a multi-horizon grid may cost against 1 s steps over the same length."""


def optimum_table(results: Results) -> Table:
    """Return reference, proposed strategy and whole-trip optimum: what can be saved, and what is."""
    runs = (REFERENCE, PROPOSED, OPTIMUM)
    changed = (*fig.TABLE_FIGURES, fig.DEGRADATION)
    rows: list[Row] = []
    for figure in (*changed, fig.CELL_N_MAX, fig.SMALLEST_MARGIN):
        found = (figure_cell(results, run, figure) for run in runs)
        changes = (change_cell(results, run, REFERENCE, figure) for run in runs[1:])
        rows.append(
            (
                Cell(figure.title),
                *found,
                *(changes if figure in changed else cells(fig.DASH, fig.DASH)),
            )
        )
    rows.append(
        (Cell(SAVING), *(share_cell(results, run) for run in runs), *cells(fig.DASH, fig.DASH))
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
            "The optimum is computed with the whole trip and minimises the degradation of both cells "
            "together; its other figures are by-products."
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
            fig.DASH if solve.objective is None else f"{solve.objective:.9g}",
            fig.DASH if solve.infeasibility is None else f"{solve.infeasibility:.1e}",
            fig.DASH if solve.moved_m is None else f"{solve.moved_m:.2f}",
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
            note += " The last solve is not usable: the optimum is not a bound."
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
    """Return multi-horizon grids against fine grids of the same length."""
    shown = (*fig.TABLE_FIGURES, fig.COMPUTING_TIME)
    rows: list[Row] = []
    for run in results.study("discretisation"):
        _, length, grid = run.address.split("/")
        fine = f"discretisation/{length}/fine"
        change = results.change(run.address, fine, fig.DEGRADATION)
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
        ("grid", "against", *(figure.label for figure in (fig.DEGRADATION, *shown))),
        tuple(rows),
        note=(
            "Changes of the multi-horizon grid against 1 s steps over the same length. The mark of the "
            f"first figure shows whether the long steps cost more than {100.0 * LONG_STEP_PRICE:g} %, "
            "what this project allows."
        ),
    )
