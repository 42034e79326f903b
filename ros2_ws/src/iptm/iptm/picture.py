"""Panels as a picture, drawn by matplotlib."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

from iptm.panels import Curve, Panel

_HEADING_COLUMNS = 130
_FOOTER_COLUMNS = 170
_WIDTH_INCHES = 12.0
_INCHES_PER_HEIGHT = 1.72
_HEADING_INCHES = 1.2
_DOTS_PER_INCH = 100
STYLE: Any = {
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "legend.borderaxespad": 0.2,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.4,
}


class Picture(Figure):
    """A matplotlib figure that notebooks show without pyplot."""

    def png(self, metadata: Mapping[str, str] | None = None) -> bytes:
        """Return the content of a PNG file, the one that `savefig` writes: that draws twice."""
        file, canvas = io.BytesIO(), cast("Any", FigureCanvasAgg(self))
        with rc_context(STYLE):
            canvas.print_png(file, metadata=metadata)
        return file.getvalue()

    _repr_png_ = png

    def savefig(self, *args: Any, **options: Any) -> None:
        """Write the figure to a file; the options are passed to matplotlib."""
        with rc_context(STYLE):
            super().savefig(*args, **options)


def picture(panels: Sequence[Panel], heading: Sequence[str] = (), footer: str = "") -> Picture:
    """Return a picture of panels, from top to bottom, with lines above and a text below them."""
    heights = [panel.height for panel in panels]
    size = (_WIDTH_INCHES, _HEADING_INCHES + _INCHES_PER_HEIGHT * sum(heights))
    with rc_context(STYLE):
        layout = ConstrainedLayoutEngine(h_pad=0.06, hspace=0.03)
        figure = Picture(figsize=size, dpi=_DOTS_PER_INCH, layout=layout)
        FigureCanvasAgg(figure)
        all_axes = figure.subplots(len(panels), 1, sharex=True, height_ratios=heights)
        for axes, panel in zip(all_axes, panels, strict=True):
            _draw(axes, panel)
        all_axes[-1].set_xlabel("time (s)")
        figure.align_ylabels(all_axes)
        if heading:
            text = "\n".join(textwrap.fill(line, _HEADING_COLUMNS) for line in heading)
            figure.suptitle(text, fontsize=11, fontweight="bold", x=0.01, ha="left")
        if footer:
            text = textwrap.fill(footer, _FOOTER_COLUMNS)
            figure.supxlabel(text, fontsize=9, color="#555555", x=0.01, ha="left")
    return figure


def _draw(axes: Axes, panel: Panel) -> None:
    if panel.logarithmic:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_locator(NullLocator())
    for curve in panel.curves:
        _draw_curve(axes, curve)
    low, high = (limit if np.isfinite(limit) else None for limit in panel.limits)
    axes.set_ylim(low, high)
    axes.margins(x=0.0)
    axes.set_title(panel.title)
    axes.set_ylabel(panel.unit)
    handles = axes.get_legend_handles_labels()[0]
    if handles:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(handles))


def _draw_curve(axes: Axes, curve: Curve) -> None:
    named: dict[str, Any] = {"color": curve.color, "label": curve.label or None}
    if curve.floor is None:
        size = 4.0 if curve.style == "v" else 2.2
        axes.plot(curve.time_s, curve.values, curve.style, lw=curve.width, ms=size, **named)
    else:
        step: Any = "pre" if curve.steps else None
        named |= {"alpha": curve.opacity, "lw": 0.0, "step": step}
        axes.fill_between(curve.time_s, curve.floor, curve.values, **named)
