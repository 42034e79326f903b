"""Figures against the paper's: printed against found, share of the possible, robustness."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from iptm_reproduction import figures as fig
from iptm_reproduction.figures import share_of_saving
from iptm_reproduction.plots.style import (
    PAPER_COLOUR,
    SERIES_COLOURS,
    STRATEGY_COLOURS,
    change_panel,
    labelled,
    legend_below,
    new_figure,
    plot,
)
from iptm_reproduction.printed import HEADLINE_CHANGES, printed_change
from iptm_reproduction.runs import (
    DEFAULT_CONTROLLER,
    MULTI_HORIZON,
    OPTIMUM,
    PROPOSED,
    REFERENCE,
    STRATEGIES,
    STRATEGY_NAMES,
    Results,
    controller_name,
    words,
)

_MULTI = "multi_horizon"
_DEFAULT_RUN = f"imperfect_previews/perfect/{DEFAULT_CONTROLLER}"
CONTROLLER_COLOURS = {**STRATEGY_COLOURS, _MULTI: "#0b4d1a", DEFAULT_CONTROLLER: "#08306b"}
_PRINTED = {"facecolor": "white", "edgecolor": PAPER_COLOUR, "hatch": "////"}


@plot(
    "Strategy table: found and printed",
    "Changes against the reference.",
    needs=(REFERENCE, PROPOSED),
    wanted=STRATEGIES,
)
def strategy_changes(results: Results) -> Figure:
    """Draw the changes of the strategy table, found next to printed."""
    figure, panels = new_figure(4.6, 2, 3)
    others = dict(zip(list(STRATEGY_NAMES)[1:], STRATEGIES[1:], strict=True))
    terms = [name.replace("reference", "ref").replace("_", "\n") for name in others]
    last = len(others) - 1
    for panel, shown in zip(panels, fig.TABLE_FIGURES, strict=True):
        for place, (name, run) in enumerate(others.items()):
            change = results.change(run, REFERENCE, shown)
            if change is not None:
                text = "found (colour of the strategy)" if place == last else None
                colour = STRATEGY_COLOURS[name]
                panel.bar(place - 0.2, 100.0 * change, 0.4, color=colour, label=text)
            panel.bar(
                place + 0.2,
                100.0 * printed_change(run, shown),
                0.4,
                label="printed" if place == 0 else None,
                **_PRINTED,  # type: ignore[arg-type]
            )
        change_panel(panel, terms, shown.label, size=6.5)
    legend_below(figure, panels[0], 2)
    return figure


@plot(
    "Headline comparison: found and printed",
    "Aging on 3 × 1 s + 5 × 5 s against the reference on 15 × 1 s.",
    needs=(REFERENCE, MULTI_HORIZON),
)
def headline(results: Results) -> Figure:
    """Draw the headline changes, found next to printed."""
    figure, (panel,) = new_figure(2.9)
    for place, (shown, printed) in enumerate(HEADLINE_CHANGES.items()):
        change = results.change(MULTI_HORIZON, REFERENCE, shown)
        for side, name, value, look in (
            (-0.2, "found", change, {"color": CONTROLLER_COLOURS[_MULTI]}),
            (0.2, "printed", printed, _PRINTED),
        ):
            if value is None:
                continue
            bar = panel.bar(
                place + side,
                100.0 * value,
                0.4,
                label=name if place == 0 else None,
                **look,  # type: ignore[arg-type]
            )
            panel.bar_label(bar, fmt="%.1f", fontsize=7)
    change_panel(panel, [shown.label.replace(" ", "\n", 1) for shown in HEADLINE_CHANGES], size=7)
    panel.margins(y=0.12)
    legend_below(figure, panel, 2)
    return figure


@plot(
    "Distance to the optimum",
    "Part of the possible saving of degradation: nothing for the reference, everything for the whole trip "
    "solved as one problem.",
    needs=(REFERENCE, OPTIMUM),
    wanted=(*STRATEGIES, MULTI_HORIZON, _DEFAULT_RUN),
)
def saving_shares(results: Results) -> Figure:
    """Draw which part of the possible saving of degradation each controller reaches."""
    runs = dict(zip(STRATEGY_NAMES, STRATEGIES, strict=True))
    runs |= {_MULTI: MULTI_HORIZON, DEFAULT_CONTROLLER: _DEFAULT_RUN}
    reference, optimum = (results.value(run, fig.DEGRADATION) for run in (REFERENCE, OPTIMUM))
    figure, (panel,) = new_figure(2.8)
    for place, (controller, run) in enumerate(runs.items()):
        value = results.find(run, fig.DEGRADATION)
        share = None if value is None else share_of_saving(value, reference, optimum)
        if share is None:
            continue
        colour = CONTROLLER_COLOURS[controller]
        bar = panel.barh(place, 100.0 * share, 0.7, color=colour, label=controller_name(controller))
        panel.bar_label(bar, fmt="%.1f %%", fontsize=8, padding=2)
    panel.set_yticks(range(len(runs)), [controller_name(controller) for controller in runs])
    panel.invert_yaxis()
    panel.axvline(100.0, color="black", linewidth=1.0)
    panel.margins(x=0.08)
    labelled(panel, "part of the possible saving of degradation [%]")
    return figure


@plot(
    "Imperfect previews",
    "Changes against the reference with perfect previews.",
    needs=("imperfect_previews/perfect/reference", "imperfect_previews/perfect/aging"),
)
def imperfect_previews(results: Results) -> Figure:
    """Draw degradation and energy of each controller under imperfect previews, against the reference."""
    runs = [run.address.split("/") for run in results.study("imperfect_previews")]
    previews = list(dict.fromkeys(preview for _, preview, _ in runs))
    present = {controller for _, _, controller in runs}
    controllers = [name for name in CONTROLLER_COLOURS if name in present]
    figure, panels = new_figure(3.4, 1, 2)
    width = 0.8 / max(1, len(controllers))
    for panel, shown in zip(panels, (fig.DEGRADATION, fig.TOTAL), strict=True):
        for index, controller in enumerate(controllers):
            changes = [
                results.change(
                    f"imperfect_previews/{preview}/{controller}",
                    "imperfect_previews/perfect/reference",
                    shown,
                )
                for preview in previews
            ]
            panel.bar(
                np.arange(len(previews)) + (index - 0.5 * (len(controllers) - 1)) * width,
                [_percent(change) for change in changes],
                width,
                color=CONTROLLER_COLOURS[controller],
                label=controller_name(controller),
            )
        change_panel(panel, [words(preview) for preview in previews], shown.label)
    legend_below(figure, panels[0], 4)
    return figure


@plot(
    "Other values of what the paper omits",
    "Changes of the aging strategies against the reference with the same values.",
    needs=("omitted_parameters/as_chosen/reference", "omitted_parameters/as_chosen/aging"),
)
def omitted_parameters(results: Results) -> Figure:
    """Draw changes of the aging strategies against the reference, for other values of what is omitted."""
    runs = results.study("omitted_parameters")
    variations = list(dict.fromkeys(run.address.split("/")[1] for run in runs))
    figure, panels = new_figure(0.9 + 0.24 * len(variations), 1, 4, sharey=True)
    for panel, shown in zip(
        panels, (fig.DEGRADATION, fig.TOTAL, fig.COOLING, fig.INCONSISTENCY), strict=True
    ):
        for controller, marker in (("aging", "o"), (_MULTI, "s"), (DEFAULT_CONTROLLER, "^")):
            for place, variation in enumerate(variations):
                study = f"omitted_parameters/{variation}"
                change = results.change(f"{study}/{controller}", f"{study}/reference", shown)
                panel.plot(
                    _percent(change),
                    place,
                    marker,
                    color=CONTROLLER_COLOURS[controller],
                    markersize=5,
                    label=controller_name(controller) if place == 0 else None,
                )
        panel.axvline(0.0, color="black", linewidth=0.7)
        labelled(panel, "change [%]", "", shown.short or shown.label)
    panels[0].set_yticks(range(len(variations)), [words(name) for name in variations])
    panels[0].invert_yaxis()
    legend_below(figure, panels[0], 3)
    return figure


def _percent(change: float | None) -> float:
    """Return a change in percent, not a number where a run is missing."""
    return float("nan") if change is None else 100.0 * change


@plot(
    "Long steps against fine steps",
    "Multi-horizon grids against 1 s steps over the same length in seconds.",
    needs=("discretisation/28/fine", "discretisation/28/3+5"),
)
def discretisation(results: Results) -> Figure:
    """Draw multi-horizon grids against fine grids of the same length in seconds."""
    runs = [run.address.split("/") for run in results.study("discretisation")]
    lengths = list(dict.fromkeys(length for _, length, _ in runs))
    long_steps = {length: grid for _, length, grid in runs if grid != "fine"}
    names = [f"{length} s\nMH {long_steps.get(length, '')}" for length in lengths]
    figure, panels = new_figure(2.9, 1, 3)
    for panel, shown in zip(panels, (fig.DEGRADATION, fig.TOTAL, fig.COMPUTING_TIME), strict=True):
        for place, length in enumerate(lengths):
            study = f"discretisation/{length}"
            change = results.change(f"{study}/{long_steps.get(length)}", f"{study}/fine", shown)
            if change is not None:
                bar = panel.bar(place, 100.0 * change, 0.6, color=SERIES_COLOURS[1])
                panel.bar_label(bar, fmt="%.2f", fontsize=7.5)
        change_panel(panel, names, shown.label, "change from 1 s steps [%]", 7)
        panel.margins(y=0.15)
    return figure
