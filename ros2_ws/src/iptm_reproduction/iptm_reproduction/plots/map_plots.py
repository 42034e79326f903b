"""Figures that are not over time: the aging map, the cells of a channel, misfits of the identification."""

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
from iptm_reproduction import aging as model
from iptm_reproduction.identification.spread import determined_numbers
from iptm_reproduction.names import DEFAULT_CONTROLLER, controller_name
from iptm_reproduction.plots.style import (
    LIMIT_COLOUR,
    LINE,
    SERIES_COLOURS,
    STRATEGY_COLOURS,
    labelled,
    new_figure,
)
from iptm_reproduction.results import Results
from iptm_reproduction.study_tables import channel_records


def aging_map(_: Results) -> Figure:
    """Draw capacity loss per hour over current and temperature, as a map and as lines."""
    found = model.aging_map(load_parameters().values)
    loss = 1e5 * found.loss_per_hour
    figure, (left, right) = new_figure(3.3, 1, 2)
    filled = left.contourf(found.currents_a, found.temperatures_c, loss, levels=14, cmap="viridis")
    bar = figure.colorbar(filled, ax=left)
    bar.ax.tick_params(labelsize=8)
    labelled(left, "cell current [A]", "cell temperature [°C]", "capacity loss per hour [10⁻⁵]")
    left.grid(visible=False)
    for share, colour in zip((0.0, 0.5, 1.0), ("#2171b5", "#41ab5d", "#a50f15"), strict=True):
        row = round(share * (found.temperatures_c.size - 1))
        right.plot(
            found.currents_a, loss[row], color=colour, label=f"{found.temperatures_c[row]:.1f} °C"
        )
    for rate in (1.0, 2.0):
        right.axvline(
            rate * found.nominal_capacity_ah, color="#999999", linewidth=0.8, linestyle=":"
        )
        right.annotate(
            f"{rate:g}C",
            (rate * found.nominal_capacity_ah, 0.97),
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
        colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(record.profile_times_s)))
        for time_s, profile_k, colour in zip(
            record.profile_times_s, record.profiles_k, colours, strict=True
        ):
            profile_c = np.array(profile_k) - CELSIUS_ZERO_K
            _along_channel(left, profile_c, colour, f"{time_s:.0f} s")
    for (controller, found), colour in zip(records.items(), _COLOURS, strict=False):
        losses = 1e5 * np.array(found.capacity_losses)
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
