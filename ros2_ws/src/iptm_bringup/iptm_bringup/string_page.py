"""The page of a string: how disturbances travel along it, what each vehicle saves, how fast it was driven."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from iptm_bringup.comparison import NO_COMPARISON, relative_changes
from iptm_bringup.scenario import PreparedScenario
from iptm_bringup.string_picture import save_string_picture
from iptm_core.decision_record import DecisionSeries, Rung
from iptm_core.markdown import markdown_table
from iptm_core.metrics import compute_metrics
from iptm_core.metrics.figures import NO_VALUE
from iptm_core.trajectory import Trajectory
from iptm_studies.closed_loop import ClosedLoopRun
from iptm_studies.string_figures import Deviations, deviations_along

Rows = Sequence[Sequence[str]]

NOTICE = "<!-- Made by scripts/run_string --page; do not edit. -->"
INTRODUCTION = """\
`car_1` follows the driving cycle, every other vehicle follows the one before: it measures how far away and
how fast that is, and takes its published plan for the preview of its motion. Each vehicle has nodes, clock,
frames and a bag of its own (`scripts/run_string`, or `string.launch.py`).

**Timing of information.** The tick of a vehicle at *t* uses the state of the vehicle ahead at *t* and
the plan that it made at *t*, matched by stamp: what arrives first plays no part, and repeats are bit-
identical. So a tick passes along the string from front to rear, while the front is at the next tick
already; a vehicle is never more than one tick ahead of the one behind. That stands for a radio that is fast
against a tick; `--latency-s 1` is the plan of the tick before. A plan ends where its horizon does, and
beyond that the controller keeps its braking reserve, as behind any preview that ends.
"""


@dataclass(frozen=True, eq=False)
class StringRun:
    """A string that has been driven, and what it is compared with.

    Attributes:
        prepared: what every vehicle drove.
        trajectories: of the vehicles, the first one first.
        decisions: of the vehicles, in the same order.
        wall_time_s: from the first to the last clock of the vehicle that took longest.
        cores: processors that it had.
        against: strategy of the string that it is compared with, "none" without one.
        others: trips of that string.
        late: trips of the same string without ROS, by how late the plans arrive in s.
    """

    prepared: PreparedScenario
    trajectories: tuple[Trajectory, ...]
    decisions: tuple[DecisionSeries, ...]
    wall_time_s: float
    cores: int
    against: str = NO_COMPARISON
    others: tuple[ClosedLoopRun, ...] = ()
    late: Mapping[float, tuple[ClosedLoopRun, ...]] = field(default_factory=dict)

    @property
    def speed_up(self) -> float:
        """Trip time per wall time, all vehicles at once."""
        return self.prepared.route.duration_s / self.wall_time_s

    @cached_property
    def deviations(self) -> tuple[Deviations, ...]:
        """Of the driving cycle and of every vehicle."""
        return deviations_along(self.trajectories, self.prepared.model.values)

    def deviations_of(self, runs: Sequence[ClosedLoopRun]) -> tuple[Deviations, ...]:
        """Return the deviations along another string of the same vehicles."""
        return deviations_along([run.trajectory for run in runs], self.prepared.model.values)

    def changes(self, place: int) -> dict[str, float]:
        """Return the relative change of every figure of a vehicle against the other string's in its place."""
        parameters = self.prepared.model.values
        other, here = self.others[place], self.trajectories[place]
        metrics = compute_metrics(other.trajectory, parameters, other.decisions)
        own = compute_metrics(here, parameters, self.decisions[place])
        return relative_changes(own, metrics)


_NO_RATIOS = Deviations(*[math.nan] * 3)


def _fallbacks(decisions: DecisionSeries) -> int:
    return int(np.count_nonzero(decisions.rung != Rung.OPTIMAL))


DEVIATION_COLUMNS = (
    "", "speed, std (m/s)", "acceleration, rms (m/s²)", "acceleration, peak (m/s²)", "gap, std (m)",
    "least gap − s_min (m)", "largest gap (m)", "fallbacks",
)  # fmt: skip


def deviation_rows(run: StringRun) -> Rows:
    """Return the cells of the table of deviations, with the ratio to the member ahead in brackets."""
    rows = []
    for place, own in enumerate(run.deviations):
        name = f"car_{place}" if place else "driving cycle"
        ratios = own.amplification(run.deviations[place - 1]) if place else _NO_RATIOS
        cells = [
            name,
            _with_ratio(own.speed_m_s, ratios.speed_m_s),
            _with_ratio(own.acceleration_m_s2, ratios.acceleration_m_s2, 3),
            _with_ratio(own.peak_acceleration_m_s2, ratios.peak_acceleration_m_s2),
            _with_ratio(own.gap_m, ratios.gap_m),
        ]
        cells += [_number(own.smallest_margin_m), _number(own.largest_gap_m, 1)]
        cells.append(str(_fallbacks(run.decisions[place - 1])) if place else NO_VALUE)
        rows.append(cells)
    return rows


SAVING_COLUMNS = (
    "", "aging saved while driving", "cooling energy", "traction energy", "acceleration, rms (m/s²)",
    "of the other string (m/s²)",
)  # fmt: skip


def saving_rows(run: StringRun) -> Rows:
    """Return the cells of the table of what each vehicle saves; none without a comparison."""
    if not run.others:
        return ()
    others = run.deviations_of(run.others)
    rows = []
    for place in range(len(run.trajectories)):
        changes = run.changes(place)
        rows.append(
            [
                f"car_{place + 1}",
                f"{-100.0 * changes['total_degradation']:.1f} %",
                *(
                    f"{100.0 * changes[key]:+.1f} %"
                    for key in ("cooling_energy", "traction_energy")
                ),
                _number(run.deviations[place + 1].acceleration_m_s2, 3),
                _number(others[place + 1].acceleration_m_s2, 3),
            ]
        )
    return rows


LATE_COLUMNS = (
    "plans arrive after", "acceleration of the last car, rms (m/s²)", "least gap − s_min (m)",
    "largest gap (m)", "fallbacks",
)  # fmt: skip


def late_rows(run: StringRun) -> Rows:
    """Return the cells of the table of late plans; the worst of all vehicles unless stated otherwise."""
    rows = []
    for late_s, runs in run.late.items():
        own = run.deviations_of(runs)[1:]
        rows.append(
            [
                f"{late_s:g} s",
                _number(own[-1].acceleration_m_s2, 3),
                _number(min(entry.smallest_margin_m for entry in own)),
                _number(max(entry.largest_gap_m for entry in own), 1),
                str(sum(_fallbacks(each.decisions) for each in runs)),
            ]
        )
    return rows


def _number(value: float, digits: int = 2) -> str:
    return NO_VALUE if np.isnan(value) else f"{value:.{digits}f}"


def _with_ratio(value: float, ratio: float, digits: int = 2) -> str:
    suffix = "" if np.isnan(ratio) else f" (× {ratio:.2f})"
    return _number(value, digits) + suffix


def pace(run: StringRun) -> str:
    """Return how fast the string was driven, in one sentence."""
    count = len(run.trajectories)
    return (
        f"{count} vehicles, {run.prepared.route.duration_s:g} s, {run.wall_time_s:.1f} s of wall time on "
        f"{run.cores} processors: {run.speed_up:.1f} × real time, every vehicle recorded."
    )


def print_string(run: StringRun, console: Console) -> None:
    """Print the tables."""
    for columns, rows in (
        (DEVIATION_COLUMNS, deviation_rows(run)),
        (SAVING_COLUMNS, saving_rows(run)),
        (LATE_COLUMNS, late_rows(run)),
    ):
        if rows:
            table = Table(*columns)
            for row in rows:
                table.add_row(*row)
            console.print(table)
    console.print(pace(run), highlight=False)


def write_page(page: Path, run: StringRun) -> None:
    """Write the page and its picture.

    Args:
        page: Markdown file; the picture has the same name, in a folder `images` next to it if that exists.
        run: the string.
    """
    images = page.parent / "images"
    picture = (images if images.is_dir() else page.parent) / f"{page.stem}.png"
    save_string_picture(picture, run.trajectories, run.prepared.model.values)
    scenario = run.prepared.scenario
    title = f"# A string of {len(run.trajectories)} vehicles"
    conditions = (
        f"{run.prepared.route.name}, strategy `{scenario.strategy}`, horizon `{scenario.horizon}`, over "
        f"ROS 2. {pace(run)}"
    )
    parts = [
        title,
        NOTICE,
        INTRODUCTION,
        conditions,
        f"![Speeds and gaps of the string]({picture.relative_to(page.parent)})",
    ]
    parts += [
        "## From vehicle to vehicle",
        "In brackets: the ratio to the member ahead; below 1 a disturbance fades.",
    ]
    parts.append(_markdown(DEVIATION_COLUMNS, deviation_rows(run)))
    if run.others:
        parts += [
            "## What each vehicle saves",
            f"Against a string that drives by `{run.against}`, each vehicle against the one in its place.",
        ]
        parts.append(_markdown(SAVING_COLUMNS, saving_rows(run)))
    if run.late:
        parts += [
            "## How late the plans may be",
            "The same string without ROS, with `latency_s`; the extremes of all vehicles.",
        ]
        parts.append(_markdown(LATE_COLUMNS, late_rows(run)))
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text("\n\n".join(part.strip() for part in parts) + "\n", encoding="utf-8")


def _markdown(columns: Sequence[str], rows: Rows) -> str:
    first, *others = columns
    return markdown_table((first, *(f"{column}:" for column in others)), rows)
