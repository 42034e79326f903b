"""The temperatures of every cell of a coolant channel, and what they cost each cell."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from iptm_core.parameters.units import CELSIUS_ZERO_K
from iptm_reproduction.plots.style import LINE, STRATEGY_COLOURS, labelled, new_figure, plot
from iptm_reproduction.runs import Results, channel_controllers, channel_run, controller_name

_PROPOSED = channel_run("multi_horizon")


@plot(
    "Every cell of the channel",
    "Left: temperatures along the channel under the multi-horizon controller at some instants; right: "
    "degradation of every cell over the trip. Dashed: the straight line through cells 1 and N.",
    needs=(channel_run("reference"), _PROPOSED),
)
def full_channel(results: Results) -> Figure:
    """Draw temperatures along the channel at some instants, and the degradation of every cell."""
    figure, (left, right) = new_figure(3.6, 1, 2)
    record = results[_PROPOSED].channel
    if record is not None:
        shades = np.linspace(0.15, 0.85, len(record.profile_times_s))
        for time_s, profile, shade in zip(
            record.profile_times_s, record.profiles_k, shades, strict=True
        ):
            colour = (0.1 + 0.8 * shade, 0.25, 0.9 - 0.75 * shade)
            numbers = np.arange(1, len(profile) + 1)
            left.plot(
                numbers,
                np.array(profile) - CELSIUS_ZERO_K,
                color=colour,
                linewidth=LINE,
                label=f"{time_s:.0f} s",
            )
            ends = np.array([profile[0], profile[-1]]) - CELSIUS_ZERO_K
            left.plot(numbers[[0, -1]], ends, color=colour, linewidth=0.8, linestyle="--")
    for controller in channel_controllers(results):
        found = results[channel_run(controller)].channel
        if found is None:
            continue
        losses = 1e5 * np.array(found.capacity_losses)
        numbers = np.arange(1, losses.size + 1)
        colour = STRATEGY_COLOURS["reference" if controller == "reference" else "aging"]
        right.plot(numbers, losses, color=colour, linewidth=LINE, label=controller_name(controller))
        right.plot(numbers[[0, -1]], losses[[0, -1]], color=colour, linewidth=0.8, linestyle="--")
    labelled(left, "cell, from the inlet", "temperature [°C]", "temperature")
    labelled(right, "cell, from the inlet", "capacity loss [10⁻⁵]", "degradation")
    for panel in (left, right):
        panel.legend(fontsize=7.5, frameon=False)
    return figure
