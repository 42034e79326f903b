"""Figures of the sensitivity studies: weights, prediction horizon, multi-horizon grids."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from iptm_studies.report.measures import MEASURES
from iptm_studies.report.naming import STRATEGY_NAMES
from iptm_studies.report.paper import PaperClaims
from iptm_studies.report.plots.style import (
    PAPER_COLOUR,
    SERIES_COLOURS,
    STRATEGY_COLOURS,
    labelled,
    legend_below,
    new_figure,
    room_for,
    wrapped,
)
from iptm_studies.report.plots.trip_plots import HORIZONS_S
from iptm_studies.report.runs import PROPOSED_RUN, REFERENCE_RUN, Results

WEIGHTED = ("reference_energy", "reference_aging", "reference_energy_aging", "energy_aging")
SPLITS = ("3+12", "5+10", "8+7", "10+5", "12+3")
LONG_STEPS_S = (2, 5, 8, 10, 15)
SHORT_STEPS = (3, 5)
LONG_STEP_COUNTS = (5, 10, 12, 15, 20)

_FOUR = ("cooling_energy", "traction_energy", "cell_1_degradation", "cell_n_degradation")
_RANGE_CLAIMS = {
    "cooling_energy": "length-cooling-range",
    "traction_energy": "length-traction-range",
    "cell_1_degradation": "length-cell-1-range",
    "cell_n_degradation": "length-cell-n-range",
    "inconsistency": "length-inconsistency-range",
}


def draw_weighting(results: Results, paper: PaperClaims) -> Figure:  # noqa: ARG001
    """Four figures of each weighted strategy for its four weights, shades from small to large."""
    figure, panels = new_figure(5.2, 2, 2)
    present = [
        name
        for name in WEIGHTED
        if not results.missing(f"weighting/{name}/{n}" for n in _numbers())
    ]
    for panel, key in zip(panels, _FOUR, strict=True):
        seen = []
        for place, strategy in enumerate(present):
            for number in _numbers():
                value = results.measure(f"weighting/{strategy}/{number}", key)
                if value is None:
                    continue
                seen.append(value)
                panel.bar(
                    place + 0.2 * (number - 2.5),
                    value,
                    0.18,
                    color=_shade(STRATEGY_COLOURS[strategy], number),
                )
        seen += _reference_lines(panel, results, key)
        panel.set_xticks(range(len(present)), [wrapped(STRATEGY_NAMES[name]) for name in present])
        panel.tick_params(axis="x", labelsize=7)
        room_for(panel, seen)
        labelled(panel, "", "", MEASURES[key].short_title)
    legend_below(figure, panels[0], 2)
    return figure


def draw_prediction_horizon(results: Results, paper: PaperClaims) -> Figure:  # noqa: ARG001
    """Figures of the proposed strategy over the length of a single horizon."""
    keys = (*_FOUR, "inconsistency", "solve_total")
    figure, panels = new_figure(4.2, 2, 3)
    for panel, key in zip(panels, keys, strict=True):
        series = {
            horizon: results.measure(f"prediction_horizon/{horizon}", key) for horizon in HORIZONS_S
        }
        seen = _line(panel, series, STRATEGY_COLOURS["aging"], "Aging (proposed)")
        if key != "solve_total":
            seen += _reference_lines(panel, results, key, proposed=False)
            room_for(panel, seen)
        else:
            panel.set_ylim(bottom=0.0)
        panel.set_xticks(HORIZONS_S)
        labelled(panel, "horizon [s]", "", MEASURES[key].short_title)
    legend_below(figure, panels[0], 2)
    return figure


def draw_sampling_time(results: Results, paper: PaperClaims) -> Figure:  # noqa: ARG001
    """Figures of the proposed strategy over the sampling time of the long horizon, by split."""
    figure, panels = new_figure(4.9, 2, 2, sharex=True)
    for panel, key in zip(panels, _FOUR, strict=True):
        seen = []
        for split, colour in zip(SPLITS, SERIES_COLOURS, strict=True):
            series = {
                step: results.measure(f"sampling_time/{split}/{step}", key) for step in LONG_STEPS_S
            }
            seen += _line(panel, series, colour, f"{split} steps")
        single = results.measure(PROPOSED_RUN, key)
        if single is not None:
            panel.axhline(
                single, color=STRATEGY_COLOURS["aging"], linestyle="--", label="SH, 15 steps of 1 s"
            )
            seen.append(single)
        panel.set_xticks(LONG_STEPS_S)
        room_for(panel, seen, 0.1)
        labelled(panel, "", "", MEASURES[key].short_title)
    for panel in panels[2:]:
        labelled(panel, "sampling time of the long horizon [s]", "", panel.get_title("left"))
    legend_below(figure, panels[0], 6)
    return figure


def draw_long_horizon(results: Results, paper: PaperClaims) -> Figure:
    """Figures of the proposed strategy over the number of long steps; the paper's range as a band."""
    keys = ("solve_total", *_FOUR, "inconsistency")
    figure, panels = new_figure(4.4, 2, 3)
    for panel, key in zip(panels, keys, strict=True):
        seen = []
        for first, colour in zip(SHORT_STEPS, ("#2171b5", "#e08214"), strict=True):
            series = {
                steps: results.measure(f"long_horizon/{first}+{steps}", key)
                for steps in LONG_STEP_COUNTS
            }
            seen += _line(panel, series, colour, f"N_p1 = {first}")
        single = results.measure(PROPOSED_RUN, key)
        if single is not None:
            panel.axhline(
                single, color=STRATEGY_COLOURS["aging"], linestyle="--", label="SH, 15 steps of 1 s"
            )
            seen.append(single)
            band = _printed_range(paper, key)
            if band is not None:
                ends = [(1.0 + change) * single for change in band]
                panel.axhspan(
                    *ends,
                    color=PAPER_COLOUR,
                    alpha=0.18,
                    linewidth=0.0,
                    label="paper: change from SH",
                )
                seen += ends
        if key == "solve_total":
            panel.set_ylim(bottom=0.0)
        else:
            room_for(panel, seen, 0.1)
        panel.set_xticks(LONG_STEP_COUNTS)
        labelled(panel, "long steps N_p2", "", MEASURES[key].short_title)
    legend_below(figure, panels[1], 4)
    return figure


def _numbers() -> range:
    """Numbers of the weights of a strategy."""
    return range(1, 5)


def _line(panel: Axes, series: Mapping[int, float | None], colour: str, name: str) -> list[float]:
    """Draw what there is of a series; returns the values."""
    known = {place: value for place, value in series.items() if value is not None}
    if known:
        panel.plot(
            list(known),
            list(known.values()),
            "o-",
            color=colour,
            markersize=3.5,
            linewidth=1.2,
            label=name,
        )
    return list(known.values())


def _reference_lines(
    panel: Axes, results: Results, key: str, *, proposed: bool = True
) -> list[float]:
    """Reference and proposed strategy as lines to compare with; returns their values."""
    seen = []
    lines = ((REFERENCE_RUN, "reference"), (PROPOSED_RUN, "aging"))
    for address, strategy in lines if proposed else lines[:1]:
        value = results.measure(address, key)
        if value is not None:
            panel.axhline(
                value,
                color=STRATEGY_COLOURS[strategy],
                linestyle="--",
                linewidth=1.2,
                label=STRATEGY_NAMES[strategy],
            )
            seen.append(value)
    return seen


def _shade(colour: str, number: int) -> tuple[float, float, float]:
    """A colour mixed with white: the larger the weight, the stronger."""
    part = 0.25 + 0.25 * (number - 1)
    red, green, blue = (1.0 - part + part * value for value in to_rgb(colour))
    return red, green, blue


def _printed_range(paper: PaperClaims, key: str) -> tuple[float, float] | None:
    """The printed range of changes against the single horizon, if the paper prints one."""
    for claim in paper.claims:
        if claim.id == _RANGE_CLAIMS.get(key):
            rule: Any = claim.rule
            return float(rule.lowest), float(rule.highest)
    return None
