"""Panels of runs over time, as data; pictures and interactive pages are made of the same panels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from iptm_core.decision_record import DecisionSeries
from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.metrics.figures import PPM
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes.slope import SlopeProfile
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_core.units import CELSIUS_ZERO_K, KM_H_PER_M_S

# Colours of Okabe and Ito, distinguishable for colour-blind readers.
BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
PURPLE, SKY, GREY, BLACK = "#CC79A7", "#56B4E9", "#8a8a8a", "#000000"
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY)
# Spans below which a curve is drawn as flat.
_LEAST_TEMPERATURE_SPAN_K = 2.0
_LEAST_COOLING_KW = 0.5
_MARGIN = 1.1


Style = Literal["-", "--", ":", ".", "v"]
"""Line (solid, dashed, dotted) or marks (dots, events) of a curve, as matplotlib names them."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Values over time.

    Attributes:
        label: in the legend; empty for none.
        floor: lower end of an area of which the values are the upper end; None for a line or marks.
        opacity: of the area.
        steps: whether each value holds over the interval that ends at its row.
    """

    label: str
    time_s: FloatArray
    values: FloatArray
    color: str
    width: float = 1.3
    style: Style = "-"
    floor: FloatArray | None = None
    opacity: float = 0.1
    steps: bool = False


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves over a common axis.

    Attributes:
        height: relative to other panels.
        limits: of the values; NaN where the curves decide.
        logarithmic: of the values.
    """

    title: str
    unit: str
    curves: tuple[Curve, ...]
    height: float = 1.0
    limits: tuple[float, float] = (np.nan, np.nan)
    logarithmic: bool = False


class Shown(NamedTuple):
    """A run, and strategy and motion of the one whose curves are drawn behind it.

    Attributes:
        decisions: of the controller; without any, there is no panel for the solver.
        slope: of the road.
        against: None for none.
    """

    trajectory: Trajectory
    parameters: ModelParameters
    decisions: DecisionSeries
    slope: SlopeProfile
    against: tuple[str, Trajectory] | None

    def curve(self, label: str, values: FloatArray, color: str, width: float = 1.3) -> Curve:
        """Return a curve over the time of the run."""
        return Curve(label, self.trajectory.time_s, values, color, width)

    def area(self, label: str, values: FloatArray, color: str) -> Curve:
        """Return a curve that is filled down to zero."""
        return replace(self.curve(label, values, color), floor=np.zeros(len(values)), opacity=0.6)

    def level(self, value: float, label: str = "", color: str = BLACK) -> Curve:
        """Return a value over the whole trip."""
        ends_s = self.trajectory.time_s[[0, -1]]
        return Curve(label, ends_s, np.full(2, value), color, 0.7)

    def other(self, values: Callable[[Trajectory], FloatArray], what: str = "") -> Iterable[Curve]:
        """Yield the curve of the other run, if there is one."""
        if self.against is not None:
            name, run = self.against
            yield Curve(f"{name}, {what}" if what else name, run.time_s, values(run), ORANGE)


def run_panels(shown: Shown) -> list[Panel]:
    """Return the panels of a run, from top to bottom."""
    grades_percent = 100.0 * np.tan(shown.slope.slope_at(shown.trajectory.position_m))
    grade = Panel(
        "Road grade (positive: uphill)",
        "%",
        (
            shown.area("", grades_percent, GREY),
            shown.level(0.0),
        ),
        height=0.6,
    )
    return [
        _speed(shown),
        *([grade] if np.any(grades_percent) else []),
        _gap(shown),
        _driving_power(shown),
        _cooling_power(shown),
        _temperature(shown),
        _aging(shown),
        *([_solver(shown)] if len(shown.decisions) else []),
    ]


def overlay_panels(runs: Mapping[str, Trajectory]) -> list[Panel]:
    """Return the panels of several runs over each other, by the labels of the legend, in this order."""
    return [
        Panel(
            title,
            unit,
            tuple(
                Curve(label * (place == 0), run.time_s, values(run), COLOURS[number % len(COLOURS)])
                for number, (label, run) in enumerate(runs.items())
            ),
        )
        for place, (title, unit, values) in enumerate(_OVERLAID)
    ]


def _speed(shown: Shown) -> Panel:
    run = shown.trajectory
    curves = (
        shown.curve("leader", KM_H_PER_M_S * run.leader_speed_m_s, GREY),
        *shown.other(lambda other: KM_H_PER_M_S * other.speed_m_s),
        shown.curve("ego vehicle", KM_H_PER_M_S * run.speed_m_s, BLUE),
    )
    return Panel("Speed", "km/h", curves, 1.25, (0.0, np.nan))


def _gap(shown: Shown) -> Panel:
    run = shown.trajectory
    smallest = run.gap_m - gap_margins_m(run, shown.parameters)
    largest = shown.parameters.gap.max_gap_m
    floor = np.maximum(smallest, 0.0)
    top = 1.05 * max(largest, float(np.fmax.reduce(run.gap_m)), float(np.fmax.reduce(smallest)))
    allowed = shown.curve("", np.full(len(run), largest), GREEN)
    braked_s = run.time_s[run.service_braking_s > 0.0]
    curves = (
        replace(allowed, floor=floor),
        shown.curve("s_min (safety)", floor, RED, 0.9),
        replace(shown.level(largest, f"s_max = {largest:g} m", RED), style="--"),
        *shown.other(lambda other: other.gap_m),
        shown.curve("gap", run.gap_m, BLUE),
        *_events(braked_s, 0.97 * top, PURPLE, "safety monitor braked"),
    )
    return Panel("Gap to the leader", "m", curves, 1.25, (0.0, top))


def _driving_power(shown: Shown) -> Panel:
    run = shown.trajectory
    curves = (
        shown.curve("battery", 1e-3 * run.battery_power_w, SKY, 2.4),
        shown.curve("traction", 1e-3 * run.traction_power_w, BLUE, 0.9),
        shown.level(0.0),
    )
    return Panel("Driving power (positive: drawn from the pack)", "kW", curves)


def _cooling_power(shown: Shown) -> Panel:
    run = shown.trajectory
    compressor_kw, heat_kw = 1e-3 * run.compressor_power_w, 1e-3 * run.chiller_heat_w
    label = "compressor" if np.min(compressor_kw) >= 0.0 else "compressor; below zero: heater"
    highest = max(_LEAST_COOLING_KW, float(np.max(compressor_kw)), float(np.max(heat_kw)))
    lowest = min(0.0, float(np.min(compressor_kw)), float(np.min(heat_kw)))
    curves = (
        replace(shown.area(label, compressor_kw, ORANGE), steps=True),
        shown.curve("heat taken by the chiller", heat_kw, GREEN),
    )
    return Panel("Cooling power", "kW", curves, 1.0, (_MARGIN * lowest, _MARGIN * highest))


def _temperature(shown: Shown) -> Panel:
    run, limits = shown.trajectory, shown.parameters.limits
    drawn: tuple[tuple[FloatArray, str, Style, float, str], ...] = (
        (run.coolant_inlet_temperature_k, GREY, ":", 1.1, "coolant in"),
        (run.coolant_outlet_temperature_k, GREY, "--", 1.1, "coolant out"),
        (run.cell_n_temperature_k, RED, "-", 2.2, "cell N"),
        (run.cell_1_temperature_k, BLUE, "-", 1.2, "cell 1"),
    )
    curves = [*shown.other(mean_temperature_c, "mean of the cells")]
    for kelvin, color, style, width, label in drawn:
        curve = shown.curve(label, kelvin - CELSIUS_ZERO_K, color, width)
        curves.append(replace(curve, style=style))
    values = np.concatenate([curve.values for curve in curves])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    half_k = 0.5 * _MARGIN * max(high - low, _LEAST_TEMPERATURE_SPAN_K)
    least_c, most_c = (
        limit_k - CELSIUS_ZERO_K for limit_k in (limits.min_temperature_k, limits.max_temperature_k)
    )
    band = shown.level(most_c, f"cells and coolant out: {least_c:g} to {most_c:g} °C", GREEN)
    curves.append(replace(band, floor=np.full(2, least_c)))
    middle = 0.5 * (low + high)
    return Panel("Temperatures", "°C", tuple(curves), 1.2, (middle - half_k, middle + half_k))


def _aging(shown: Shown) -> Panel:
    run = shown.trajectory
    spread = run.cell_n_capacity_loss - run.cell_1_capacity_loss
    between = shown.curve("cell N − cell 1", PPM * (spread - spread[0]), PURPLE)
    curves = (
        *shown.other(aging_ppm, "both cells"),
        shown.curve("both cells", aging_ppm(run), BLUE, 2.0),
        replace(between, style="--"),
    )
    title = "Capacity lost by cycling since the start"
    return Panel(title, "ppm of nominal", curves, 1.0, (0.0, np.nan))


def _solver(shown: Shown) -> Panel:
    decisions = shown.decisions
    milliseconds = 1e3 * decisions.solve_time_s
    known = milliseconds[np.isfinite(milliseconds)]
    top = float(np.max(known, initial=1.0))
    curves = (
        Curve("time of a solve", decisions.time_s, milliseconds, BLUE, style="."),
        *_events(decisions.time_s[decisions.rung > 0], top, RED, "fallback"),
    )
    is_positive = bool(known.size) and bool(np.all(known > 0.0))
    return Panel("Solver", "ms", curves, 0.8, logarithmic=is_positive)


def _events(times_s: FloatArray, height: float, color: str, label: str) -> Iterable[Curve]:
    """Yield a curve that marks instants at the top of a panel; without any, the legend stays as it is."""
    if times_s.size:
        yield Curve(label, times_s, np.full(times_s.shape, height), color, style="v")


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
