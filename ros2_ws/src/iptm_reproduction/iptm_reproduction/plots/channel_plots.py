"""The temperatures of every cell of a coolant channel, and what they cost each cell."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import FloatArray
from iptm_reproduction.plots.style import (
    LINE,
    SERIES_COLOURS,
    STRATEGY_COLOURS,
    labelled,
    new_figure,
    plot,
)
from iptm_reproduction.runs import (
    DEFAULT_CONTROLLER,
    Results,
    channel_controllers,
    channel_run,
    controller_name,
)

_COLOURS = (STRATEGY_COLOURS["reference"], *SERIES_COLOURS[2:])


@plot(
    "Every cell of the channel",
    "Left: temperatures along the channel at some instants, under the aging strategy with cost to go; right: "
    "degradation of every cell over the trip. Dashed: the straight line through cells 1 and N.",
    needs=(channel_run("reference"), channel_run(DEFAULT_CONTROLLER)),
)
def full_channel(results: Results) -> Figure:
    """Draw temperatures along the channel at some instants, and the degradation of every cell."""
    figure, (left, right) = new_figure(3.6, 1, 2)
    record = results[channel_run(DEFAULT_CONTROLLER)].channel
    if record is not None:
        colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(record.profile_times_s)))
        for time_s, profile_k, colour in zip(
            record.profile_times_s, record.profiles_k, colours, strict=True
        ):
            profile_c = np.array(profile_k) - CELSIUS_ZERO_K
            _along_channel(left, profile_c, colour, f"{time_s:.0f} s")
    for controller, colour in zip(channel_controllers(results), _COLOURS, strict=False):
        found = results[channel_run(controller)].channel
        if found is not None:
            losses = 1e5 * np.array(found.capacity_losses)
            _along_channel(right, losses, colour, controller_name(controller))
    labelled(left, "cell, from the inlet", "temperature [°C]", "temperature")
    labelled(right, "cell, from the inlet", "capacity loss [10⁻⁵]", "degradation")
    for panel in (left, right):
        panel.legend(fontsize=7.5, frameon=False)
    return figure


def _along_channel(panel: Axes, values: FloatArray, colour: Any, name: str) -> None:
    """Draw a quantity of every cell, and the straight line between the first and the last."""
    numbers = np.arange(1, values.size + 1)
    panel.plot(numbers, values, color=colour, linewidth=LINE, label=name)
    ends = [0, -1]
    panel.plot(numbers[ends], values[ends], color=colour, linewidth=0.8, linestyle="--")
