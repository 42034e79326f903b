"""A finished run: what `simulate` and `load` return, and what every table and picture is made of."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from iptm.report import figure_table, html_table, image, write_page
from iptm_core.decision_record import DecisionSeries
from iptm_core.metrics import FIGURES, RunMetrics, compute_metrics, figure_values
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes.slope import SlopeProfile
from iptm_core.trajectory import Trajectory

if TYPE_CHECKING:
    from iptm.picture import Picture


@dataclass(frozen=True)
class Report:
    """What controller or vehicle (``source``) reported from a trip time on, until it reported something else.

    The text is the reason of a decision, or what the vehicle did of its own accord; empty where all is well.
    """

    time_s: float
    source: str
    text: str


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A finished run.

    Attributes:
        name: what was driven, in one line.
        settings: choices by the names that scenarios use (``strategy``, ``horizon``, ``latency_s``, ...).
        parameters: vehicle, pack, cooling and environment.
        trajectory: what happened, one row per tick.
        decisions: how the controller came to its commands; no rows for a controller without solver.
        slope: slope of the road, None where it is not known.
        reports: what controller and vehicle reported while it was driven without ROS, on every change.
    """

    name: str
    settings: Mapping[str, Any]
    parameters: ModelParameters
    trajectory: Trajectory
    decisions: DecisionSeries
    slope: SlopeProfile | None = None
    reports: tuple[Report, ...] = ()

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
        `iptm_core.decision_record.DecisionSeries`. Row k holds the state at t_k, means over the interval
        that ended there, and the decision made there; the last row has none (NaN).
        """
        driven = pd.DataFrame({**self.trajectory.to_arrays(), "gap_m": self.trajectory.gap_m})
        decided = pd.DataFrame(self.decisions.to_arrays()).set_index("time_s")
        return driven.set_index("time_s").join(decided)

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
        return write_page(path, self.name, sections)

    def __repr__(self) -> str:
        """Name and length."""
        return f"<iptm.Run {self.name}, {self.metrics.duration_s:g} s>"


def figure_title(key: str) -> str:
    """Return key and unit of a figure, ``1`` for a pure number."""
    return f"{key} [{FIGURES[key].unit or 1}]"
