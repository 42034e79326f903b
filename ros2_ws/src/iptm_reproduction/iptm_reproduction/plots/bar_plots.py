"""Changes and shares as bars: found next to printed, part of the possible saving, and whole studies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iptm_core.metrics.figures import FIGURES
from iptm_reproduction import names
from iptm_reproduction.names import (
    DEFAULT_CONTROLLER,
    MULTI_HORIZON,
    REFERENCE,
    STRATEGIES,
    STRATEGY_NAMES,
    controller_name,
    words,
)
from iptm_reproduction.plots.style import (
    CONTROLLER_COLOURS,
    PAPER_COLOUR,
    SERIES_COLOURS,
    STRATEGY_COLOURS,
    change_panel,
    labelled,
    legend_below,
    new_figure,
)
from iptm_reproduction.printed import printed_change
from iptm_reproduction.results import Results

_MULTI = "multi_horizon"
_PRINTED: dict[str, Any] = {"facecolor": "white", "edgecolor": PAPER_COLOUR, "hatch": "////"}


def _percent(change: float | None) -> float:
    """Return a change in percent, not a number where a run is missing."""
    return float("nan") if change is None else 100.0 * change


def _parts(results: Results, study: str, place: int) -> list[str]:
    """Return what stands at a place of the addresses of a study, each once, in order."""
    return list(dict.fromkeys(run.split("/")[place] for run in results.matching(f"{study}/*")))


def strategy_changes(results: Results) -> Figure:
    """Draw the changes of the strategy table, found next to printed."""
    figure, panels = new_figure(4.6, 2, 3)
    others = dict(zip(list(STRATEGY_NAMES)[1:], STRATEGIES[1:], strict=True))
    terms = [name.replace("reference", "ref").replace("_", "\n") for name in others]
    last = len(others) - 1
    for panel, shown in zip(panels, names.TABLE_FIGURES, strict=True):
        for place, (name, run) in enumerate(others.items()):
            change = results.change(run, REFERENCE, shown)
            if change is not None:
                text = "found (colour of the strategy)" if place == last else None
                colour = STRATEGY_COLOURS[name]
                panel.bar(place - 0.2, 100.0 * change, 0.4, color=colour, label=text)
            printed = 100.0 * printed_change(run, shown)
            text = "printed" if place == 0 else None
            panel.bar(place + 0.2, printed, 0.4, label=text, **_PRINTED)
        change_panel(panel, terms, FIGURES[shown].label, size=6.5)
    legend_below(figure, panels[0], 2)
    return figure


def headline(results: Results) -> Figure:
    """Draw the headline changes, found next to printed."""
    figure, (panel,) = new_figure(2.9)
    for place, shown in enumerate(names.HEADLINE_FIGURES):
        change = results.change(MULTI_HORIZON, REFERENCE, shown)
        for side, name, value, look in (
            (-0.2, "found", change, {"color": CONTROLLER_COLOURS[_MULTI]}),
            (0.2, "printed", printed_change(MULTI_HORIZON, shown), _PRINTED),
        ):
            if value is None:
                continue
            text = name if place == 0 else None
            bar = panel.bar(place + side, 100.0 * value, 0.4, label=text, **look)
            panel.bar_label(bar, fmt="%.1f", fontsize=7)
    texts = [FIGURES[shown].label.replace(" ", "\n", 1) for shown in names.HEADLINE_FIGURES]
    change_panel(panel, texts, size=7)
    panel.margins(y=0.12)
    legend_below(figure, panel, 2)
    return figure


def saving_shares(results: Results) -> Figure:
    """Draw which part of the possible saving of degradation each controller reaches."""
    runs = dict(zip(STRATEGY_NAMES, STRATEGIES, strict=True))
    runs |= {
        _MULTI: MULTI_HORIZON,
        DEFAULT_CONTROLLER: f"imperfect_previews/perfect/{DEFAULT_CONTROLLER}",
    }
    figure, (panel,) = new_figure(2.8)
    for place, (controller, run) in enumerate(runs.items()):
        share = results.share_of_saving(run)
        if share is None:
            continue
        colour = CONTROLLER_COLOURS[controller]
        bar = panel.barh(place, 100.0 * share, 0.7, color=colour, label=controller_name(controller))
        panel.bar_label(bar, fmt="%.1f %%", fontsize=8, padding=2)
    _named_rows(panel, [controller_name(controller) for controller in runs])
    panel.axvline(100.0, color="black", linewidth=1.0)
    panel.margins(x=0.08)
    labelled(panel, "part of the possible saving of degradation [%]")
    return figure


def _named_rows(panel: Axes, names: Sequence[str]) -> None:
    """Name the rows of a panel, the first one on top."""
    panel.set_yticks(range(len(names)), names)
    panel.invert_yaxis()


def imperfect_previews(results: Results) -> Figure:
    """Draw degradation and energy of each controller under imperfect previews, against the reference."""
    study = "imperfect_previews"
    previews = _parts(results, study, 1)
    present = _parts(results, study, 2)
    controllers = [name for name in CONTROLLER_COLOURS if name in present]
    figure, panels = new_figure(3.4, 1, 2)
    width = 0.8 / max(1, len(controllers))
    for panel, shown in zip(panels, (names.DEGRADATION, names.TOTAL), strict=True):
        for index, controller in enumerate(controllers):
            runs = [f"{study}/{preview}/{controller}" for preview in previews]
            base = f"{study}/perfect/reference"
            panel.bar(
                np.arange(len(previews)) + (index - 0.5 * (len(controllers) - 1)) * width,
                [_percent(results.change(run, base, shown)) for run in runs],
                width,
                color=CONTROLLER_COLOURS[controller],
                label=controller_name(controller),
            )
        change_panel(panel, list(map(words, previews)), FIGURES[shown].label)
    legend_below(figure, panels[0], 4)
    return figure


def omitted_parameters(results: Results) -> Figure:
    """Draw changes of the aging strategies against the reference, for other values of what is omitted."""
    variations = _parts(results, "omitted_parameters", 1)
    figure, panels = new_figure(0.9 + 0.24 * len(variations), 1, 4, sharey=True)
    for panel, shown in zip(
        panels, (names.DEGRADATION, names.TOTAL, names.COOLING, names.INCONSISTENCY), strict=True
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
        labelled(panel, "change [%]", "", FIGURES[shown].short or FIGURES[shown].label)
    _named_rows(panels[0], list(map(words, variations)))
    legend_below(figure, panels[0], 3)
    return figure


def discretisation(results: Results) -> Figure:
    """Draw multi-horizon grids against fine grids of the same length in seconds."""
    lengths = _parts(results, "discretisation", 1)
    runs = [run.split("/") for run in results.matching("discretisation/*")]
    long_steps = {length: grid for _, length, grid in runs if grid != "fine"}
    texts = [f"{length} s\nMH {long_steps.get(length, '')}" for length in lengths]
    figure, panels = new_figure(2.9, 1, 3)
    for panel, shown in zip(
        panels, (names.DEGRADATION, names.TOTAL, names.COMPUTING_TIME), strict=True
    ):
        for place, length in enumerate(lengths):
            study = f"discretisation/{length}"
            change = results.change(f"{study}/{long_steps.get(length)}", f"{study}/fine", shown)
            if change is not None:
                bar = panel.bar(place, 100.0 * change, 0.6, color=SERIES_COLOURS[1])
                panel.bar_label(bar, fmt="%.2f", fontsize=7.5)
        change_panel(panel, texts, FIGURES[shown].label, "change from 1 s steps [%]", 7)
        panel.margins(y=0.15)
    return figure
