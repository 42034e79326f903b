"""A string of vehicles as one picture: speeds, gaps, and margins to the lower limit of the gap."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib import colormaps, rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from iptm.picture import GREY, STYLE
from iptm_core.metrics import gap_margins_m
from iptm_core.parameters.model import KM_H_PER_M_S, ModelParameters
from iptm_core.trajectory import Trajectory

_SIZE_INCHES = (12.0, 8.0)
_DOTS_PER_INCH = 100


def save_string_picture(
    path: Path, trajectories: Sequence[Trajectory], parameters: ModelParameters
) -> None:
    """Draw a string.

    Args:
        path: PNG file to write.
        trajectories: of the vehicles, the first one first.
        parameters: of every vehicle.
    """
    with rc_context(STYLE):
        layout = ConstrainedLayoutEngine(h_pad=0.06, hspace=0.03)
        figure = Figure(figsize=_SIZE_INCHES, dpi=_DOTS_PER_INCH, layout=layout)
        FigureCanvasAgg(figure)
        speed, gap, margin = figure.subplots(3, 1, sharex=True)
        first = trajectories[0]
        speed.plot(
            first.time_s, KM_H_PER_M_S * first.leader_speed_m_s, color=GREY, label="driving cycle"
        )
        colours = colormaps["viridis"]
        for place, run in enumerate(trajectories):
            colour = colours(place / len(trajectories))
            name = f"car_{place + 1}"
            speed.plot(run.time_s, KM_H_PER_M_S * run.speed_m_s, color=colour, label=name)
            gap.plot(run.time_s, run.gap_m, color=colour)
            margin.plot(run.time_s, gap_margins_m(run, parameters), color=colour)
        margin.axhline(0.0, color=GREY, linestyle="--")
        for axes, title, unit in (
            (speed, "speed", "km/h"),
            (gap, "gap to the vehicle ahead", "m"),
            (margin, "gap above its lower limit", "m"),
        ):
            axes.set_title(title)
            axes.set_ylabel(unit)
            axes.margins(x=0.0)
        speed.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(trajectories) + 1)
        margin.set_xlabel("time (s)")
        figure.savefig(path, metadata={"Software": "iptm"}, pil_kwargs={"compress_level": 9})
