"""What was identified, how well the paper determines it, and what the composition used before gives."""

from __future__ import annotations

from functools import partial

from iptm_reproduction import figures as fig
from iptm_reproduction.check import compared
from iptm_reproduction.document import Cell, Row, Table, cells
from iptm_reproduction.figures import change_text
from iptm_reproduction.identification.spread import Determined, determined_numbers
from iptm_reproduction.identification.unknowns import Settled, read_unknowns, shipped_unknowns
from iptm_reproduction.printed import HEADLINE_CHANGES, printed_value
from iptm_reproduction.printed_cooling import HORIZON_S, reproduced_cooling
from iptm_reproduction.runs import (
    FIRST_MULTI_HORIZON,
    FIRST_REFERENCE,
    MULTI_HORIZON,
    REFERENCE,
    Results,
)


def determined_table() -> Table:
    """Return every number that was searched for: its bounds, the value, and the spread of the good fits."""
    found = determined_numbers()
    return Table(
        "determined",
        "Numbers that the paper does not print",
        ("number", "bounds", "identified", "left open", "of the prior", "good fits", "pinned down"),
        tuple(_determined_row(number) for number in found.numbers),
        note=(
            "Left open is the standard deviation that the strategy table leaves to a number, by the linear "
            f"sensitivities of {found.candidates} candidates that were driven with reference and proposed "
            "strategy; the next column gives it as a share of the prior's. A number is pinned down up to a "
            f"third of its prior, in part up to two thirds. Good fits are the {found.good} candidates with a "
            f"misfit up to {found.threshold:.3g} (best {found.best:.3g}); others may exist."
        ),
    )


def _determined_row(number: Determined) -> Row:
    unknown = number.unknown
    return cells(
        unknown.key,
        f"{unknown.low:g} to {unknown.high:g} {_unit(unknown.unit)}".rstrip(),
        f"{number.value:g}",
        f"± {number.deviation:.2g}",
        f"{100.0 * number.share:.0f} %",
        f"{number.low:g} to {number.high:g}",
        number.judgement,
    )


def printed_cooling_table() -> Table:
    """Return the conclusions on cooling from the paper's printed numbers alone, independent of the fit."""
    found = reproduced_cooling()
    return Table(
        "printed-cooling",
        "Cooling from the printed numbers",
        ("figure", "value", "from"),
        (
            cells(
                "cell N warmer than cell 1, on average",
                f"{found.cells_differ_k:.2f} K",
                "degradation of both cells under the reference (Table IV), aging law (Table II)",
            ),
            cells(
                "heat that the coolant carries",
                f"{found.heat_w:.0f} W",
                "the same rise of the coolant along the channel, its flow and heat capacity (Table II)",
            ),
            cells(
                "compressor power",
                f"{found.compressor_power_w:.0f} W",
                "cooling energy of the reference (Table IV) less P_aux",
            ),
            cells("coefficient of performance", f"{found.cop:.2f}", "heat and compressor power"),
            cells(
                "cooling pays after",
                f"{found.pays_after_s:.0f} s",
                "total energy of the reference (Table IV), heat capacity of the cells (Table II)",
            ),
            cells(
                f"coefficient of performance to pay within {HORIZON_S:g} s",
                f"{found.cop_to_pay_within(HORIZON_S):.1f}",
                "the row above",
            ),
            cells(
                "what J4 of the vice benchmark gives back of a joule that J3 charges while braking",
                f"{100.0 * found.braking_refund:.0f} %",
                "largest printed ratio of the weights, mean C-rate, cells at their upper limit",
            ),
        ),
        note=(
            "Nothing of this is identified. An optimal controller with aging as its only cost and the "
            f"printed horizon of {HORIZON_S:g} s has no reason to cool with drawn power, and one with the "
            "energy term none to cool while braking either, before a limit of temperature makes it. The "
            "printed strategies cool in both cases. So statements that rest on it (the vice benchmark at "
            "lower temperatures than its limit, more cooling with a longer horizon or longer steps) cannot "
            "be reproduced by choosing the numbers that the paper omits."
        ),
    )


def settled_table() -> Table:
    """Return what the search left alone, and why."""
    settled: tuple[Settled, ...] = read_unknowns(shipped_unknowns()).settled
    return Table(
        "settled",
        "Numbers that were not searched for",
        ("number", "value", "reason"),
        tuple(
            cells(entry.key, f"{entry.value:g} {_unit(entry.unit)}".rstrip(), entry.reason)
            for entry in settled
        ),
    )


def first_composition_table(results: Results) -> Table:
    """Return the headline on the identified trip against that on the composition used before."""
    rows: list[Row] = []
    for figure, printed in HEADLINE_CHANGES.items():
        change = partial(results.change, figure=figure)
        changes = (
            change(MULTI_HORIZON, REFERENCE),
            change(FIRST_MULTI_HORIZON, FIRST_REFERENCE),
        )
        found = (
            Cell(change_text(value), None if value is None else compared(value, printed))
            for value in changes
        )
        rows.append((Cell(figure.label), *found, Cell(change_text(printed))))
    for figure in (fig.TRACTION, fig.CELL_1, fig.CELL_N, fig.COOLING):
        values = (results.find(run, figure) for run in (REFERENCE, FIRST_REFERENCE))
        rows.append(
            (
                Cell(f"Reference: {figure.title}"),
                *(Cell(figure.text(value)) for value in values),
                Cell(figure.text(printed_value(REFERENCE, figure))),
            )
        )
    return Table(
        "first-composition",
        "Headline on the identified trip and on this project's own composition",
        ("figure", "identified", "own composition", "printed"),
        tuple(rows),
    )


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit
