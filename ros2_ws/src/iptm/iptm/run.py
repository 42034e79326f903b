"""A finished run: what `simulate` and `load` return, and what every table and picture is made of."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.decision_record import DecisionSeries
from iptm_core.declaration import TextEnum, parameter_specs
from iptm_core.errors import ScenarioError
from iptm_core.metrics.energy_balance import EnergyBalance, energy_balance
from iptm_core.metrics.figures import FIGURES, SAVINGS, WORTH, figure_values
from iptm_core.metrics.repeated import Repeated
from iptm_core.metrics.run_metrics import RunMetrics, compute_metrics
from iptm_core.metrics.saving import Saving, judge_saving
from iptm_core.metrics.trip_cost import TripCost, trip_cost
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes.slope import SlopeProfile
from iptm_core.settings import LeaderSource, LoopMode, PreviewMode
from iptm_core.trajectory import Trajectory
from iptm_core.user_input import known_keywords

if TYPE_CHECKING:
    import pandas as pd

    from iptm.explanation import Explanation
    from iptm.judging import Verdicts
    from iptm.panels import Panel
    from iptm.picture import Picture
    from iptm.trip import Trip
    from iptm_ros.recording.run_information import RunInformation


NOTED_GAP_M = 500.0
"""Gap above which a remark asks for the unit of the speeds."""


class Reporter(TextEnum):
    """Who reports what was not as it should be."""

    CONTROLLER = "controller"
    """The reason of a decision."""
    VEHICLE = "vehicle"
    """Actions of the vehicle itself."""


@dataclass(frozen=True)
class Report:
    """A report that holds from a trip time until the next one; an empty text reports no problem.

    Attributes:
        weak_brakes: the brakes deliver noticeably less than requested.
    """

    time_s: float
    source: Reporter
    text: str
    weak_brakes: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A finished run, driven in memory or over ROS 2, or read from a bag.

    Attributes:
        name: the drive in one line.
        settings: settings of the trip by name (``strategy``, ``horizon``, ``latency_s``, ...); empty where
            they are not known.
        parameters: vehicle, pack, cooling and environment.
        trajectory: what happened, one row per tick.
        decisions: how the controller came to its commands; no rows for a controller without solver.
        slope: slope of the road, None where it is not known.
        trip: the requested trip, None where it is not known.
        reports: reports of the trip, one for every change; in memory only.
        wall_time_s: of the drive, NaN where it is not known.
        problems: why the run counts as failed, empty if it does not.
        warnings: repairs of the drive's file, warnings of the nodes, remarks on the figures.
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
        """Figures by key, such as ``consumption``, in the units of `iptm_core.metrics.figures.FIGURES`."""
        return figure_values(self.metrics)

    @property
    def energies(self) -> EnergyBalance:
        """Where the energy went, see `iptm_core.metrics.energy_balance`; an unknown road is level."""
        return energy_balance(self.trajectory, self.parameters, self.slope or SlopeProfile.flat())

    @property
    def summary(self) -> pd.Series:
        """Figures as a Series; the index holds keys and units, such as ``consumption [kWh/100 km]``.

        Of a run with an ``other``, what it saved against that stands first, NaN where it cannot be judged.
        """
        import pandas as pd  # noqa: PLC0415  a second of its own

        values = {} if self.other is None else self.saving(self.other).values
        titled = {figure_title(key): value for key, value in {**values, **self.figures}.items()}
        return pd.Series(titled, name=self.name, dtype=float)

    @property
    def broken_limits(self) -> pd.DataFrame:
        """Limits that were broken, a row each: kind, rows, first time (s), worst value and its time (s)."""
        import pandas as pd  # noqa: PLC0415  a second of its own

        rows = {
            check.label: {
                "kind": "hard" if check.hard else "soft",
                "rows": check.violations,
                "first_s": check.first_time_s,
                "worst": check.worst_excess,
                "unit": check.unit,
                "worst_s": check.worst_time_s,
            }
            for check in self.metrics.broken_limits
        }
        columns = ["kind", "rows", "first_s", "worst", "unit", "worst_s"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns)

    @known_keywords
    def saving(self, other: Run | None = None) -> Saving:
        """Judge what this run saved against another run of the same trip.

        Where the ends of the trip decide, both drive it several times more until the pack's temperature
        repeats, see `iptm.repetition`.

        Args:
            other: the other run; None for the attribute ``other``.

        Raises:
            ScenarioError: neither is given.
        """
        against = other or self.other
        if against is None:
            raise ScenarioError("saving: other is None; allowed: a run of the same trip")
        return judge_saving(
            self.metrics,
            against.metrics,
            self.parameters,
            against.parameters,
            self.preview,
            late=any(run.late_ticks for run in (self, against)),
            repeat=partial(_repeated, self, against),
        )

    @property
    def late_ticks(self) -> int:
        """Ticks of a run in real time that an earlier command or none was carried out in."""
        decisions = self.metrics.decisions
        in_real_time = self.settings.get("mode") == LoopMode.REAL_TIME
        return decisions.held + decisions.undecided if decisions and in_real_time else 0

    @property
    def preview(self) -> str:
        """Preview of the leader that the run had, in words; empty where its settings are not known."""
        if "preview_mode" not in self.settings:
            return ""
        if self.settings["preview_mode"] == PreviewMode.NONE:
            return str(PreviewMode.NONE)
        defects = ("latency_s", "dropout_probability", "noise_std_m_s", "predictor")
        is_perfect = self.settings["leader_source"] == LeaderSource.CYCLE and not any(
            self.settings.get(name) for name in defects
        )
        length = f"{self.settings['preview_length_s']:g} s"
        return f"{length}, perfect" if is_perfect else length

    def cost(self, use: AgingSettings | None = None) -> TripCost:
        """Return what energy and capacity cost, in EUR per 100 km; see `iptm_core.metrics.trip_cost`.

        Args:
            use: prices, law and use of the car between trips; None for this run's.
        """
        used = use or self.aging_use
        return trip_cost(self.trajectory, self.metrics, self.parameters, used)

    @property
    def aging_use(self) -> AgingSettings:
        """Prices, ageing law and use of the car between trips; defaults where they are not known."""
        known = {spec.name for spec in parameter_specs(AgingSettings)} & self.settings.keys()
        return AgingSettings(**{name: self.settings[name] for name in known})

    @property
    def frame(self) -> pd.DataFrame:
        """One row per tick, indexed by ``time_s``; units stand in the names of the columns.

        The columns are the fields of `iptm_core.trajectory.Trajectory` with the gap, then those of
        `iptm_core.decision_record.DecisionSeries`. Row k holds the state at t_k and the decision made there;
        the last row has none (NaN). Its compressor power and other powers are means over the interval that
        *ended* at t_k: what row k decides is done in row k + 1, and row 0 has no powers. Its acceleration is
        the commanded one, or, where the vehicle stops or its safety monitor brakes, the one at the end of the
        interval; ``mean_acceleration_m_s2`` is the change of the speed.
        """
        import pandas as pd  # noqa: PLC0415  a second of its own

        rows = self.trajectory
        mean_m_s2 = np.concatenate(([math.nan], np.diff(rows.speed_m_s) / rows.intervals_s))
        added = {"gap_m": rows.gap_m, "mean_acceleration_m_s2": mean_m_s2}
        driven = pd.DataFrame({**rows.to_arrays(), **added})
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

    @known_keywords
    def explain(self, other: Run | None = None) -> Explanation:
        """Explain where the saving against another run of the same trip comes from; drives it again.

        Args:
            other: see `saving`.

        Returns:
            A table of percentage points that add up to the saving, and a sentence.

        Raises:
            ScenarioError: the trip is not known, has faults, or the runs differ in vehicle or length.
        """
        from iptm.explanation import explain  # noqa: PLC0415  the model takes a moment to load

        against = other or self.other
        if against is None:
            raise ScenarioError("explain: other is None; allowed: a run of the same trip")
        return explain(self, against)

    def judge(self, other: Run | None = None, by: Sequence[str] = (), **options: Any) -> Verdicts:
        """Judge the ageing by several laws: the paper's, measured cells', and laws of extras.

        Args:
            other: see `saving`; without one, this run alone is judged.
            by: groups or judges, see `iptm.judging.judge`, where the options are, too; by default the paper's
                law and the measured cells of the suite.
        """
        from iptm.judging import BY, judge  # noqa: PLC0415  pandas takes a second to load

        return judge(self, other or self.other, by or BY, **options)

    @known_keywords
    def plot(
        self, against: Run | None = None, remarks: Sequence[str] = (), footer: str = ""
    ) -> Picture:
        """Draw the run over time, as the command line does.

        Args:
            against: run whose curves are drawn behind the curves of this one.
            remarks: lines of the heading, below the name; if empty, the saving against the other run.
            footer: text below the picture.

        Returns:
            A matplotlib figure; notebooks show it, and ``savefig`` writes it.
        """
        from iptm.picture import picture  # noqa: PLC0415  matplotlib takes a moment to load
        from iptm.report import outcome_lines  # noqa: PLC0415

        if against is not None and not remarks:
            lines = self.saving(against).lines
            remarks = [
                f"against {against.strategy}",
                *(f"{label}: {text}" for label, text in lines),
            ]
        outcome = "; ".join(filter(None, [footer, *outcome_lines(self.metrics, self.problems)]))
        return picture(self._panels(against), [self.name, *remarks], outcome)

    def _panels(self, against: Run | None) -> list[Panel]:
        from iptm.panels import Shown, run_panels  # noqa: PLC0415  only a picture has them

        behind = None if against is None else (against.strategy, against.trajectory)
        road = self.slope or SlopeProfile.flat()
        return run_panels(Shown(self.trajectory, self.parameters, self.decisions, road, behind))

    @known_keywords
    def report(
        self, path: str | Path, against: Run | None = None, *, explained: bool = False
    ) -> Path:
        """Write result, picture, figures and settings as one HTML page that needs no other file.

        Args:
            path: new file.
            against: see `plot`; None for the attribute ``other``.
            explained: whether to add where the saving comes from, by up to three more drives.

        Raises:
            StoreError: the file exists, or cannot be written.
            ScenarioError: it cannot be explained, see `explain`.
        """
        from iptm.report import write_run  # noqa: PLC0415  few runs become a page

        against = against or self.other
        return write_run(self, path, against, self._panels(against), explained=explained)

    @known_keywords
    def save(self, path: str | Path) -> Path:
        """Write the run to a new file that `iptm.load` reads back.

        Trajectory, decisions, parameters, settings and trip are kept; reports and the ``other`` run are
        not, nor is the trip of a drive that was given as data.

        Args:
            path: new file, ending in ``.npz``: arrays that numpy reads, too.

        Raises:
            StoreError: the file exists, has another ending, or cannot be written.
        """
        from iptm.run_file import save_run  # noqa: PLC0415  it imports this module

        return save_run(self, path)

    def labelled(self, what: str, settings: Mapping[str, Any]) -> Run:
        """Return the run with an addition to its name and to its settings."""
        return replace(self, name=f"{self.name}, {what}", settings={**self.settings, **settings})

    def __repr__(self) -> str:
        """Name and length, and why it counts as failed."""
        problems = "".join(f"; PROBLEM: {problem}" for problem in self.problems)
        return f"<iptm.Run {self.name}, {self.metrics.duration_s:g} s{problems}>"


def following_notes(trajectory: Trajectory, parameters: ModelParameters) -> list[str]:
    """Return remarks on a leader that is too fast for the vehicle, or was lost."""
    notes = []
    fastest_m_s = float(np.fmax.reduce(trajectory.leader_speed_m_s))
    if fastest_m_s > parameters.limits.max_speed_m_s:
        notes.append(
            f"the leader drives up to {fastest_m_s:.3g} m/s, the ego vehicle at most"
            f" {parameters.limits.max_speed_m_s:.3g} m/s: it could not follow"
        )
    largest_m = float(np.fmax.reduce(trajectory.gap_m))
    if largest_m > NOTED_GAP_M:
        notes.append(f"the gap grows to {largest_m:.0f} m: is the unit of the speeds right?")
    return notes


def _repeated(own: Run, other: Run) -> tuple[Repeated, Repeated] | None:
    """Drive the trip of both runs until the temperature of the pack repeats, where that is possible."""
    from iptm.repetition import repeat, why_not  # noqa: PLC0415  the model takes a moment to load

    if why_not(own) or why_not(other):
        return None
    first = repeat(own)
    second = None if first is None else repeat(other)
    return None if first is None or second is None else (first, second)


def figure_title(key: str) -> str:
    """Return key and unit of a figure, ``1`` for a pure number."""
    figure = {**FIGURES, **SAVINGS, WORTH.key: WORTH}[key]
    return f"{key} [{figure.unit or 1}]"
