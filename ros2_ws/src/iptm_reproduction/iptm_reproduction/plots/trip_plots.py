"""Figures over the time of a trip: temperatures, degradation, spacing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iptm_core.metrics import gap_margins_m
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_reproduction.plots.style import (
    LIMIT_COLOUR,
    LINE,
    OPTIMUM_COLOUR,
    PAPER_COLOUR,
    SERIES_COLOURS,
    STRATEGY_COLOURS,
    labelled,
    legend_below,
    new_figure,
    plot,
)
from iptm_reproduction.printed import SMALLEST_MARGIN_M
from iptm_reproduction.quantities import celsius, thinned
from iptm_reproduction.runs import (
    HORIZONS_S,
    OPTIMUM,
    PROPOSED,
    REFERENCE,
    STRATEGIES,
    STRATEGY_NAMES,
    ReportRun,
    Results,
    horizons,
)

_MOST_POINTS = 600
_DASHED: dict[str, Any] = {"linestyle": "--", "linewidth": 1.0}


@plot(
    "Temperatures under the six strategies",
    "Temperature of the first and the last cell of a coolant channel; dashed: limits. The line of the "
    "reference is drawn broad because others run over it.",
    needs=(REFERENCE, PROPOSED),
    wanted=STRATEGIES,
)
def temperature_comparison(results: Results) -> Figure:
    """Draw temperature of both cells under each strategy."""
    lines = {
        STRATEGY_NAMES[name]: (run, STRATEGY_COLOURS[name])
        for name, run in results.strategies().items()
    }
    return _temperature_figure(lines, 3)


@plot(
    "Temperatures by prediction horizon",
    "Temperature of the first and the last cell under the proposed strategy; dashed: limits.",
    needs=horizons(*HORIZONS_S),
)
def horizon_temperatures(results: Results) -> Figure:
    """Draw temperature of both cells of the proposed strategy by prediction horizon."""
    lines = {
        f"{length} s": (results[f"prediction_horizon/{length}"], colour)
        for length, colour in zip(HORIZONS_S, SERIES_COLOURS[1:], strict=True)
    }
    return _temperature_figure(lines, 4)


def _temperature_figure(lines: Mapping[str, tuple[ReportRun, str]], columns: int) -> Figure:
    figure, (left, right) = new_figure(3.3, 1, 2, sharey=True)
    for name, (run, colour) in lines.items():
        for panel, values in (
            (left, run.trajectory.cell_1_temperature_k),
            (right, run.trajectory.cell_n_temperature_k),
        ):
            # The benchmark is drawn broad, for its line often lies under others.
            width = 3.0 * LINE if run.address == REFERENCE else LINE
            _mean_line(panel, run.trajectory, celsius(values), colour, name, width)
    limits = next(iter(lines.values()))[0].parameters.limits
    for panel in (left, right):
        for bound in (limits.min_temperature_k, limits.max_temperature_k):
            panel.axhline(bound - CELSIUS_ZERO_K, color=LIMIT_COLOUR, linestyle="--", linewidth=0.9)
    labelled(left, "time [s]", "temperature [°C]", "cell 1")
    labelled(right, "time [s]", "", "cell N")
    legend_below(figure, left, columns)
    return figure


def _mean_line(
    panel: Axes, run: Trajectory, values: FloatArray, colour: str, name: str, width: float = LINE
) -> None:
    """Draw a quantity over time with few enough points: the mean of each block."""
    times, means = thinned(run, values, _MOST_POINTS)
    panel.plot(times, means, color=colour, linewidth=width, label=name)


@plot(
    "Degradation under the six strategies",
    "Capacity loss of both cells since the start, and its difference to that under the reference.",
    needs=(REFERENCE, PROPOSED),
    wanted=STRATEGIES,
)
def degradation_comparison(results: Results) -> Figure:
    """Draw capacity loss of both cells under each strategy, and its difference to the reference."""
    figure, panels = new_figure(4.6, 2, 2, sharex=True, sharey="row")
    runs = {name: run.trajectory for name, run in results.strategies().items()}
    base = results[REFERENCE].trajectory
    for column, cell in enumerate(("cell_1_capacity_loss", "cell_n_capacity_loss")):
        reference = getattr(base, cell) - getattr(base, cell)[0]
        for strategy, run in runs.items():
            loss = 1e5 * (getattr(run, cell) - getattr(run, cell)[0])
            difference = loss - 1e5 * reference if loss.size == reference.size else np.nan * loss
            for panel, values in ((panels[column], loss), (panels[2 + column], difference)):
                colour, name = STRATEGY_COLOURS[strategy], STRATEGY_NAMES[strategy]
                _mean_line(panel, run, values, colour, name)
    labelled(panels[0], "", "capacity loss [10⁻⁵]", "cell 1")
    labelled(panels[1], "", "", "cell N")
    labelled(panels[2], "time [s]", "minus reference [10⁻⁵]")
    labelled(panels[3], "time [s]", "")
    legend_below(figure, panels[0], 3)
    return figure


@plot(
    "Spacing of the proposed strategy",
    "Gap between the limits for safety and traffic efficiency, and its margin to the lower limit. Where "
    "the line is thinned, the smallest value is kept.",
    needs=(PROPOSED,),
)
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
    bottom.axhline(SMALLEST_MARGIN_M, color=PAPER_COLOUR, label="paper, smallest", **_DASHED)
    bottom.axhline(0.0, color=LIMIT_COLOUR, linewidth=0.8)
    smallest = f"smallest margin {margins[lowest]:.3f} m at {trip.time_s[lowest]:.0f} s"
    labelled(bottom, "time [s]", "margin [m]", smallest)
    bottom.legend(fontsize=8, frameon=False, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    top.set_xlim(0.0, float(trip.time_s[-1]))
    return figure


def _lowest_line(panel: Axes, run: ReportRun, values: FloatArray, colour: str, name: str) -> None:
    """Draw a line with few enough points: the smallest value of each block, so that no dip is lost."""
    block = max(1, values.size // _MOST_POINTS)
    whole = values.size // block * block
    panel.plot(
        run.trajectory.time_s[:whole].reshape(-1, block)[:, 0],
        values[:whole].reshape(-1, block).min(axis=1),
        color=colour,
        linewidth=0.9,
        label=name,
    )


@plot(
    "What the optimum does differently",
    "Mean cell temperature, gap and capacity loss of both cells.",
    needs=(REFERENCE, PROPOSED, OPTIMUM),
)
def optimum(results: Results) -> Figure:
    """Draw how the whole-trip optimum differs from the proposed strategy and the reference, over the trip."""
    figure, panels = new_figure(4.4, 3, 1, sharex=True)
    lines = {
        "Reference": (REFERENCE, STRATEGY_COLOURS["reference"]),
        "Aging (proposed)": (PROPOSED, STRATEGY_COLOURS["aging"]),
        "whole-trip optimum": (OPTIMUM, OPTIMUM_COLOUR),
    }
    for name, (address, colour) in lines.items():
        run = results[address].trajectory
        mean = celsius(0.5 * (run.cell_1_temperature_k + run.cell_n_temperature_k))
        loss = run.cell_1_capacity_loss + run.cell_n_capacity_loss
        for panel, values in zip(panels, (mean, run.gap_m, 1e5 * (loss - loss[0])), strict=True):
            _mean_line(panel, run, values, colour, name)
    labelled(panels[0], "", "mean of cells [°C]")
    labelled(panels[1], "", "gap [m]")
    labelled(panels[2], "time [s]", "loss, both [10⁻⁵]")
    legend_below(figure, panels[0], 3)
    return figure
