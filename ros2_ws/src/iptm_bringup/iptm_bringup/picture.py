"""The run as one picture: panels over a common time axis."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

from iptm_bringup.evaluation import RunResults
from iptm_bringup.summary import AGING_SAVED, PPM
from iptm_core.metrics import gap_margins_m
from iptm_core.parameters.units import CELSIUS_ZERO_K, KM_H_PER_M_S
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory

# Colours of Okabe and Ito, which colour-blind readers can tell apart.
BLUE, ORANGE, GREEN, RED, PURPLE, SKY = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
)
GREY = "#8a8a8a"
_WIDTH_INCHES = 12.0
_INCHES_PER_HEIGHT = 1.72
_HEADING_INCHES = 1.2
_DOTS_PER_INCH = 100
_HEADING_COLUMNS = 130
# Below these spans a curve is flat for the eye, whatever its digits say.
_LEAST_TEMPERATURE_SPAN_K = 2.0
_LEAST_COOLING_KW = 0.5
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


_Draw = Callable[[Axes, RunResults], None]


def save_picture(path: Path, results: RunResults) -> None:
    """Draw a run.

    Args:
        path: PNG file to write.
        results: of the run.
    """
    panels = _panels(results)
    heights = [height for _, height in panels]
    size = (_WIDTH_INCHES, _HEADING_INCHES + _INCHES_PER_HEIGHT * sum(heights))
    with rc_context(STYLE):
        layout = ConstrainedLayoutEngine(h_pad=0.06, hspace=0.03)
        figure = Figure(figsize=size, dpi=_DOTS_PER_INCH, layout=layout)
        FigureCanvasAgg(figure)
        all_axes = figure.subplots(len(panels), 1, sharex=True, height_ratios=heights)
        for axes, (draw, _) in zip(all_axes, panels, strict=True):
            draw(axes, results)
            axes.margins(x=0.0)
        all_axes[-1].set_xlabel("time (s)")
        figure.align_ylabels(all_axes)
        figure.suptitle(_headline(results), fontsize=11, fontweight="bold", x=0.01, ha="left")
        figure.supxlabel(_footer(results), fontsize=9, color="#555555", x=0.01, ha="left")
        figure.savefig(path, metadata={"Software": "iptm"}, pil_kwargs={"compress_level": 9})


def _panels(results: RunResults) -> list[tuple[_Draw, float]]:
    """Return what to draw, from top to bottom, with relative heights."""
    hills: list[tuple[_Draw, float]] = [(_grade, 0.6)] if np.any(_grades_percent(results)) else []
    return [
        (_speed, 1.25),
        *hills,
        (_gap, 1.25),
        (_driving_power, 1.0),
        (_cooling_power, 1.0),
        (_temperature, 1.2),
        (_aging, 1.0),
        (_solver, 0.8),
    ]


def _headline(results: RunResults) -> str:
    lines = dict(results.summary.lines)
    shown = [f"{label}: {lines[label]}" for label in (AGING_SAVED, "energy") if label in lines]
    heading = textwrap.wrap(results.prepared.heading, _HEADING_COLUMNS)
    return "\n".join([*heading, *shown])


def _footer(results: RunResults) -> str:
    parts = [f"model {results.prepared.model.name}"]
    if math.isfinite(results.speed_up):
        mode = results.prepared.scenario.mode.replace("_", "-")
        parts.append(f"{mode} over ROS 2, {results.speed_up:.0f} × real time")
    hard, soft = results.metrics.hard_violations, results.metrics.soft_violations
    parts.append(f"limits broken: hard {hard}, soft {soft} rows")
    return "; ".join(parts)


def _titled(axes: Axes, title: str, unit: str, *more: Axes) -> None:
    """Put title and legend above a panel, the legend with the lines of all its axes."""
    axes.set_title(title)
    axes.set_ylabel(unit)
    handles = [line for each in (axes, *more) for line in each.get_legend_handles_labels()[0]]
    axes.legend(handles=handles, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(handles))


def _speed(axes: Axes, results: RunResults) -> None:
    run = results.trajectory
    axes.plot(run.time_s, KM_H_PER_M_S * run.leader_speed_m_s, color=GREY, label="leader")
    _reference(axes, results, lambda other: KM_H_PER_M_S * other.speed_m_s)
    axes.plot(run.time_s, KM_H_PER_M_S * run.speed_m_s, color=BLUE, label="host")
    axes.set_ylim(bottom=0.0)
    _titled(axes, "Speed", "km/h")


def _grades_percent(results: RunResults) -> FloatArray:
    """Return the road grade under the host at every instant."""
    slopes_rad = results.prepared.route.slope.slope_at(results.trajectory.position_m)
    grades: FloatArray = 100.0 * np.tan(np.asarray(slopes_rad))
    return grades


def _grade(axes: Axes, results: RunResults) -> None:
    axes.fill_between(
        results.trajectory.time_s, _grades_percent(results), color=GREY, alpha=0.5, lw=0
    )
    axes.axhline(0.0, color="black", lw=0.6)
    _titled(axes, "Road grade (positive: uphill)", "%")


def _gap(axes: Axes, results: RunResults) -> None:
    run, parameters = results.trajectory, results.prepared.model.values
    smallest = run.gap_m - gap_margins_m(run, parameters)
    largest = parameters.gap.max_gap_m
    floor = np.maximum(smallest, 0.0)
    axes.fill_between(run.time_s, floor, largest, color=GREEN, alpha=0.10, lw=0)
    axes.plot(run.time_s, floor, color=RED, lw=0.9, label="s_min (safety)")
    axes.axhline(largest, color=RED, lw=0.9, ls="--", label=f"s_max = {largest:g} m")
    _reference(axes, results, lambda other: other.gap_m)
    axes.plot(run.time_s, run.gap_m, color=BLUE, label="gap")
    braked = run.time_s[run.service_braking_s > 0.0]
    _marks(axes, braked, PURPLE, "safety monitor braked")
    top = 1.05 * max(largest, float(np.fmax.reduce(run.gap_m)), float(np.fmax.reduce(smallest)))
    axes.set_ylim(0.0, top)
    _titled(axes, "Gap to the leader", "m")


def _driving_power(axes: Axes, results: RunResults) -> None:
    run = results.trajectory
    axes.plot(run.time_s, 1e-3 * run.battery_power_w, color=SKY, lw=2.4, label="battery")
    axes.plot(run.time_s, 1e-3 * run.traction_power_w, color=BLUE, lw=0.9, label="traction")
    axes.axhline(0.0, color="black", lw=0.6)
    _titled(axes, "Driving power (positive: drawn from the pack)", "kW")


def _cooling_power(axes: Axes, results: RunResults) -> None:
    run = results.trajectory
    compressor_kw, heat_kw = 1e-3 * run.compressor_power_w, 1e-3 * run.chiller_heat_w
    axes.fill_between(
        run.time_s, compressor_kw, color=ORANGE, alpha=0.6, lw=0, step="pre", label="compressor"
    )
    axes.plot(run.time_s, heat_kw, color=GREEN, label="heat taken by the chiller")
    highest = max(_LEAST_COOLING_KW, float(np.max(compressor_kw)), float(np.max(heat_kw)))
    axes.set_ylim(min(0.0, 1.1 * float(np.min(heat_kw))), 1.1 * highest)
    _titled(axes, "Cooling power", "kW")


def _temperature(axes: Axes, results: RunResults) -> None:
    run, limits = results.trajectory, results.prepared.model.values.limits
    _reference(axes, results, _mean_temperature_c, "mean of the cells")
    for values, color, style, width, label in (
        (run.coolant_inlet_temperature_k, GREY, ":", 1.1, "coolant in"),
        (run.coolant_outlet_temperature_k, GREY, "--", 1.1, "coolant out"),
        (run.cell_n_temperature_k, RED, "-", 2.2, "cell N"),
        (run.cell_1_temperature_k, BLUE, "-", 1.2, "cell 1"),
    ):
        values_c = values - CELSIUS_ZERO_K
        axes.plot(run.time_s, values_c, color=color, ls=style, lw=width, label=label)
    low, high = axes.get_ylim()
    lacking = max(0.0, _LEAST_TEMPERATURE_SPAN_K - (high - low))
    axes.set_ylim(low - 0.5 * lacking, high + 0.5 * lacking)
    least_c, most_c = (
        limit_k - CELSIUS_ZERO_K for limit_k in (limits.min_temperature_k, limits.max_temperature_k)
    )
    band = f"cells and coolant out: {least_c:g} to {most_c:g} °C"
    axes.axhspan(least_c, most_c, color=GREEN, alpha=0.10, lw=0, label=band)
    _titled(axes, "Temperatures", "°C")


def _mean_temperature_c(run: Trajectory) -> FloatArray:
    mean: FloatArray = 0.5 * (run.cell_1_temperature_k + run.cell_n_temperature_k) - CELSIUS_ZERO_K
    return mean


def _aging(axes: Axes, results: RunResults) -> None:
    run = results.trajectory
    _reference(axes, results, _aging_ppm, "both cells")
    axes.plot(run.time_s, _aging_ppm(run), color=BLUE, lw=2.0, label="both cells")
    spread = run.cell_n_capacity_loss - run.cell_1_capacity_loss
    axes.plot(
        run.time_s, PPM * (spread - spread[0]), color=PURPLE, ls="--", label="cell N − cell 1"
    )
    axes.set_ylim(bottom=0.0)
    _titled(axes, "Capacity lost since the start", "ppm of nominal")


def _aging_ppm(run: Trajectory) -> FloatArray:
    loss = run.cell_1_capacity_loss + run.cell_n_capacity_loss
    ppm: FloatArray = PPM * (loss - loss[0])
    return ppm


def _reference(
    axes: Axes, results: RunResults, values: Callable[[Trajectory], FloatArray], what: str = ""
) -> None:
    """Draw a curve of the run that this one is compared with, if there is one."""
    comparison = results.comparison
    if comparison is None:
        return
    label = f"{comparison.strategy}, {what}" if what else comparison.strategy
    other = comparison.trajectory
    axes.plot(other.time_s, values(other), color=ORANGE, lw=1.3, label=label)


def _solver(axes: Axes, results: RunResults) -> None:
    decisions = results.decisions
    milliseconds = 1e3 * decisions.solve_time_s
    rung = decisions.rung
    axes.plot(decisions.time_s, milliseconds, ".", ms=2.2, color=BLUE, label="time of a solve")
    if _has_positive(milliseconds):
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_locator(NullLocator())
    _marks(axes, decisions.time_s[rung > 0.0], RED, "fallback")
    _titled(axes, "Solver", "ms")


def _marks(axes: Axes, times_s: FloatArray, color: str, label: str) -> None:
    """Mark instants at the top of a panel; without any, the legend stays as it is."""
    if times_s.size:
        axes.plot(
            times_s, np.full(times_s.shape, 0.97), "v", ms=4, color=color,
            transform=axes.get_xaxis_transform(), label=label,
        )  # fmt: skip


def _has_positive(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return bool(known.size) and bool(np.all(known > 0.0))
