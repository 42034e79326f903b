"""One run as a picture: panels over a common time axis."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

from iptm.picture import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    Picture,
    aging_ppm,
    drawn,
    mean_temperature_c,
    titled,
)
from iptm.report import outcome_lines
from iptm_core.decision_record import DecisionSeries
from iptm_core.metrics import compute_metrics, gap_margins_m
from iptm_core.metrics.figures import PPM
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes.slope import SlopeProfile
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_core.units import CELSIUS_ZERO_K, KM_H_PER_M_S

HEADING_COLUMNS = 130
FOOTER_COLUMNS = 170
# Spans below which a curve is drawn as flat.
_LEAST_TEMPERATURE_SPAN_K = 2.0
_LEAST_COOLING_KW = 0.5


class _Shown(NamedTuple):
    """A run, and strategy and motion of the one whose curves are drawn behind it."""

    trajectory: Trajectory
    parameters: ModelParameters
    decisions: DecisionSeries
    slope: SlopeProfile
    against: tuple[str, Trajectory] | None

    @property
    def grades_percent(self) -> FloatArray:
        """Road grade under the ego vehicle at every instant."""
        grades: FloatArray = 100.0 * np.tan(self.slope.slope_at(self.trajectory.position_m))
        return grades


_Draw = Callable[[Axes, _Shown], None]


def run_picture(
    trajectory: Trajectory,
    parameters: ModelParameters,
    decisions: DecisionSeries,
    slope: SlopeProfile | None,
    against: tuple[str, Trajectory] | None,
    headline: str,
    footer: str = "",
) -> Picture:
    """Draw a run.

    Args:
        trajectory: what happened.
        parameters: of the vehicle.
        decisions: of the controller; without any, there is no panel for the solver.
        slope: of the road, None where it is not known.
        against: strategy and trajectory of the run whose curves are drawn behind it, None for none.
        headline: lines above the panels.
        footer: what stands below the panels, before the limits that were broken.
    """
    metrics = compute_metrics(trajectory, parameters, decisions)
    outcome = "; ".join(filter(None, [footer, *outcome_lines(metrics)]))
    shown = _Shown(trajectory, parameters, decisions, slope or SlopeProfile.flat(), against)
    panels: dict[_Draw, float] = {
        _speed: 1.25,
        **({_grade: 0.6} if np.any(shown.grades_percent) else {}),
        _gap: 1.25,
        _driving_power: 1.0,
        _cooling_power: 1.0,
        _temperature: 1.2,
        _aging: 1.0,
        **({_solver: 0.8} if len(decisions) else {}),
    }
    return drawn(
        panels,
        lambda draw, axes: draw(axes, shown),
        headline,
        textwrap.fill(outcome, FOOTER_COLUMNS),
    )


def _speed(axes: Axes, shown: _Shown) -> None:
    run = shown.trajectory
    axes.plot(run.time_s, KM_H_PER_M_S * run.leader_speed_m_s, color=GREY, label="leader")
    _reference(axes, shown.against, lambda other: KM_H_PER_M_S * other.speed_m_s)
    axes.plot(run.time_s, KM_H_PER_M_S * run.speed_m_s, color=BLUE, label="ego vehicle")
    axes.set_ylim(bottom=0.0)
    titled(axes, "Speed", "km/h")


def _grade(axes: Axes, shown: _Shown) -> None:
    times_s = shown.trajectory.time_s
    axes.fill_between(times_s, shown.grades_percent, color=GREY, alpha=0.5, lw=0)
    axes.axhline(0.0, color="black", lw=0.6)
    titled(axes, "Road grade (positive: uphill)", "%")


def _gap(axes: Axes, shown: _Shown) -> None:
    run, parameters = shown.trajectory, shown.parameters
    smallest = run.gap_m - gap_margins_m(run, parameters)
    largest = parameters.gap.max_gap_m
    floor = np.maximum(smallest, 0.0)
    axes.fill_between(run.time_s, floor, largest, color=GREEN, alpha=0.10, lw=0)
    axes.plot(run.time_s, floor, color=RED, lw=0.9, label="s_min (safety)")
    axes.axhline(largest, color=RED, lw=0.9, ls="--", label=f"s_max = {largest:g} m")
    _reference(axes, shown.against, lambda other: other.gap_m)
    axes.plot(run.time_s, run.gap_m, color=BLUE, label="gap")
    braked = run.time_s[run.service_braking_s > 0.0]
    _marks(axes, braked, PURPLE, "safety monitor braked")
    top = 1.05 * max(largest, float(np.fmax.reduce(run.gap_m)), float(np.fmax.reduce(smallest)))
    axes.set_ylim(0.0, top)
    titled(axes, "Gap to the leader", "m")


def _driving_power(axes: Axes, shown: _Shown) -> None:
    run = shown.trajectory
    axes.plot(run.time_s, 1e-3 * run.battery_power_w, color=SKY, lw=2.4, label="battery")
    axes.plot(run.time_s, 1e-3 * run.traction_power_w, color=BLUE, lw=0.9, label="traction")
    axes.axhline(0.0, color="black", lw=0.6)
    titled(axes, "Driving power (positive: drawn from the pack)", "kW")


def _cooling_power(axes: Axes, shown: _Shown) -> None:
    run = shown.trajectory
    compressor_kw, heat_kw = 1e-3 * run.compressor_power_w, 1e-3 * run.chiller_heat_w
    label = "compressor" if np.min(compressor_kw) >= 0.0 else "compressor; below zero: heater"
    axes.fill_between(
        run.time_s, compressor_kw, color=ORANGE, alpha=0.6, lw=0, step="pre", label=label
    )
    axes.plot(run.time_s, heat_kw, color=GREEN, label="heat taken by the chiller")
    highest = max(_LEAST_COOLING_KW, float(np.max(compressor_kw)), float(np.max(heat_kw)))
    lowest = min(float(np.min(compressor_kw)), float(np.min(heat_kw)))
    axes.set_ylim(min(0.0, 1.1 * lowest), 1.1 * highest)
    titled(axes, "Cooling power", "kW")


def _temperature(axes: Axes, shown: _Shown) -> None:
    run, limits = shown.trajectory, shown.parameters.limits
    _reference(axes, shown.against, mean_temperature_c, "mean of the cells")
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
    titled(axes, "Temperatures", "°C")


def _aging(axes: Axes, shown: _Shown) -> None:
    run = shown.trajectory
    _reference(axes, shown.against, aging_ppm, "both cells")
    axes.plot(run.time_s, aging_ppm(run), color=BLUE, lw=2.0, label="both cells")
    spread = run.cell_n_capacity_loss - run.cell_1_capacity_loss
    axes.plot(
        run.time_s, PPM * (spread - spread[0]), color=PURPLE, ls="--", label="cell N − cell 1"
    )
    axes.set_ylim(bottom=0.0)
    titled(axes, "Capacity lost by cycling since the start", "ppm of nominal")


def _reference(
    axes: Axes,
    against: tuple[str, Trajectory] | None,
    values: Callable[[Trajectory], FloatArray],
    what: str = "",
) -> None:
    """Draw a curve of the run behind the shown one, if there is one."""
    if against is not None:
        name, other = against
        label = f"{name}, {what}" if what else name
        axes.plot(other.time_s, values(other), color=ORANGE, lw=1.3, label=label)


def _solver(axes: Axes, shown: _Shown) -> None:
    decisions = shown.decisions
    milliseconds = 1e3 * decisions.solve_time_s
    rung = decisions.rung
    axes.plot(decisions.time_s, milliseconds, ".", ms=2.2, color=BLUE, label="time of a solve")
    if _has_positive(milliseconds):
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_locator(NullLocator())
    _marks(axes, decisions.time_s[rung > 0.0], RED, "fallback")
    titled(axes, "Solver", "ms")


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
