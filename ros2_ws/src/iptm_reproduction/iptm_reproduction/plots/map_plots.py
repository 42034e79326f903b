"""Figures that are not over time: power distributions, aging map, cells of a channel, misfits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import FloatArray
from iptm_reproduction.aging import aging_map as aging_map_of
from iptm_reproduction.identification.spread import determined_numbers
from iptm_reproduction.names import (
    DEFAULT_CONTROLLER,
    REFERENCE,
    STRATEGY_NAMES,
    controller_name,
    name_of,
)
from iptm_reproduction.plots.style import (
    LIMIT_COLOUR,
    LINE,
    SERIES_COLOURS,
    STRATEGY_COLOURS,
    labelled,
    legend_below,
    new_figure,
    wrapped,
)
from iptm_reproduction.results import Results
from iptm_reproduction.tables import channel_records
from iptm_reproduction.trips import PowerRegions, battery_power_kw


def aging_map(_: Results) -> Figure:
    """Draw capacity loss per hour over current and temperature, as a map and as lines."""
    parameters = load_parameters().values
    loss = 1e5 * aging_map_of(parameters)
    figure, (left, right) = new_figure(3.3, 1, 2)
    filled = left.contourf(loss.columns, loss.index, loss, levels=14, cmap="viridis")
    bar = figure.colorbar(filled, ax=left)
    bar.ax.tick_params(labelsize=8)
    labelled(left, "cell current [A]", "cell temperature [°C]", "capacity loss per hour [10⁻⁵]")
    left.grid(visible=False)
    for share, colour in zip((0.0, 0.5, 1.0), ("#2171b5", "#41ab5d", "#a50f15"), strict=True):
        row = loss.iloc[round(share * (len(loss) - 1))]
        right.plot(loss.columns, row, color=colour, label=f"{row.name:.1f} °C")
    for rate in (1.0, 2.0):
        current_a = rate * parameters.cell.nominal_capacity_ah
        right.axvline(current_a, color="#999999", linewidth=0.8, linestyle=":")
        right.annotate(
            f"{rate:g}C",
            (current_a, 0.97),
            xycoords=("data", "axes fraction"),
            fontsize=8,
            ha="right",
            va="top",
        )
    labelled(right, "cell current [A]", "", "at three temperatures [10⁻⁵ per hour]")
    right.legend(fontsize=8, frameon=False)
    return figure


_COLOURS = (STRATEGY_COLOURS["reference"], *SERIES_COLOURS[2:])


def full_channel(results: Results) -> Figure:
    """Draw temperatures along the channel at some instants, and the degradation of every cell."""
    figure, (left, right) = new_figure(3.6, 1, 2)
    records = channel_records(results)
    if (record := records.get(DEFAULT_CONTROLLER)) is not None:
        colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(record["profile_times_s"])))
        for time_s, profile_k, colour in zip(
            record["profile_times_s"], record["profiles_k"], colours, strict=True
        ):
            profile_c = np.array(profile_k) - CELSIUS_ZERO_K
            _along_channel(left, profile_c, colour, f"{time_s:.0f} s")
    for (controller, found), colour in zip(records.items(), _COLOURS, strict=False):
        losses = 1e5 * np.array(found["capacity_losses"])
        _along_channel(right, losses, colour, controller_name(controller))
    labelled(left, "cell, from the inlet", "temperature [°C]", "temperature")
    labelled(right, "cell, from the inlet", "capacity loss [10⁻⁵]", "degradation")
    for panel in (left, right):
        panel.legend(fontsize=7.5, frameon=False)
    return figure


def _along_channel(panel: Axes, values: FloatArray, colour: Any, name: str) -> None:
    """Draw a quantity of every cell, and the straight line between the first and the last."""
    numbers = np.arange(1, values.size + 1)
    panel.plot(numbers, values, color=colour, linewidth=LINE, label=name)
    ends = [0, -1]
    panel.plot(numbers[ends], values[ends], color=colour, linewidth=0.8, linestyle="--")


_COLUMNS = 4


def determined(_: Results) -> Figure:
    """Draw the misfit of all candidates over each number."""
    spread = determined_numbers()
    rows = math.ceil(len(spread.numbers) / _COLUMNS)
    figure, panels = new_figure(1.5 * rows, rows, _COLUMNS, sharey=True)
    good = spread.good
    for place, (panel, number) in enumerate(zip(panels, spread.numbers.itertuples(), strict=False)):
        values = spread.values[:, place]
        panel.plot(values[~good], spread.misfits[~good], ".", color="#bbbbbb", markersize=4)
        panel.plot(values[good], spread.misfits[good], ".", color=SERIES_COLOURS[1], markersize=6)
        panel.axvline(number.value, color=LIMIT_COLOUR, linewidth=1.0)
        panel.set_xlim(number.lowest, number.highest)
        panel.set_ylim(0.0, 3.0 * spread.threshold)
        labelled(panel, number.key.partition(".")[2].rpartition(".")[2], "")
        panel.xaxis.label.set_fontsize(6.5)
        panel.tick_params(labelsize=6.5)
    for panel in panels[len(spread.numbers) :]:
        panel.set_axis_off()
    return figure


COMPARED = ("reference", "energy_aging", "aging")
"""The proposed strategy and the two benchmarks, as in the paper's figure."""

_BIN_KW = 2.0


def power_distribution(results: Results) -> Figure:
    """Draw distribution of the battery power of each strategy, with mean and extremes."""
    figure, (panel,) = new_figure(3.6)
    present = results.matching("strategies/*")
    for index, address in enumerate(present):
        power = battery_power_kw(results[address].trajectory)
        # A density needs spread.
        if np.ptp(power) > 0.0:
            shape = panel.violinplot(
                power, positions=[index], widths=0.85, showextrema=False, points=200
            )
            for body in shape["bodies"]:  # type: ignore[attr-defined]
                body.set_facecolor(STRATEGY_COLOURS[address.partition("/")[2]])
                body.set_alpha(0.55)
        for value, marker, place in (
            (float(np.max(power)), "v", (0, 4)),
            (float(np.mean(power)), "D", (10, -3)),
            (float(np.min(power)), "^", (0, -12)),
        ):
            panel.plot(index, value, marker, color="black", markersize=4)
            panel.annotate(
                f"{value:.2f}" if marker == "D" else f"{value:.1f}",
                (index, value),
                xytext=place,
                textcoords="offset points",
                fontsize=7.5,
                ha="left" if marker == "D" else "center",
            )
    panel.set_xticks(range(len(present)), [wrapped(name_of(run)) for run in present])
    panel.tick_params(axis="x", labelsize=8)
    panel.margins(y=0.12)
    labelled(panel, "", "battery power [kW]", "▼ largest   ◆ mean   ▲ smallest")
    return figure


def power_statistics(results: Results) -> Figure:
    """Draw share of time by battery power, and by low, medium and high power."""
    trips = {
        name: results[f"strategies/{name}"].trajectory
        for name in COMPARED
        if f"strategies/{name}" in results
    }
    powers = {name: battery_power_kw(trip) for name, trip in trips.items()}
    regions = PowerRegions.of_reference(results[REFERENCE].trajectory)
    low = min(float(np.min(power)) for power in powers.values())
    high = max(float(np.max(power)) for power in powers.values())
    edges = np.arange(np.floor(low / _BIN_KW), np.ceil(high / _BIN_KW) + 1.5) * _BIN_KW
    figure, (left, right) = new_figure(3.3, 1, 2, width_ratios=[2, 1])
    for name, power in powers.items():
        share = 100.0 * np.histogram(power, edges)[0] / power.size
        left.stairs(
            share, edges, color=STRATEGY_COLOURS[name], linewidth=1.4, label=STRATEGY_NAMES[name]
        )
    left.set_yscale("log")
    for bound in (regions.low_kw, regions.high_kw):
        left.axvline(bound, color="#999999", linestyle=":", linewidth=1.0)
    labelled(left, "battery power [kW]", f"share of time per {_BIN_KW:g} kW [%]")
    width = 0.8 / len(trips)
    for index, (name, trip) in enumerate(trips.items()):
        shares = regions.shares(trip)
        places = np.arange(3) + (index - 0.5 * (len(trips) - 1)) * width
        bars = right.bar(
            places, [100.0 * share for share in shares], width, color=STRATEGY_COLOURS[name]
        )
        right.bar_label(bars, fmt="%.1f", fontsize=6.5)
    right.set_xticks(range(3), ["low", "medium", "high"])
    labelled(right, "region of power", "share of time [%]")
    legend_below(figure, left, len(trips))
    return figure
