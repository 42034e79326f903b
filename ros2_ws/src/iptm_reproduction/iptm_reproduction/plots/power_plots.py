"""Figures of powers: distributions over the strategies, and traction against cooling in time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iptm_core.state import FloatArray
from iptm_reproduction.names import PROPOSED, REFERENCE, STRATEGY_NAMES, name_of
from iptm_reproduction.plots.style import (
    LINE,
    STRATEGY_COLOURS,
    labelled,
    legend_below,
    new_figure,
    wrapped,
)
from iptm_reproduction.results import Results
from iptm_reproduction.trips import (
    PowerRegions,
    battery_power_kw,
    busiest_window,
    traction_power_kw,
)

COMPARED = ("reference", "energy_aging", "aging")
"""The proposed strategy and the two benchmarks, as in the paper's figure."""

_BIN_KW = 2.0
_MOST_COLUMNS = 700
_ZOOM_S = 300.0


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


def power_profiles(results: Results) -> Figure:
    """Draw traction and compressor power of the proposed strategy, over the trip and where it cools most."""
    run = results[PROPOSED].trajectory
    length_s = min(_ZOOM_S, 0.5 * float(run.time_s[-1]))
    rows = slice(*busiest_window(run, length_s, run.compressor_power_w))
    figure, panels = new_figure(4.2, 2, 2, sharex="col", width_ratios=[1.4, 1])
    times = run.time_s[1:]
    compressor = run.compressor_power_w[1:]
    _band(panels[0], times, traction_power_kw(run), "#c0504d")
    _band(panels[2], times, compressor, "#1f77b4")
    panels[1].plot(times[rows], traction_power_kw(run)[rows], color="#c0504d", linewidth=LINE)
    panels[3].plot(times[rows], compressor[rows], color="#1f77b4", linewidth=LINE)
    for panel in (panels[0], panels[2]):
        panel.axvspan(times[rows][0], times[rows][-1], color="#eeeeee", zorder=0)
    labelled(panels[0], "", "traction power [kW]", "whole trip: range and mean")
    labelled(panels[1], "", "", "where it cools most")
    labelled(panels[2], "time [s]", "compressor power [W]")
    labelled(panels[3], "time [s]", "")
    panels[0].set_xlim(0.0, float(run.time_s[-1]))
    panels[1].set_xlim(float(times[rows][0]), float(times[rows][-1]))
    return figure


def _band(panel: Axes, times: FloatArray, values: FloatArray, colour: str) -> None:
    """Draw range and mean per column of the picture, instead of a line that fills the page."""
    block = max(1, times.size // _MOST_COLUMNS)
    whole = times.size // block * block
    centres = times[:whole].reshape(-1, block).mean(axis=1)
    blocks = values[:whole].reshape(-1, block)
    panel.fill_between(
        centres, blocks.min(axis=1), blocks.max(axis=1), color=colour, alpha=0.3, linewidth=0.0
    )
    panel.plot(centres, blocks.mean(axis=1), color=colour, linewidth=0.8)
