"""Figures of the sensitivity studies: weights, prediction horizon, multi-horizon grids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from iptm_core.metrics.figures import FIGURES
from iptm_reproduction.names import (
    COMPUTING_TIME,
    FOUR,
    INCONSISTENCY,
    PROPOSED,
    REFERENCE,
    STRATEGY_NAMES,
    WEIGHTED,
    expanded,
)
from iptm_reproduction.plots.style import (
    PAPER_COLOUR,
    SERIES_COLOURS,
    STRATEGY_COLOURS,
    labelled,
    legend_below,
    new_figure,
    room_for,
    wrapped,
)
from iptm_reproduction.printed import RANGES
from iptm_reproduction.results import Results

_REFERENCE = {REFERENCE: STRATEGY_NAMES["reference"]}
_SINGLE_HORIZON = {PROPOSED: "SH, 15 steps of 1 s"}
_WEIGHT_NUMBERS = (1, 2, 3, 4)
_BAND: dict[str, Any] = {"color": PAPER_COLOUR, "alpha": 0.18, "linewidth": 0.0}


def weighting(results: Results) -> Figure:
    """Draw four figures of each weighted strategy for its four weights, shades from small to large."""
    figure, panels = new_figure(5.2, 2, 2)
    series = {strategy: expanded(f"weighting/{strategy}/1|2|3|4") for strategy in WEIGHTED}
    present = [strategy for strategy, runs in series.items() if not results.lacking(runs)]
    for panel, shown in zip(panels, FOUR, strict=True):
        seen = []
        for place, strategy in enumerate(present):
            for number, run in zip(_WEIGHT_NUMBERS, series[strategy], strict=True):
                value = results.value(run, shown)
                seen.append(value)
                colour = _shade(STRATEGY_COLOURS[strategy], number)
                panel.bar(place + 0.2 * (number - 2.5), value, 0.18, color=colour)
        levels = {**_REFERENCE, PROPOSED: STRATEGY_NAMES["aging"]}
        seen += _level_lines(panel, results, shown, levels, 1.2)
        panel.set_xticks(range(len(present)), [wrapped(STRATEGY_NAMES[name]) for name in present])
        panel.tick_params(axis="x", labelsize=7)
        room_for(panel, seen)
        labelled(panel, "", "", FIGURES[shown].short_title)
    legend_below(figure, panels[0], 2)
    return figure


def prediction_horizon(results: Results) -> Figure:
    """Draw figures of the proposed strategy over the length of a single horizon."""
    figure, panels = new_figure(4.2, 2, 3)
    shown = (*FOUR, INCONSISTENCY, COMPUTING_TIME)
    lines = {STRATEGY_NAMES["aging"]: (STRATEGY_COLOURS["aging"], "prediction_horizon/5|10|15|20")}
    levels = dict.fromkeys(shown[:-1], _REFERENCE)
    _draw_lines(results, panels, shown, lines, (5, 10, 15, 20), levels, width=1.2, room=0.25)
    for panel in panels:
        panel.set_xlabel("horizon [s]")
    legend_below(figure, panels[0], 2)
    return figure


def sampling_time(results: Results) -> Figure:
    """Draw figures of the proposed strategy over the sampling time of the long horizon, by split."""
    figure, panels = new_figure(4.9, 2, 2, sharex=True)
    splits = ("3+12", "5+10", "8+7", "10+5", "12+3")
    lines = {
        f"{split} steps": (colour, f"sampling_time/{split}/2|5|8|10|15")
        for split, colour in zip(splits, SERIES_COLOURS, strict=True)
    }
    levels = dict.fromkeys(FOUR, _SINGLE_HORIZON)
    _draw_lines(results, panels, FOUR, lines, (2, 5, 8, 10, 15), levels)
    for panel in panels[2:]:
        panel.set_xlabel("sampling time of the long horizon [s]")
    legend_below(figure, panels[0], 6)
    return figure


def long_horizon(results: Results) -> Figure:
    """Draw figures of the proposed strategy over the number of long steps; the paper's range as a band."""
    figure, panels = new_figure(4.4, 2, 3)
    shown = (COMPUTING_TIME, *FOUR, INCONSISTENCY)
    lines = {
        f"N_p1 = {first}": (
            colour,
            f"long_horizon/{'|'.join(f'{first}+{long}' for long in counts)}",
        )
        for counts in [(5, 10, 12, 15, 20)]
        for first, colour in ((3, "#2171b5"), (5, "#e08214"))
    }
    levels = dict.fromkeys(shown, _SINGLE_HORIZON)
    ranges = RANGES["long_horizon"]
    _draw_lines(results, panels, shown, lines, (5, 10, 12, 15, 20), levels, ranges=ranges)
    for panel in panels:
        panel.set_xlabel("long steps N_p2")
    legend_below(figure, panels[1], 4)
    return figure


def _draw_lines(
    results: Results,
    panels: Sequence[Axes],
    figures: Sequence[str],
    lines: Mapping[str, tuple[str, str]],
    places: Sequence[int],
    levels: Mapping[str, Mapping[str, str]],
    ranges: Mapping[str, tuple[float, float]] | None = None,
    width: float = 1.5,
    room: float = 0.1,
) -> None:
    """Draw a figure per panel along series of runs, without those that are missing.

    ``lines`` are colour and runs by name, ``places`` where these stand on the horizontal axis, ``levels``
    named runs whose figure is drawn as a level line of a width, by figure, and ``ranges`` the printed
    smallest and largest change against it. ``room`` is the share of the vertical axis that is left
    free around the values; computing times begin at 0.
    """
    for panel, shown in zip(panels, figures, strict=True):
        seen: list[float] = []
        for name, (colour, runs) in lines.items():
            pairs = zip(places, expanded(runs), strict=True)
            known = {place: results.find(run, shown) for place, run in pairs}
            values = {place: value for place, value in known.items() if value is not None}
            if values:
                look: dict[str, Any] = {"color": colour, "markersize": 3.5, "linewidth": 1.2}
                panel.plot(list(values), list(values.values()), "o-", label=name, **look)
            seen += values.values()
        for level in _level_lines(panel, results, shown, levels.get(shown, {}), width):
            seen.append(level)
            if ranges and shown in ranges:
                low, high = ((1.0 + change) * level for change in ranges[shown])
                panel.axhspan(low, high, label="paper: change from SH", **_BAND)
                seen += [low, high]
        if shown == COMPUTING_TIME:
            panel.set_ylim(bottom=0.0)
        else:
            room_for(panel, seen, room)
        panel.set_xticks(places)
        labelled(panel, "", "", FIGURES[shown].short_title)


def _level_lines(
    panel: Axes, results: Results, shown: str, runs: Mapping[str, str], width: float
) -> list[float]:
    """Draw strategies, given with their names, as lines to compare with; returns their values."""
    found = {run: results.find(run, shown) for run in runs}
    values = {run: value for run, value in found.items() if value is not None}
    for run, value in values.items():
        look: dict[str, Any] = {"linestyle": "--", "linewidth": width, "label": runs[run]}
        panel.axhline(value, color=STRATEGY_COLOURS[run.partition("/")[2]], **look)
    return list(values.values())


def _shade(colour: str, number: int) -> tuple[float, float, float]:
    """Return a colour mixed with white: the larger the weight, the stronger."""
    part = 0.25 + 0.25 * (number - 1)
    red, green, blue = (1.0 - part + part * value for value in to_rgb(colour))
    return red, green, blue
