"""Figures over the time of a trip: temperatures, degradation, spacing, powers, prices, driving cycle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iptm.studies.run import Run
from iptm_core.metrics import gap_margins_m
from iptm_core.parameters.model import CELSIUS_ZERO_K, KM_H_PER_M_S
from iptm_core.state import FloatArray
from iptm_reproduction.names import (
    COST_TO_GO_OPTIMUM,
    DEFAULT_CONTROLLER,
    OPTIMUM,
    PROPOSED,
    REFERENCE,
    SMALLEST_MARGIN,
    controller_name,
    name_of,
)
from iptm_reproduction.plots.style import (
    CONTROLLER_COLOURS,
    LIMIT_COLOUR,
    LINE,
    OPTIMUM_COLOUR,
    PAPER_COLOUR,
    SERIES_COLOURS,
    STRATEGY_COLOURS,
    labelled,
    legend_below,
    new_figure,
    tidy,
)
from iptm_reproduction.printed import printed_value
from iptm_reproduction.results import Results
from iptm_reproduction.trips import (
    blocks_of,
    busiest_window,
    celsius,
    mean_cell_temperature_c,
    traction_power_kw,
)

_MOST_POINTS = 600
_MOST_COLUMNS = 700
_ZOOM_S = 300.0
_DASHED: dict[str, Any] = {"linestyle": "--", "linewidth": 1.0}
_SLOPE_SHADES = {"large": "#f6d5c5", "small": "#dcebd7"}


def _colour(run: str) -> str:
    return OPTIMUM_COLOUR if run == OPTIMUM else STRATEGY_COLOURS[run.partition("/")[2]]


def temperature_comparison(results: Results) -> Figure:
    """Draw temperature of both cells under each strategy."""
    lines = {name_of(run): (results[run], _colour(run)) for run in results.matching("strategies/*")}
    return _temperature_figure(lines, 3)


def horizon_temperatures(results: Results) -> Figure:
    """Draw temperature of both cells of the proposed strategy by prediction horizon."""
    lines = {
        f"{length} s": (results[f"prediction_horizon/{length}"], colour)
        for length, colour in zip((5, 10, 15, 20), SERIES_COLOURS[1:], strict=True)
    }
    return _temperature_figure(lines, 4)


def _temperature_figure(lines: Mapping[str, tuple[Run, str]], columns: int) -> Figure:
    figure, (left, right) = new_figure(3.3, 1, 2, sharey=True)
    for name, (run, colour) in lines.items():
        for panel, values in (
            (left, run.trajectory.cell_1_temperature_k),
            (right, run.trajectory.cell_n_temperature_k),
        ):
            # The benchmark is drawn broad, for its line often lies under others.
            width = 3.0 * LINE if name == name_of(REFERENCE) else LINE
            _mean_line(panel, run, celsius(values), colour, name, width)
    limits = next(iter(lines.values()))[0].parameters.limits
    for panel in (left, right):
        for bound in (limits.min_temperature_k, limits.max_temperature_k):
            panel.axhline(bound - CELSIUS_ZERO_K, color=LIMIT_COLOUR, linestyle="--", linewidth=0.9)
    labelled(left, "time [s]", "temperature [°C]", "cell 1")
    labelled(right, "time [s]", "", "cell N")
    legend_below(figure, left, columns)
    return figure


def _mean_line(
    panel: Axes, run: Run, values: FloatArray, colour: str, name: str, width: float = LINE
) -> None:
    """Draw a quantity over time with few enough points: the mean of each block."""
    times, means = (
        blocks_of(series, _MOST_POINTS).mean(axis=1) for series in (run.trajectory.time_s, values)
    )
    panel.plot(times, means, color=colour, linewidth=width, label=name)


def degradation_comparison(results: Results) -> Figure:
    """Draw capacity loss of both cells under each strategy, and its difference to the reference."""
    figure, panels = new_figure(4.6, 2, 2, sharex=True, sharey="row")
    base = results[REFERENCE].trajectory
    for column, cell in enumerate(("cell_1_capacity_loss", "cell_n_capacity_loss")):
        reference = getattr(base, cell) - getattr(base, cell)[0]
        for address in results.matching("strategies/*"):
            run = results[address]
            found = getattr(run.trajectory, cell)
            loss = 1e5 * (found - found[0])
            difference = loss - 1e5 * reference if loss.size == reference.size else np.nan * loss
            for panel, values in ((panels[column], loss), (panels[2 + column], difference)):
                _mean_line(panel, run, values, _colour(address), name_of(address))
    labelled(panels[0], "", "capacity loss [10⁻⁵]", "cell 1")
    labelled(panels[1], "", "", "cell N")
    labelled(panels[2], "time [s]", "minus reference [10⁻⁵]")
    labelled(panels[3], "time [s]", "")
    legend_below(figure, panels[0], 3)
    return figure


def spacing(results: Results) -> Figure:
    """Draw gap of the proposed strategy between its limits, and its margin to the lower one."""
    run = results[PROPOSED]
    trip, parameters = run.trajectory, run.parameters
    margins = gap_margins_m(trip, parameters)
    figure, (top, bottom) = new_figure(4.0, 2, 1, sharex=True)
    _lowest_line(top, run, trip.gap_m, STRATEGY_COLOURS["aging"], "gap")
    _lowest_line(top, run, trip.gap_m - margins, LIMIT_COLOUR, "s_min (safety)")
    most_m = parameters.gap.max_gap_m
    top.axhline(most_m, color="#777777", label="s_max (traffic efficiency)", **_DASHED)
    labelled(top, "", "gap [m]")
    top.legend(fontsize=8, frameon=False, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    _lowest_line(bottom, run, margins, STRATEGY_COLOURS["aging"], "gap − s_min")
    lowest = int(np.argmin(margins))
    bottom.plot(trip.time_s[lowest], margins[lowest], "v", color="black", markersize=5)
    printed_m = printed_value(PROPOSED, SMALLEST_MARGIN) or 0.0
    bottom.axhline(printed_m, color=PAPER_COLOUR, label="paper, smallest", **_DASHED)
    bottom.axhline(0.0, color=LIMIT_COLOUR, linewidth=0.8)
    smallest = f"smallest margin {margins[lowest]:.3f} m at {trip.time_s[lowest]:.0f} s"
    labelled(bottom, "time [s]", "margin [m]", smallest)
    bottom.legend(fontsize=8, frameon=False, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    top.set_xlim(0.0, float(trip.time_s[-1]))
    return figure


def _lowest_line(panel: Axes, run: Run, values: FloatArray, colour: str, name: str) -> None:
    """Draw a line with few enough points: the smallest value of each block, so that no dip is lost."""
    times = blocks_of(run.trajectory.time_s, _MOST_POINTS)[:, 0]
    lowest = blocks_of(values, _MOST_POINTS).min(axis=1)
    panel.plot(times, lowest, color=colour, linewidth=0.9, label=name)


def optimum(results: Results) -> Figure:
    """Draw how the whole-trip optimum differs from the proposed strategy and the reference, over the trip."""
    figure, panels = new_figure(4.4, 3, 1, sharex=True)
    for address in (REFERENCE, PROPOSED, OPTIMUM):
        trip = results[address].trajectory
        loss = trip.cell_1_capacity_loss + trip.cell_n_capacity_loss
        series = (mean_cell_temperature_c(trip), trip.gap_m, 1e5 * (loss - loss[0]))
        for panel, values in zip(panels, series, strict=True):
            _mean_line(panel, results[address], values, _colour(address), name_of(address))
    labelled(panels[0], "", "mean of cells [°C]")
    labelled(panels[1], "", "gap [m]")
    labelled(panels[2], "time [s]", "loss, both [10⁻⁵]")
    legend_below(figure, panels[0], 3)
    return figure


def temperature_price(results: Results) -> Figure:
    """Draw the price of both cell temperatures and the costates of the whole trip, over the trip."""
    figure, panels = new_figure(5.2, 3, 1, sharex=True)
    decisions = results[f"cost_to_go/comprehensive/{DEFAULT_CONTROLLER}/perfect"].decisions
    record = results[COST_TO_GO_OPTIMUM].whole_trip
    if decisions is not None:
        prices = (decisions.cell_1_marginal_cost_1_k, decisions.cell_n_marginal_cost_1_k)
        name = f"price, {controller_name(DEFAULT_CONTROLLER)}"
        colour = CONTROLLER_COLOURS[DEFAULT_CONTROLLER]
        for panel, values in zip(panels, (prices[0] + prices[1], *prices), strict=True):
            panel.plot(decisions.time_s, values, color=colour, linewidth=LINE, label=name)
    if record is not None:
        name = "costate, whole-trip optimum"
        cells = record["cell_1_costates_1_k"], record["cell_n_costates_1_k"]
        costates = [np.array(values) for values in cells]
        for panel, values in zip(panels, (costates[0] + costates[1], *costates), strict=True):
            panel.plot(
                record["costate_times_s"], values, color=OPTIMUM_COLOUR, linewidth=0.8, label=name
            )
    for panel, title in zip(panels, ("both cells", "cell 1", "cell N"), strict=True):
        labelled(panel, "", "cost [1/K]", title)
        panel.axhline(0.0, color="black", linewidth=0.7)
    labelled(panels[-1], "time [s]", "cost [1/K]")
    legend_below(figure, panels[0], 2)
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
    centres = blocks_of(times, _MOST_COLUMNS).mean(axis=1)
    blocks = blocks_of(values, _MOST_COLUMNS)
    panel.fill_between(
        centres, blocks.min(axis=1), blocks.max(axis=1), color=colour, alpha=0.3, linewidth=0.0
    )
    panel.plot(centres, blocks.mean(axis=1), color=colour, linewidth=0.8)


def driving_cycle(results: Results) -> Figure:
    """Draw speed of the leader and the slope where it drives, over time."""
    route = results.cases[REFERENCE].route
    step_s = max(1.0, round(route.duration_s / 5000.0))
    times = np.arange(0.0, route.duration_s + 0.5, step_s, dtype=np.float64)
    figure, (top, bottom) = new_figure(3.6, 2, 1, sharex=True, height_ratios=[2, 1])
    top.plot(times, KM_H_PER_M_S * route.leader.speeds_at(times), color="#333333", linewidth=0.7)
    labelled(top, "", "speed [km/h]")
    driven = route.leader.positions_at(times) - route.leader.start_position_m
    grades = 100.0 * np.tan(route.slope.slope_at(driven))
    bottom.plot(times, grades, color="#8c4a2f", linewidth=0.9)
    labelled(bottom, "time [s]", "slope [%]")
    for segment in route.segments:
        if segment.start_s >= route.duration_s:
            continue
        end = min(segment.end_s, route.duration_s)
        shade = _SLOPE_SHADES.get(segment.slope_kind, "#eeeeee")
        for panel in (top, bottom):
            tidy(panel)
            panel.axvspan(segment.start_s, end, color=shade, linewidth=0.0, zorder=0)
        kind = segment.slope_kind[0].upper() if segment.slope_kind in _SLOPE_SHADES else ""
        top.annotate(
            f"{_short(segment.cycle)}\n{kind}".strip(),
            (0.5 * (segment.start_s + end), 1.01),
            xycoords=("data", "axes fraction"),
            fontsize=7,
            ha="center",
            va="bottom",
        )
    top.set_xlim(0.0, route.duration_s)
    return figure


def _short(cycle: str) -> str:
    return {"wltc_class3b": "WLTC"}.get(cycle, cycle.upper() if len(cycle) <= 5 else cycle)
