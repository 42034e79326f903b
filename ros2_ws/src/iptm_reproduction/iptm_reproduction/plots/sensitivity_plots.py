"""Figures of the sensitivity studies: weights, prediction horizon, multi-horizon grids."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from iptm_core.metrics.figures import Figure as RunFigure
from iptm_reproduction.figures import COMPUTING_TIME, FOUR, INCONSISTENCY
from iptm_reproduction.plots.style import (
    PAPER_COLOUR,
    SERIES_COLOURS,
    STRATEGY_COLOURS,
    labelled,
    legend_below,
    new_figure,
    plot,
    room_for,
    wrapped,
)
from iptm_reproduction.printed import LENGTH_RANGES
from iptm_reproduction.runs import (
    HORIZONS_S,
    LONG_STEP_COUNTS,
    LONG_STEPS_S,
    PROPOSED,
    REFERENCE,
    SHORT_STEP_COUNTS,
    SPLITS,
    STRATEGY_NAMES,
    WEIGHT_NUMBERS,
    WEIGHTED,
    Results,
    horizons,
    lengthened,
    sampled,
    weighted,
)

_REFERENCE = {REFERENCE: STRATEGY_NAMES["reference"]}
_SINGLE_HORIZON = {PROPOSED: "SH, 15 steps of 1 s"}
_BAND: dict[str, Any] = {"color": PAPER_COLOUR, "alpha": 0.18, "linewidth": 0.0}


@plot(
    "Sensitivity to the weights",
    "Four weights per strategy, from small (light) to large (dark), in the order that the paper prints. "
    "The axes do not start at zero.",
    needs=weighted("reference_energy"),
    wanted=weighted(*WEIGHTED[1:]),
)
def weighting(results: Results) -> Figure:
    """Draw four figures of each weighted strategy for its four weights, shades from small to large."""
    figure, panels = new_figure(5.2, 2, 2)
    present = [name for name in WEIGHTED if not results.lacking(weighted(name))]
    for panel, shown in zip(panels, FOUR, strict=True):
        seen = []
        for place, strategy in enumerate(present):
            for number, run in zip(WEIGHT_NUMBERS, weighted(strategy), strict=True):
                value = results.value(run, shown)
                seen.append(value)
                colour = _shade(STRATEGY_COLOURS[strategy], number)
                panel.bar(place + 0.2 * (number - 2.5), value, 0.18, color=colour)
        seen += _level_lines(
            panel, results, shown, {**_REFERENCE, PROPOSED: STRATEGY_NAMES["aging"]}
        )
        panel.set_xticks(range(len(present)), [wrapped(STRATEGY_NAMES[name]) for name in present])
        panel.tick_params(axis="x", labelsize=7)
        room_for(panel, seen)
        labelled(panel, "", "", shown.short_title)
    legend_below(figure, panels[0], 2)
    return figure


@plot(
    "Sensitivity to the prediction horizon",
    "The proposed strategy on single horizons. The axes do not start at zero, but that of the computing "
    "time does.",
    needs=horizons(*HORIZONS_S),
    wanted=(REFERENCE,),
)
def prediction_horizon(results: Results) -> Figure:
    """Draw figures of the proposed strategy over the length of a single horizon."""
    runs = dict(zip(HORIZONS_S, horizons(*HORIZONS_S), strict=True))
    figure, panels = new_figure(4.2, 2, 3)
    for panel, shown in zip(panels, (*FOUR, INCONSISTENCY, COMPUTING_TIME), strict=True):
        seen = _line(
            panel, results, shown, runs, STRATEGY_COLOURS["aging"], STRATEGY_NAMES["aging"]
        )
        if shown is not COMPUTING_TIME:
            seen += _level_lines(panel, results, shown, _REFERENCE)
            room_for(panel, seen)
        else:
            panel.set_ylim(bottom=0.0)
        panel.set_xticks(HORIZONS_S)
        labelled(panel, "horizon [s]", "", shown.short_title)
    legend_below(figure, panels[0], 2)
    return figure


@plot(
    "Sampling time of the long horizon",
    "The proposed strategy on 15 steps, split into short and long ones. The axes do not start at zero.",
    needs=sampled(*SPLITS),
    wanted=(PROPOSED,),
)
def sampling_time(results: Results) -> Figure:
    """Draw figures of the proposed strategy over the sampling time of the long horizon, by split."""
    figure, panels = new_figure(4.9, 2, 2, sharex=True)
    for panel, shown in zip(panels, FOUR, strict=True):
        seen = []
        for split, colour in zip(SPLITS, SERIES_COLOURS, strict=True):
            runs = dict(zip(LONG_STEPS_S, sampled(split), strict=True))
            seen += _line(panel, results, shown, runs, colour, f"{split} steps")
        seen += _level_lines(panel, results, shown, _SINGLE_HORIZON, 1.5)
        panel.set_xticks(LONG_STEPS_S)
        room_for(panel, seen, 0.1)
        labelled(panel, "", "", shown.short_title)
    for panel in panels[2:]:
        labelled(panel, "sampling time of the long horizon [s]", "", panel.get_title("left"))
    legend_below(figure, panels[0], 6)
    return figure


@plot(
    "Length of the long horizon",
    "The proposed strategy with long steps of 5 s. The band is where the paper's changes against its "
    "single horizon would lie. The axes do not start at zero, but that of the computing time does.",
    needs=lengthened(*SHORT_STEP_COUNTS),
    wanted=(PROPOSED,),
)
def long_horizon(results: Results) -> Figure:
    """Draw figures of the proposed strategy over the number of long steps; the paper's range as a band."""
    figure, panels = new_figure(4.4, 2, 3)
    for panel, shown in zip(panels, (COMPUTING_TIME, *FOUR, INCONSISTENCY), strict=True):
        seen = []
        for first, colour in zip(SHORT_STEP_COUNTS, ("#2171b5", "#e08214"), strict=True):
            runs = dict(zip(LONG_STEP_COUNTS, lengthened(first), strict=True))
            seen += _line(panel, results, shown, runs, colour, f"N_p1 = {first}")
        for single in _level_lines(panel, results, shown, _SINGLE_HORIZON, 1.5):
            seen.append(single)
            if shown in LENGTH_RANGES:
                low, high = ((1.0 + change) * single for change in LENGTH_RANGES[shown])
                panel.axhspan(low, high, label="paper: change from SH", **_BAND)
                seen += [low, high]
        if shown is COMPUTING_TIME:
            panel.set_ylim(bottom=0.0)
        else:
            room_for(panel, seen, 0.1)
        panel.set_xticks(LONG_STEP_COUNTS)
        labelled(panel, "long steps N_p2", "", shown.short_title)
    legend_below(figure, panels[1], 4)
    return figure


def _line(
    panel: Axes, results: Results, shown: RunFigure, runs: Mapping[int, str], colour: str, name: str
) -> list[float]:
    """Draw a figure of the runs that are there, by place; returns the values."""
    known = {place: run for place, run in runs.items() if results.find(run, shown) is not None}
    values = [results.value(run, shown) for run in known.values()]
    if values:
        look: dict[str, Any] = {"color": colour, "markersize": 3.5, "linewidth": 1.2}
        panel.plot(list(known), values, "o-", label=name, **look)
    return values


def _level_lines(
    panel: Axes, results: Results, shown: RunFigure, runs: Mapping[str, str], width: float = 1.2
) -> list[float]:
    """Draw strategies, given with their names, as lines to compare with; returns their values."""
    known = [run for run in runs if results.find(run, shown) is not None]
    for run in known:
        look: dict[str, Any] = {"linestyle": "--", "linewidth": width, "label": runs[run]}
        panel.axhline(
            results.value(run, shown), color=STRATEGY_COLOURS[run.partition("/")[2]], **look
        )
    return [results.value(run, shown) for run in known]


def _shade(colour: str, number: int) -> tuple[float, float, float]:
    """Return a colour mixed with white: the larger the weight, the stronger."""
    part = 0.25 + 0.25 * (number - 1)
    red, green, blue = (1.0 - part + part * value for value in to_rgb(colour))
    return red, green, blue
