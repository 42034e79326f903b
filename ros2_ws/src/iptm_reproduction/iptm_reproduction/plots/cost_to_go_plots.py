"""Marginal cost of temperature along the trip: the controller's against the costates of the whole trip."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from iptm_reproduction.plots.comparison_plots import CONTROLLER_COLOURS
from iptm_reproduction.plots.style import (
    LINE,
    OPTIMUM_COLOUR,
    labelled,
    legend_below,
    new_figure,
    plot,
)
from iptm_reproduction.runs import (
    COST_TO_GO_OPTIMUM,
    DEFAULT_CONTROLLER,
    Results,
    controller_name,
    cost_to_go_run,
)


@plot(
    "The price of a kelvin",
    "What a kelvin more costs, in the unit of the cost: the price that the controller puts on the end of its "
    "horizon at every tick, and the costates of the temperatures in the whole trip solved as one problem. "
    "These jump where cell 1 leaves its lower temperature limit, until when a kelvin more in it was welcome.",
    needs=(cost_to_go_run(DEFAULT_CONTROLLER), COST_TO_GO_OPTIMUM),
)
def temperature_price(results: Results) -> Figure:
    """Draw the price of both cell temperatures and the costates of the whole trip, over the trip."""
    figure, panels = new_figure(5.2, 3, 1, sharex=True)
    decisions = results[cost_to_go_run(DEFAULT_CONTROLLER)].decisions
    if decisions is not None:
        prices = (decisions.cell_1_marginal_cost_1_k, decisions.cell_n_marginal_cost_1_k)
        for panel, values in zip(panels, (prices[0] + prices[1], *prices), strict=True):
            panel.plot(
                decisions.time_s,
                values,
                color=CONTROLLER_COLOURS[DEFAULT_CONTROLLER],
                linewidth=LINE,
                label=f"price, {controller_name(DEFAULT_CONTROLLER)}",
            )
    record = results[COST_TO_GO_OPTIMUM].whole_trip
    if record is not None:
        found = record.costates
        costates = (np.array(found.cell_1_1_k), np.array(found.cell_n_1_k))
        for panel, values in zip(panels, (costates[0] + costates[1], *costates), strict=True):
            panel.plot(
                found.times_s,
                values,
                color=OPTIMUM_COLOUR,
                linewidth=0.8,
                label="costate, whole-trip optimum",
            )
    for panel, title in zip(panels, ("both cells", "cell 1", "cell N"), strict=True):
        labelled(panel, "", "cost [1/K]", title)
        panel.axhline(0.0, color="black", linewidth=0.7)
    labelled(panels[-1], "time [s]", "cost [1/K]")
    legend_below(figure, panels[0], 2)
    return figure
