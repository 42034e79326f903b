"""Figures beside the paper's: printed against found, share of the possible, robustness."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from iptm_studies.report.measures import (
    MEASURES,
    TABLE_MEASURES,
    relative_change,
    share_of_saving,
)
from iptm_studies.report.naming import STRATEGY_NAMES, controller_name, words
from iptm_studies.report.paper import PaperClaims
from iptm_studies.report.plots.power_plots import strategy_runs
from iptm_studies.report.plots.style import (
    PAPER_COLOUR,
    SERIES_COLOURS,
    STRATEGY_COLOURS,
    labelled,
    legend_below,
    new_figure,
)
from iptm_studies.report.runs import (
    HEADLINE_RUN,
    OPTIMUM_RUN,
    REFERENCE_RUN,
    Results,
)

CONTROLLER_COLOURS = {**STRATEGY_COLOURS, "multi_horizon": "#0b4d1a"}
_MULTI = "multi_horizon"


def draw_strategy_changes(results: Results, paper: PaperClaims) -> Figure:
    """Changes of the strategy table, found beside printed."""
    figure, panels = new_figure(4.6, 2, 3)
    strategies = [name for name in paper.strategy_table.order if name != "reference"]
    for panel, key in zip(panels, TABLE_MEASURES, strict=True):
        for place, strategy in enumerate(strategies):
            change = relative_change(
                results.measure(f"strategies/{strategy}", key), results.measure(REFERENCE_RUN, key)
            )
            if change is not None:
                panel.bar(
                    place - 0.2,
                    100.0 * change,
                    0.4,
                    color=STRATEGY_COLOURS[strategy],
                    label="found (colour of the strategy)"
                    if place == len(strategies) - 1
                    else None,
                )
            panel.bar(
                place + 0.2,
                100.0 * paper.strategy_table.changes[key][place],
                0.4,
                facecolor="white",
                edgecolor=PAPER_COLOUR,
                hatch="////",
                label="printed" if place == 0 else None,
            )
        panel.axhline(0.0, color="black", linewidth=0.7)
        terms = [name.replace("reference", "ref").replace("_", "\n") for name in strategies]
        panel.set_xticks(range(len(strategies)), terms)
        panel.tick_params(axis="x", labelsize=6.5)
        labelled(panel, "", "change [%]", MEASURES[key].label)
    legend_below(figure, panels[0], 2)
    return figure


def draw_headline(results: Results, paper: PaperClaims) -> Figure:
    """Headline changes, found beside printed."""
    figure, (panel,) = new_figure(2.9)
    keys = list(paper.headline.changes)
    for place, key in enumerate(keys):
        change = relative_change(
            results.measure(paper.headline.run, key), results.measure(paper.headline.base, key)
        )
        for side, value, look in (
            (-0.2, change, {"color": CONTROLLER_COLOURS[_MULTI]}),
            (
                0.2,
                paper.headline.changes[key],
                {"facecolor": "white", "edgecolor": PAPER_COLOUR, "hatch": "////"},
            ),
        ):
            if value is None:
                continue
            bar = panel.bar(
                place + side,
                100.0 * value,
                0.4,
                label=("found" if side < 0.0 else "printed") if place == 0 else None,
                **look,  # type: ignore[arg-type]
            )
            panel.bar_label(bar, fmt="%.1f", fontsize=7)
    panel.axhline(0.0, color="black", linewidth=0.7)
    panel.set_xticks(range(len(keys)), [MEASURES[key].label.replace(" ", "\n", 1) for key in keys])
    panel.tick_params(axis="x", labelsize=7)
    panel.margins(y=0.12)
    labelled(panel, "", "change [%]")
    legend_below(figure, panel, 2)
    return figure


def draw_saving_shares(results: Results, paper: PaperClaims) -> Figure:  # noqa: ARG001
    """Which part of the possible saving of degradation each controller reaches."""
    runs = {STRATEGY_NAMES[name]: (run, name) for name, run in strategy_runs().items()}
    runs["Aging, MH 3+5"] = (HEADLINE_RUN, _MULTI)
    reference = results[REFERENCE_RUN].measures["total_degradation"]
    optimum = results[OPTIMUM_RUN].measures["total_degradation"]
    figure, (panel,) = new_figure(2.8)
    for place, (name, (run, strategy)) in enumerate(runs.items()):
        value = results.measure(run, "total_degradation")
        share = None if value is None else share_of_saving(value, reference, optimum)
        if share is None:
            continue
        bar = panel.barh(place, 100.0 * share, 0.7, color=CONTROLLER_COLOURS[strategy], label=name)
        panel.bar_label(bar, fmt="%.1f %%", fontsize=8, padding=2)
    panel.set_yticks(range(len(runs)), list(runs))
    panel.invert_yaxis()
    panel.axvline(100.0, color="black", linewidth=1.0)
    panel.margins(x=0.08)
    labelled(panel, "part of the possible saving of degradation [%]")
    return figure


def draw_previews(results: Results, paper: PaperClaims) -> Figure:  # noqa: ARG001
    """Degradation and energy of each controller under imperfect previews, against the reference."""
    runs = results.study("imperfect_previews")
    previews = list(dict.fromkeys(run.address.split("/")[1] for run in runs))
    present = {run.address.split("/")[2] for run in runs}
    controllers = [name for name in CONTROLLER_COLOURS if name in present]
    figure, panels = new_figure(3.4, 1, 2)
    width = 0.8 / max(1, len(controllers))
    for panel, key in zip(panels, ("total_degradation", "total_energy_printed"), strict=True):
        for index, controller in enumerate(controllers):
            values = _against(
                results,
                key,
                {preview: f"imperfect_previews/{preview}/{controller}" for preview in previews},
                "imperfect_previews/perfect/reference",
            )
            places = np.arange(len(previews)) + (index - 0.5 * (len(controllers) - 1)) * width
            panel.bar(
                places,
                [100.0 * values[preview] for preview in previews],
                width,
                color=CONTROLLER_COLOURS.get(controller, "#999999"),
                label=controller_name(controller),
            )
        panel.axhline(0.0, color="black", linewidth=0.7)
        panel.set_xticks(range(len(previews)), [words(preview) for preview in previews])
        labelled(panel, "", "change [%]", MEASURES[key].label)
    legend_below(figure, panels[0], 4)
    return figure


def draw_omitted(results: Results, paper: PaperClaims) -> Figure:  # noqa: ARG001
    """Change of the proposed strategy against the reference, for other values of what the paper omits."""
    runs = results.study("omitted_parameters")
    variations = list(dict.fromkeys(run.address.split("/")[1] for run in runs))
    figure, panels = new_figure(0.9 + 0.24 * len(variations), 1, 4, sharey=True)
    keys = ("total_degradation", "total_energy_printed", "cooling_energy", "inconsistency")
    for panel, key in zip(panels, keys, strict=True):
        for controller, marker in (("aging", "o"), (_MULTI, "s")):
            for place, variation in enumerate(variations):
                values = _against(
                    results,
                    key,
                    {variation: f"omitted_parameters/{variation}/{controller}"},
                    f"omitted_parameters/{variation}/reference",
                )
                panel.plot(
                    100.0 * values[variation],
                    place,
                    marker,
                    color=CONTROLLER_COLOURS[controller],
                    markersize=5,
                    label=controller_name(controller) if place == 0 else None,
                )
        panel.axvline(0.0, color="black", linewidth=0.7)
        labelled(panel, "change [%]", "", MEASURES[key].short or MEASURES[key].label)
    panels[0].set_yticks(range(len(variations)), [words(name) for name in variations])
    panels[0].invert_yaxis()
    legend_below(figure, panels[0], 2)
    return figure


def _against(results: Results, key: str, runs: Mapping[str, str], base: str) -> dict[str, float]:
    """Relative changes against a base; not a number where a run is missing."""
    found = {}
    for name, run in runs.items():
        change = relative_change(results.measure(run, key), results.measure(base, key))
        found[name] = float("nan") if change is None else change
    return found


def draw_discretisation(results: Results, paper: PaperClaims) -> Figure:  # noqa: ARG001
    """Multi-horizon grids beside fine grids of the same length in seconds."""
    runs = results.study("discretisation")
    lengths = list(dict.fromkeys(run.address.split("/")[1] for run in runs))
    figure, panels = new_figure(2.9, 1, 3)
    keys = ("total_degradation", "total_energy_printed", "solve_total")
    for panel, key in zip(panels, keys, strict=True):
        for place, length in enumerate(lengths):
            fine = results.measure(f"discretisation/{length}/fine", key)
            for run in runs:
                _, here, grid = run.address.split("/")
                change = relative_change(run.measures.get(key), fine)
                if here != length or grid == "fine" or change is None:
                    continue
                bar = panel.bar(place, 100.0 * change, 0.6, color=SERIES_COLOURS[1])
                panel.bar_label(bar, fmt="%.2f", fontsize=7.5)
        panel.axhline(0.0, color="black", linewidth=0.7)
        grids = {
            run.address.split("/")[1]: run.address.split("/")[2]
            for run in runs
            if not run.address.endswith("/fine")
        }
        panel.set_xticks(
            range(len(lengths)), [f"{name} s\nMH {grids.get(name, '')}" for name in lengths]
        )
        panel.tick_params(axis="x", labelsize=7)
        panel.margins(y=0.15)
        labelled(panel, "", "change from 1 s steps [%]", MEASURES[key].label)
    return figure
