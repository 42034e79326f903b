"""Pictures of runs: their style, and the curves of several runs over each other."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from iptm_core.metrics.figures import PPM
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_core.units import CELSIUS_ZERO_K, KM_H_PER_M_S

# Colours of Okabe and Ito, distinguishable for colour-blind readers.
BLUE, ORANGE, GREEN, RED, PURPLE, SKY = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
)
GREY = "#8a8a8a"
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY)
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

    def png(self) -> bytes:
        """Return the content of a PNG file."""
        file = io.BytesIO()
        self.savefig(file)
        return file.getvalue()

    _repr_png_ = png

    def savefig(self, *args: Any, **options: Any) -> None:
        """Write the figure to a file; the options are passed to matplotlib."""
        with rc_context(STYLE):
            super().savefig(*args, **options)


def overlay_picture(runs: Mapping[str, Trajectory], headline: str = "") -> Picture:
    """Draw several runs over each other, by the labels of the legend, in the order of drawing."""

    def draw(panel: tuple[str, str, Callable[[Trajectory], FloatArray]], axes: Axes) -> None:
        title, unit, values = panel
        for number, (label, run) in enumerate(runs.items()):
            axes.plot(run.time_s, values(run), color=COLOURS[number % len(COLOURS)], label=label)
        titled(axes, title, unit)
        legend = axes.get_legend()
        if legend is not None and panel is not _OVERLAID[0]:
            legend.remove()

    return drawn(dict.fromkeys(_OVERLAID, 1.0), draw, headline, "")


_Panel = TypeVar("_Panel")


def drawn(
    panels: Mapping[_Panel, float],
    draw: Callable[[_Panel, Axes], None],
    headline: str,
    footer: str,
) -> Picture:
    """Return a picture of panels, from top to bottom, with relative heights."""
    heights = list(panels.values())
    size = (_WIDTH_INCHES, _HEADING_INCHES + _INCHES_PER_HEIGHT * sum(heights))
    with rc_context(STYLE):
        layout = ConstrainedLayoutEngine(h_pad=0.06, hspace=0.03)
        figure = Picture(figsize=size, dpi=_DOTS_PER_INCH, layout=layout)
        FigureCanvasAgg(figure)
        all_axes = figure.subplots(len(panels), 1, sharex=True, height_ratios=heights)
        for axes, panel in zip(all_axes, panels, strict=True):
            draw(panel, axes)
            axes.margins(x=0.0)
        all_axes[-1].set_xlabel("time (s)")
        figure.align_ylabels(all_axes)
        if headline:
            figure.suptitle(headline, fontsize=11, fontweight="bold", x=0.01, ha="left")
        if footer:
            figure.supxlabel(footer, fontsize=9, color="#555555", x=0.01, ha="left")
    return figure


def titled(axes: Axes, title: str, unit: str, *more: Axes) -> None:
    """Put title and legend above a panel, the legend with the lines of all its axes."""
    axes.set_title(title)
    axes.set_ylabel(unit)
    handles = [line for each in (axes, *more) for line in each.get_legend_handles_labels()[0]]
    axes.legend(handles=handles, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(handles))


def mean_temperature_c(run: Trajectory) -> FloatArray:
    """Return the mean temperature of both cells in degrees Celsius, shape (n,)."""
    mean: FloatArray = 0.5 * (run.cell_1_temperature_k + run.cell_n_temperature_k) - CELSIUS_ZERO_K
    return mean


def aging_ppm(run: Trajectory) -> FloatArray:
    """Return the capacity that both cells lost since the first row in ppm of nominal, shape (n,)."""
    loss = run.cell_1_capacity_loss + run.cell_n_capacity_loss
    ppm: FloatArray = PPM * (loss - loss[0])
    return ppm


_OVERLAID: tuple[tuple[str, str, Callable[[Trajectory], FloatArray]], ...] = (
    ("Speed", "km/h", lambda run: KM_H_PER_M_S * run.speed_m_s),
    ("Gap to the leader", "m", lambda run: run.gap_m),
    ("Battery power (positive: drawn from the pack)", "kW", lambda run: 1e-3 * run.battery_power_w),
    ("Compressor power", "kW", lambda run: 1e-3 * run.compressor_power_w),
    ("Mean temperature of the cells", "°C", mean_temperature_c),
    ("Capacity lost since the start, both cells", "ppm of nominal", aging_ppm),
)
"""Panels of several runs: title, unit and values."""
