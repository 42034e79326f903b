"""Figures of the sensitivity studies: weights, prediction horizon, multi-horizon grids."""

from __future__ import annotations

from collections.abc import Mapping

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


@plot(
    "Sensitivity to the weights",
    "Four weights per strategy, from small (light) to large (dark), in the order that the paper prints. "
    "The axes do not start at zero.",
    needs=weighted("reference_energy"),
    wanted=tuple(run for name in WEIGHTED[1:] for run in weighted(name)),
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
        seen += _level_lines(panel, results, shown, (REFERENCE, PROPOSED))
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
    figure, panels = new_figure(4.2, 2, 3)
    for panel, shown in zip(panels, (*FOUR, INCONSISTENCY, COMPUTING_TIME), strict=True):
        series = _series(results, HORIZONS_S, horizons(*HORIZONS_S), shown)
        seen = _line(panel, series, STRATEGY_COLOURS["aging"], "Aging (proposed)")
        if shown is not COMPUTING_TIME:
            seen += _level_lines(panel, results, shown, (REFERENCE,))
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
    needs=tuple(run for split in SPLITS for run in sampled(split)),
    wanted=(PROPOSED,),
)
def sampling_time(results: Results) -> Figure:
    """Draw figures of the proposed strategy over the sampling time of the long horizon, by split."""
    figure, panels = new_figure(4.9, 2, 2, sharex=True)
    for panel, shown in zip(panels, FOUR, strict=True):
        seen = []
        for split, colour in zip(SPLITS, SERIES_COLOURS, strict=True):
            series = _series(results, LONG_STEPS_S, sampled(split), shown)
            seen += _line(panel, series, colour, f"{split} steps")
        seen += _single_horizon_line(panel, results, shown)
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
    needs=tuple(run for count in SHORT_STEP_COUNTS for run in lengthened(count)),
    wanted=(PROPOSED,),
)
def long_horizon(results: Results) -> Figure:
    """Draw figures of the proposed strategy over the number of long steps; the paper's range as a band."""
    figure, panels = new_figure(4.4, 2, 3)
    for panel, shown in zip(panels, (COMPUTING_TIME, *FOUR, INCONSISTENCY), strict=True):
        seen = []
        for first, colour in zip(SHORT_STEP_COUNTS, ("#2171b5", "#e08214"), strict=True):
            series = _series(results, LONG_STEP_COUNTS, lengthened(first), shown)
            seen += _line(panel, series, colour, f"N_p1 = {first}")
        for single in _single_horizon_line(panel, results, shown):
            seen.append(single)
            if shown in LENGTH_RANGES:
                low, high = ((1.0 + change) * single for change in LENGTH_RANGES[shown])
                panel.axhspan(
                    low,
                    high,
                    color=PAPER_COLOUR,
                    alpha=0.18,
                    linewidth=0.0,
                    label="paper: change from SH",
                )
                seen += [low, high]
        if shown is COMPUTING_TIME:
            panel.set_ylim(bottom=0.0)
        else:
            room_for(panel, seen, 0.1)
        panel.set_xticks(LONG_STEP_COUNTS)
        labelled(panel, "long steps N_p2", "", shown.short_title)
    legend_below(figure, panels[1], 4)
    return figure


def _series(
    results: Results, places: tuple[int, ...], runs: tuple[str, ...], shown: RunFigure
) -> dict[int, float]:
    """Return a figure by place, of the runs that are there."""
    found = {place: results.find(run, shown) for place, run in zip(places, runs, strict=True)}
    return {place: value for place, value in found.items() if value is not None}


def _line(panel: Axes, series: Mapping[int, float], colour: str, name: str) -> list[float]:
    """Draw what there is of a series; returns the values."""
    values = list(series.values())
    if values:
        look = {"color": colour, "markersize": 3.5, "linewidth": 1.2}
        panel.plot(list(series), values, "o-", label=name, **look)  # type: ignore[arg-type]
    return values


def _level_lines(
    panel: Axes, results: Results, shown: RunFigure, runs: tuple[str, ...]
) -> list[float]:
    """Draw strategies as lines to compare with; returns their values."""
    seen = []
    for run in runs:
        value = results.find(run, shown)
        if value is not None:
            strategy = run.partition("/")[2]
            panel.axhline(
                value,
                color=STRATEGY_COLOURS[strategy],
                linestyle="--",
                linewidth=1.2,
                label=STRATEGY_NAMES[strategy],
            )
            seen.append(value)
    return seen


def _single_horizon_line(panel: Axes, results: Results, shown: RunFigure) -> list[float]:
    """Draw the proposed strategy on a single horizon as a line; returns its value if it is there."""
    single = results.find(PROPOSED, shown)
    if single is None:
        return []
    colour = STRATEGY_COLOURS["aging"]
    panel.axhline(single, color=colour, linestyle="--", label="SH, 15 steps of 1 s")
    return [single]


def _shade(colour: str, number: int) -> tuple[float, float, float]:
    """Return a colour mixed with white: the larger the weight, the stronger."""
    part = 0.25 + 0.25 * (number - 1)
    red, green, blue = (1.0 - part + part * value for value in to_rgb(colour))
    return red, green, blue
