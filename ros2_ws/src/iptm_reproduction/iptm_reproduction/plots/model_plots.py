"""Figures that need no controller: the aging map and the driving cycle."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import KM_H_PER_M_S
from iptm_core.routes.route import Route
from iptm_core.state import FloatArray
from iptm_reproduction import aging as model
from iptm_reproduction.plots.style import labelled, new_figure, plot, tidy
from iptm_reproduction.runs import REFERENCE, Results

_SLOPE_SHADES = {"large": "#f6d5c5", "small": "#dcebd7"}


@plot(
    "Influence of current and temperature on degradation",
    "Capacity loss of a cell in one hour at constant current and temperature, at the initial loss of the "
    "parameters: over the permitted temperatures, and as sections.",
)
def aging_map(_: Results) -> Figure:
    """Draw capacity loss per hour over current and temperature, as a map and as lines."""
    found = model.aging_map(load_parameters().values)
    loss = 1e5 * found.loss_per_hour
    figure, (left, right) = new_figure(3.3, 1, 2)
    filled = left.contourf(found.currents_a, found.temperatures_c, loss, levels=14, cmap="viridis")
    bar = figure.colorbar(filled, ax=left)
    bar.ax.tick_params(labelsize=8)
    labelled(left, "cell current [A]", "cell temperature [°C]", "capacity loss per hour [10⁻⁵]")
    left.grid(visible=False)
    for share, colour in zip((0.0, 0.5, 1.0), ("#2171b5", "#41ab5d", "#a50f15"), strict=True):
        row = round(share * (found.temperatures_c.size - 1))
        right.plot(
            found.currents_a, loss[row], color=colour, label=f"{found.temperatures_c[row]:.1f} °C"
        )
    for rate in (1.0, 2.0):
        right.axvline(
            rate * found.nominal_capacity_ah, color="#999999", linewidth=0.8, linestyle=":"
        )
        right.annotate(
            f"{rate:g}C",
            (rate * found.nominal_capacity_ah, 0.97),
            xycoords=("data", "axes fraction"),
            fontsize=8,
            ha="right",
            va="top",
        )
    labelled(right, "cell current [A]", "", "at three temperatures [10⁻⁵ per hour]")
    right.legend(fontsize=8, frameon=False)
    return figure


@plot(
    "Driving cycle with slopes",
    "Speed of the leader and slope of the road where it drives. Shaded: stretches with large (L) and "
    "small (S) slope.",
    needs=(REFERENCE,),
)
def driving_cycle(results: Results) -> Figure:
    """Draw speed of the leader and the slope where it drives, over time."""
    route = results[REFERENCE].route
    step_s = max(1.0, round(route.duration_s / 5000.0))
    times = np.arange(0.0, route.duration_s + 0.5, step_s, dtype=np.float64)
    figure, (top, bottom) = new_figure(3.6, 2, 1, sharex=True, height_ratios=[2, 1])
    top.plot(times, KM_H_PER_M_S * route.leader.speeds_at(times), color="#333333", linewidth=0.7)
    labelled(top, "", "speed [km/h]")
    bottom.plot(times, _grades_percent(route, times), color="#8c4a2f", linewidth=0.9)
    labelled(bottom, "time [s]", "slope [%]")
    for segment in route.segments:
        if segment.start_s >= route.duration_s:
            continue
        end = min(segment.end_s, route.duration_s)
        for panel in (top, bottom):
            tidy(panel)
            panel.axvspan(
                segment.start_s,
                end,
                color=_SLOPE_SHADES.get(segment.slope_kind, "#eeeeee"),
                linewidth=0.0,
                zorder=0,
            )
        kind = segment.slope_kind[0].upper() if segment.slope_kind in _SLOPE_SHADES else ""
        top.annotate(
            f"{_short(segment.cycle)}\n{kind}".strip(),
            (0.5 * (segment.start_s + end), 1.01),
            xycoords=("data", "axes fraction"),
            fontsize=7,
            ha="center",
            va="bottom",
        )
    top.set_xlim(0.0, route.duration_s)
    return figure


def _grades_percent(route: Route, times: FloatArray) -> FloatArray:
    driven = route.leader.positions_at(times) - route.leader.start_position_m
    grades: FloatArray = 100.0 * np.tan(route.slope.slope_at(driven))
    return grades


def _short(cycle: str) -> str:
    return {"wltc_class3b": "WLTC"}.get(cycle, cycle.upper() if len(cycle) <= 5 else cycle)
