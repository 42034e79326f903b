"""One look for all pictures of the report: sizes, colours, and small files."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from iptm_core.errors import StoreError
from iptm_reproduction.names import DEFAULT_CONTROLLER

WIDTH_INCH = 7.6
DPI = 105
MOST_BYTES = 200_000

STRATEGY_COLOURS = {
    "reference": "#555555",
    "reference_energy": "#1f77b4",
    "reference_aging": "#9467bd",
    "reference_energy_aging": "#17a2b8",
    "energy_aging": "#e08214",
    "aging": "#2a9d3a",
}
"""Okabe-Ito inspired; the proposed strategy is green, the reference grey, everywhere."""

CONTROLLER_COLOURS = {
    **STRATEGY_COLOURS,
    "multi_horizon": "#0b4d1a",
    DEFAULT_CONTROLLER: "#08306b",
}

SERIES_COLOURS = ("#08306b", "#2171b5", "#41ab5d", "#e08214", "#a50f15")
"""For a few values of one quantity, from small to large."""

PAPER_COLOUR = "#b03060"
"""Whatever comes from the printed paper."""

LIMIT_COLOUR = "#c0392b"
OPTIMUM_COLOUR = "#111111"
LINE = 1.1


def new_figure(
    height_inch: float, rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure of page width and its panels, row by row; options are those of ``Figure.subplots``."""
    figure = Figure(figsize=(WIDTH_INCH, height_inch), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    panels = np.atleast_1d(np.asarray(figure.subplots(rows, columns, **options)))
    axes: list[Axes] = list(panels.ravel())
    for panel in axes:
        tidy(panel)
    return figure, axes


def tidy(panel: Axes) -> None:
    """Set small type, a light grid and no box."""
    panel.tick_params(labelsize=8)
    panel.grid(visible=True, color="#dddddd", linewidth=0.6)
    panel.set_axisbelow(True)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)


def labelled(panel: Axes, x: str = "", y: str = "", title: str = "") -> None:
    """Set labels in the common sizes."""
    panel.set_xlabel(x, fontsize=8.5)
    panel.set_ylabel(y, fontsize=8.5)
    if title:
        panel.set_title(title, fontsize=9, loc="left")


def change_panel(
    panel: Axes, names: Sequence[str], title: str = "", y: str = "change [%]", size: float = 8.0
) -> None:
    """Label a panel of changes around zero, one place per name."""
    panel.axhline(0.0, color="black", linewidth=0.7)
    panel.set_xticks(range(len(names)), names)
    panel.tick_params(axis="x", labelsize=size)
    labelled(panel, "", y, title)


def legend_below(figure: Figure, panel: Axes, columns: int) -> None:
    """Put one legend for all panels, under them."""
    handles, labels = panel.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=columns, fontsize=8, frameon=False
    )


def room_for(panel: Axes, values: Sequence[float], share: float = 0.25) -> None:
    """Limit the vertical axis to the values with some room, so that small differences show."""
    low, high = min(values), max(values)
    room = share * (high - low) or 0.05 * abs(high) or 1.0
    panel.set_ylim(low - room, high + room)


def wrapped(name: str) -> str:
    """Return a name over several lines, for narrow places."""
    return name.replace(" + ", "\n+ ").replace(" (", "\n(")


def png_bytes(figure: Figure, name: str) -> bytes:
    """Return a figure as a PNG file.

    Raises:
        StoreError: the file would be larger than what the documentation takes.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None}, pil_kwargs={"optimize": True})
    content = buffer.getvalue()
    if len(content) > MOST_BYTES:
        raise StoreError(f"figure {name} takes {len(content)} bytes; allowed: up to {MOST_BYTES}")
    return content
