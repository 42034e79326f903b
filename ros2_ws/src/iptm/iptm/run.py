"""A finished run: what `simulate` and `load` return, and what every table and picture is made of."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from iptm.report import figure_table, html_table, image, write_page
from iptm_core.decision_record import DecisionSeries
from iptm_core.declaration import TextEnum
from iptm_core.metrics import FIGURES, RunMetrics, compute_metrics, figure_values
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes.slope import SlopeProfile
from iptm_core.trajectory import Trajectory

if TYPE_CHECKING:
    from iptm.channel_record import ChannelRecord
    from iptm.picture import Picture
    from iptm.trip import Trip
    from iptm.whole_trip import WholeTripRecord
    from iptm_ros.recording.run_information import RunInformation


class Reporter(TextEnum):
    """Who reports what was not as it should be."""

    CONTROLLER = "controller"
    """The reason of a decision."""
    VEHICLE = "vehicle"
    """What the vehicle did of its own accord."""


@dataclass(frozen=True)
class Report:
    """What was reported from a trip time on, until something else was; an empty text where all is well.

    Attributes:
        weak_brakes: the brakes deliver noticeably less than what is requested of them.
    """

    time_s: float
    source: Reporter
    text: str
    weak_brakes: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A finished run, driven in memory or over ROS 2, or read from a bag.

    Attributes:
        name: what was driven, in one line.
        settings: settings of the trip by name (``strategy``, ``horizon``, ``latency_s``, ...); empty where
            they are not known.
        parameters: vehicle, pack, cooling and environment.
        trajectory: what happened, one row per tick.
        decisions: how the controller came to its commands; no rows for a controller without solver.
        slope: slope of the road, None where it is not known.
        trip: what was to be driven, None where it is not known.
        channel: what all cells of a coolant channel went through; None where the plant has but two.
        whole_trip: how a whole trip was solved; None for a closed loop.
        reports: what was reported during the trip, on every change; in memory only.
        wall_time_s: of the drive, NaN where it is not known.
        problems: why the run counts as failed, empty if it does not.
        warnings: what was repaired in the file of the drive, warnings of the nodes, remarks on the figures.
        bag_messages: messages in the bag by topic, None without a bag.
        information: provenance of a run over ROS 2: revision, versions, start time.
        other: the same trip under another strategy, None without a comparison.
    """

    name: str
    settings: Mapping[str, Any]
    parameters: ModelParameters
    trajectory: Trajectory
    decisions: DecisionSeries
    slope: SlopeProfile | None = None
    trip: Trip | None = None
    channel: ChannelRecord | None = None
    whole_trip: WholeTripRecord | None = None
    reports: tuple[Report, ...] = ()
    wall_time_s: float = math.nan
    problems: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    bag_messages: Mapping[str, int] | None = None
    information: RunInformation | None = None
    other: Run | None = None

    @cached_property
    def metrics(self) -> RunMetrics:
        """Energy, degradation, gaps, temperatures and limits."""
        return compute_metrics(self.trajectory, self.parameters, self.decisions)

    @property
    def figures(self) -> dict[str, float]:
        """Figures by key, such as ``consumption``, in the units of `iptm_core.metrics.FIGURES`."""
        return figure_values(self.metrics)

    @property
    def summary(self) -> pd.Series:
        """Figures as a Series; the index holds keys and units, such as ``consumption [kWh/100 km]``."""
        values = {figure_title(key): value for key, value in self.figures.items()}
        return pd.Series(values, name=self.name, dtype=float)

    @property
    def frame(self) -> pd.DataFrame:
        """One row per tick, indexed by ``time_s``; units stand in the names of the columns.

        The columns are those of `iptm_core.trajectory.Trajectory` with the gap, then those of
        `iptm_core.decision_record.DecisionSeries`. Row k holds the state at t_k and the decision made there;
        the last row has none (NaN). Its acceleration, compressor power and other powers are means over the
        interval that *ended* at t_k: what row k decides is done in row k + 1, and row 0 has no powers.
        """
        driven = pd.DataFrame({**self.trajectory.to_arrays(), "gap_m": self.trajectory.gap_m})
        decided = pd.DataFrame(self.decisions.to_arrays()).set_index("time_s")
        return driven.set_index("time_s").join(decided)

    @property
    def speed_up(self) -> float:
        """Trip time per wall time, NaN where that is not known."""
        return self.metrics.duration_s / self.wall_time_s if self.wall_time_s > 0.0 else math.nan

    @property
    def strategy(self) -> str:
        """Strategy of the controller, the name of the run where that is not known."""
        return str(self.settings.get("strategy", self.name))

    def plot(
        self, against: Run | None = None, remarks: Sequence[str] = (), footer: str = ""
    ) -> Picture:
        """Draw the run over time, as the command line does.

        Args:
            against: run whose curves are drawn behind those of this one.
            remarks: lines of the heading, below the name.
            footer: text below the picture.

        Returns:
            A matplotlib figure; notebooks show it, and ``savefig`` writes it.
        """
        # matplotlib takes a moment to load
        from iptm.run_picture import HEADING_COLUMNS, run_picture  # noqa: PLC0415

        behind = None if against is None else (against.strategy, against.trajectory)
        headline = "\n".join([textwrap.fill(self.name, HEADING_COLUMNS), *remarks])
        driven = self.trajectory, self.parameters, self.decisions, self.slope
        return run_picture(*driven, behind, headline, footer)

    def report(self, path: str | Path, against: Run | None = None) -> Path:
        """Write figures, settings and picture as one HTML page that needs no other file.

        Args:
            path: new file.
            against: see `plot`.

        Raises:
            StoreError: the file exists, or cannot be written.
        """
        sections = {
            "Over time": image(self.plot(against).png()),
            "Figures": html_table(figure_table({"value": self.metrics})),
        }
        if self.settings:
            sections["Settings"] = html_table(pd.DataFrame({"settings": {**self.settings}}))
        if self.warnings:
            sections["Notes"] = html_table(pd.DataFrame({"notes": self.warnings}))
        return write_page(path, self.name, sections)

    def labelled(self, what: str, settings: Mapping[str, Any]) -> Run:
        """Return the run with an addition to its name and to its settings."""
        return replace(self, name=f"{self.name}, {what}", settings={**self.settings, **settings})

    def __repr__(self) -> str:
        """Name and length."""
        return f"<iptm.Run {self.name}, {self.metrics.duration_s:g} s>"


def figure_title(key: str) -> str:
    """Return key and unit of a figure, ``1`` for a pure number."""
    return f"{key} [{FIGURES[key].unit or 1}]"
