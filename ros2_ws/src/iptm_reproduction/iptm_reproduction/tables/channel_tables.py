"""The full channel against its two-cell reduction: saving, and cost of the reduction."""

from __future__ import annotations

from collections.abc import Callable

from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_reproduction import figures as fig
from iptm_reproduction.document import Cell, Row, Table, cells
from iptm_reproduction.figures import change_text, relative_change
from iptm_reproduction.runs import Results, channel_controllers, channel_run, controller_name
from iptm_reproduction.tables import CHANGED, change_cells
from iptm_studies.channel_record import CellError, ChannelRecord, HottestCell

_PLANTS = {"two_cell": "two cells", "full_channel": "full channel"}


def saving_table(results: Results) -> Table:
    """Return the change of each controller against the reference, on either plant."""
    rows: list[Row] = []
    for plant, name in _PLANTS.items():
        reference = channel_run("reference", plant)
        for controller in channel_controllers(results):
            run = channel_run(controller, plant)
            if run not in results or reference not in results:
                continue
            rows.append(
                (
                    Cell(name),
                    Cell(controller_name(controller), strong=run == reference),
                    *change_cells(results, run, reference, CHANGED),
                    *_all_cells(results, run, reference),
                )
            )
    return Table(
        "channel-saving",
        "The saving with two cells and with the full channel",
        (
            "plant",
            "controller",
            *(figure.title for figure in CHANGED),
            "Mean degradation of all cells [10⁻⁵]",
            "Degradation of the worst cell [10⁻⁵]",
        ),
        tuple(rows),
        note="The reference has figures, the others their change against it on the same plant.",
    )


def _all_cells(results: Results, run: str, reference: str) -> Row:
    """Return mean and largest degradation over all cells of a channel, dashes where there are but two."""
    record, base = results[run].channel, results[reference].channel
    if record is None or base is None:
        return cells(fig.DASH, fig.DASH)
    pairs = [(of(record.capacity_losses), of(base.capacity_losses)) for of in (_mean, max)]
    if run == reference:
        return cells(*(f"{1e5 * value:.4f}" for value, _ in pairs))
    return cells(*(change_text(relative_change(value, other)) for value, other in pairs))


def channel_table(results: Results) -> Table:
    """Return what all cells of a channel go through, and what the two-cell reduction makes of it."""
    records = {
        controller: record
        for controller in channel_controllers(results)
        if (record := results[channel_run(controller)].channel) is not None
    }
    return Table(
        "channel",
        "Every cell of the channel, and the price of two",
        ("", *map(controller_name, records)),
        tuple(
            (Cell(name), *cells(*(show(record) for record in records.values())))
            for name, show in _ROWS.items()
        ),
        note=(
            "The line is drawn through the measured cells 1 and N at every instant. The two-cell model is "
            "driven with the commands of the full one. Spread is the difference between the largest and "
            "the smallest degradation of all cells."
        ),
    )


def _mean(values: tuple[float, ...]) -> float:
    return sum(values) / len(values)


def _hottest(found: HottestCell) -> str:
    return f"{found.temperature_k - CELSIUS_ZERO_K:.2f} (cell {found.cell}, {found.time_s:.0f} s)"


def _excess(found: HottestCell) -> str:
    if found.excess_k <= 0.0:
        return "0"
    return f"{found.excess_k:.3f} (cell {found.cell}, {found.time_s:.0f} s)"


def _error(error: CellError) -> str:
    return f"{error.rms_k:.3f} / {error.max_k:.3f}"


def _worst(record: ChannelRecord) -> str:
    losses = record.capacity_losses
    return f"{1e5 * max(losses):.4f} (cell {losses.index(max(losses)) + 1})"


def _against_two(value: Callable[[tuple[float, ...]], float], record: ChannelRecord) -> str:
    two = value(record.two_cell_losses)
    return f"{1e5 * two:.4f} ({change_text(relative_change(two, value(record.capacity_losses)))})"


_ROWS: dict[str, Callable[[ChannelRecord], str]] = {
    "hottest cell of the trip [°C]": lambda record: _hottest(record.peak),
    "part of the time in which cell N is the hottest": lambda record: (
        f"{100.0 * record.hottest_shares[-1]:.1f} %"
    ),
    "part in which cell 1 is": lambda record: f"{100.0 * record.hottest_shares[0]:.1f} %",
    "most by which a cell exceeds cells 1 and N [K]": lambda record: _excess(record.largest_excess),
    "line against every cell, RMS / largest [K]": lambda record: _error(record.line),
    "two-cell model, cell 1, RMS / largest [K]": lambda record: _error(record.two_cell_1),
    "two-cell model, cell N, RMS / largest [K]": lambda record: _error(record.two_cell_n),
    "degradation of cell 1 [10⁻⁵]": lambda record: f"{1e5 * record.capacity_losses[0]:.4f}",
    "degradation of cell N [10⁻⁵]": lambda record: f"{1e5 * record.capacity_losses[-1]:.4f}",
    "largest degradation of a cell [10⁻⁵]": _worst,
    "mean degradation of all cells [10⁻⁵]": lambda record: (
        f"{1e5 * _mean(record.capacity_losses):.4f}"
    ),
    "spread over all cells [10⁻⁵]": lambda record: (
        f"{1e5 * (max(record.capacity_losses) - min(record.capacity_losses)):.4f}"
    ),
    "two-cell model, mean of cells 1 and N [10⁻⁵]": lambda record: _against_two(_mean, record),
    "two-cell model, larger of cells 1 and N [10⁻⁵]": lambda record: _against_two(max, record),
}
