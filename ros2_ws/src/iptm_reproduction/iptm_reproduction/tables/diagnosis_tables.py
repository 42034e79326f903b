"""Tables that look for reasons: when the compressor runs, and how long cooling takes to pay."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iptm_reproduction.document import Row, Table, cells
from iptm_reproduction.figures import DASH, MEAN_GAP
from iptm_reproduction.payback import Payback, cooling_payback
from iptm_reproduction.quantities import mean_cell_temperature_c, share_while_braking
from iptm_reproduction.runs import ReportRun, Results, name_of

_PERCENTILES = (10.0, 50.0, 90.0)


def cooling_table(results: Results, key: str, addresses: Sequence[str]) -> Table:
    """Return where the compressor energy of each run goes, beside the energy that flows back.

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
        DASH if share is None else f"{100.0 * share:.1f} %",
        f"{drawn:.0f}",
        f"{fed_back:.0f}",
        f"{float(np.mean(mean_cell_temperature_c(trip))):.2f}",
        MEAN_GAP.text(run.values.get(MEAN_GAP.key)),
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
