"""Origin of a controller's decisions: the record of one, the series of a run, and its statistics.

Controller, topic ``controller/solve``, bags, stored studies and tables use these terms, and `DrivingMode`
where a car carries the suite.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from operator import attrgetter
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from iptm_core.declaration import TextEnum
from iptm_core.state import CommandSource, FloatArray
from iptm_core.trajectory import Columns, Trajectory


class SolveStatus(IntEnum):
    """Outcome of one solve; the numbers travel in messages and bags."""

    NOT_POSED = -1
    """No solve: without a state and a leader no problem can be posed."""
    SOLVED = 0
    """Converged to the requested tolerance."""
    FEASIBLE = 1
    """Stopped early (iterations or time), but the iterate keeps dynamics and limits: usable."""
    ITERATION_LIMIT = 2
    """Stopped at the iteration limit with an iterate that cannot be used."""
    DEADLINE = 3
    """Stopped at the time limit with an iterate that cannot be used."""
    NUMERICAL_ERROR = 4
    """The solver broke off (not a number, singular system, internal error)."""

    @property
    def usable(self) -> bool:
        """True if the iterate may be acted on."""
        return self in {SolveStatus.SOLVED, SolveStatus.FEASIBLE}


class Rung(IntEnum):
    """Where a command comes from: the rungs of the fallback ladder, top first."""

    OPTIMAL = 0
    """What the strategy decides: an optimal plan, or the law of a strategy that optimises nothing."""
    SHIFTED_PLAN = 1
    SAFE_LAW = 2
    STOP = 3
    EMERGENCY_BRAKING = 4
    """From whichever rung: its command would have led into the leader, so the brakes are applied in full."""


@dataclass(frozen=True)
class DecisionRecord:
    """How one decision came about; a quantity that is not known is NaN.

    Attributes:
        solve_time_s: processor time of the solver, NaN without a solve.
        iterations: of the solver, 0 without a solve.
        gap_slack_m: largest violation of a gap limit in the plan.
        objective: value of the cost, slack penalties included.
        preview_age_s: time since the preview in use was generated, NaN or infinite without one.
        cell_1_marginal_cost_1_k: terminal cost per kelvin of cell 1 at the end of the horizon, 0 without one.
        aging_rate_1_s: mean rate of the capacity loss behind these costs, sum of both cells.
        aging_sensitivity_1_k: relative change of that rate with temperature.
        temperature_decay_time_s: decay time of a temperature difference in these marginal costs (tau).
        trusted_preview_s: how far ahead the preview was trusted, 0 without one.
        command_delay_s: time by which commands acted late, as observed.
        brake_share: share of a commanded deceleration that the brakes delivered, as observed.
        solve_wall_time_s: wall time of the solve; longer than its processor time where it had to wait.
    """

    status: SolveStatus
    solve_time_s: float
    iterations: int
    gap_slack_m: float
    speed_slack_m_s: float
    temperature_slack_k: float
    objective: float
    rung: Rung
    limiter_active: bool
    preview_age_s: float
    cell_1_marginal_cost_1_k: float = 0.0
    cell_n_marginal_cost_1_k: float = 0.0
    aging_rate_1_s: float = 0.0
    aging_sensitivity_1_k: float = 0.0
    temperature_decay_time_s: float = 0.0
    trusted_preview_s: float = 0.0
    command_delay_s: float = 0.0
    brake_share: float = 1.0
    solve_wall_time_s: float = 0.0


@dataclass(frozen=True, eq=False)
class DecisionSeries(Columns):
    """The decisions of a run: the fields of `DecisionRecord` as arrays, and instants of their states."""

    table = "decisions"
    types: ClassVar = {
        **dict.fromkeys(("status", "iterations", "rung"), np.int64),
        "limiter_active": np.bool_,
    }

    time_s: FloatArray
    status: NDArray[np.int64]
    solve_time_s: FloatArray
    iterations: NDArray[np.int64]
    gap_slack_m: FloatArray
    speed_slack_m_s: FloatArray
    temperature_slack_k: FloatArray
    objective: FloatArray
    rung: NDArray[np.int64]
    limiter_active: NDArray[np.bool_]
    preview_age_s: FloatArray
    cell_1_marginal_cost_1_k: FloatArray
    cell_n_marginal_cost_1_k: FloatArray
    aging_rate_1_s: FloatArray
    aging_sensitivity_1_k: FloatArray
    temperature_decay_time_s: FloatArray
    trusted_preview_s: FloatArray
    command_delay_s: FloatArray
    brake_share: FloatArray
    solve_wall_time_s: FloatArray

    @classmethod
    def from_records(
        cls, times_s: Sequence[float], records: Iterable[DecisionRecord]
    ) -> DecisionSeries:
        """Put records together."""
        names = [entry.name for entry in fields(DecisionRecord)]
        rows = [*map(attrgetter(*names), records)]
        columns = zip(*rows, strict=True) if rows else [()] * len(names)
        return cls(np.array(times_s), *map(np.array, columns))


Distribution = Mapping[str, float]
"""``median``, ``p99``, ``largest``, ``mean`` and ``total`` of a series; NaN where nothing is known."""


def distribution(values: NDArray[np.generic]) -> Distribution:
    """Summarise the finite entries of a series."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    if known.size == 0:
        return dict.fromkeys(("median", "p99", "largest", "mean", "total"), math.nan)
    return {
        "median": float(np.quantile(known, 0.5)),
        "p99": float(np.quantile(known, 0.99)),
        "largest": float(np.max(known)),
        "mean": float(np.mean(known)),
        "total": float(np.sum(known)),
    }


@dataclass(frozen=True)
class DecisionStatistics:
    """How the decisions of a run came about, in numbers.

    Attributes:
        fallbacks: intervals in which the vehicle carried out another command than a fresh solution.
        held: intervals in which it carried out an earlier command, as the answer came too late.
        undecided: intervals in which it stopped for want of commands.
        limited: decisions that the last limiter changed.
        without_preview: decisions before which no prediction of the leader had arrived.
        preview_age_s: age of the prediction in use, where there was one.
        solve_time_s: processor time of a solve; its total is the computing time of the paper.
        gap_slack_m: violations of gap limits in the plans.
    """

    decisions: int
    by_status: Mapping[SolveStatus, int]
    by_rung: Mapping[Rung, int]
    limited: int
    without_preview: int
    preview_age_s: Distribution
    solve_time_s: Distribution
    iterations: Distribution
    gap_slack_m: Distribution
    speed_slack_m_s: Distribution
    temperature_slack_k: Distribution
    fallbacks: int
    held: int = 0
    undecided: int = 0

    @classmethod
    def of(cls, series: DecisionSeries, run: Trajectory | None = None) -> DecisionStatistics:
        """Count and rank the decisions of a run.

        Args:
            series: the decisions.
            run: what the vehicle did; None counts every decision as carried out. A vehicle that does not
                publish its source of commands stopped at every instant but the last without a decision.
        """
        sources = _sources(series, run)
        answered = (
            series.time_s if run is None else run.time_s[:-1][sources == CommandSource.ANSWER]
        )
        other = np.isin(series.time_s, answered) & (series.rung != Rung.OPTIMAL)
        held = int(np.count_nonzero(sources == CommandSource.HELD))
        undecided = int(np.count_nonzero(sources == CommandSource.STOP))
        return cls(
            fallbacks=int(np.count_nonzero(other)) + held + undecided,
            held=held,
            undecided=undecided,
            decisions=len(series),
            by_status={
                status: int(np.count_nonzero(series.status == status)) for status in SolveStatus
            },
            by_rung={rung: int(np.count_nonzero(series.rung == rung)) for rung in Rung},
            limited=int(np.count_nonzero(series.limiter_active)),
            without_preview=int(np.count_nonzero(~np.isfinite(series.preview_age_s))),
            preview_age_s=distribution(series.preview_age_s),
            solve_time_s=distribution(series.solve_time_s),
            iterations=distribution(series.iterations),
            gap_slack_m=distribution(series.gap_slack_m),
            speed_slack_m_s=distribution(series.speed_slack_m_s),
            temperature_slack_k=distribution(series.temperature_slack_k),
        )

    @property
    def fallbacks_text(self) -> str:
        """The ticks on a fallback in words."""
        if not self.fallbacks:
            return "no fallback"
        parts = (
            (self.held, "with an earlier command"),
            (self.undecided, "stopped for want of commands"),
        )
        kinds = [f"{count} of them {what}" for count, what in parts if count]
        return ", ".join([f"{self.fallbacks} ticks on a fallback", *kinds])

    @property
    def failed_solves(self) -> int:
        """Solves without a usable iterate."""
        answered = (SolveStatus.NOT_POSED, SolveStatus.SOLVED, SolveStatus.FEASIBLE)
        return self.decisions - sum(self.by_status[status] for status in answered)


def _sources(series: DecisionSeries, run: Trajectory | None) -> FloatArray:
    """Return the source of the command by interval."""
    if run is None:
        return np.empty(0)
    if not np.isnan(run.command_source).all():
        return run.command_source[1:]
    missing = ~np.isin(run.time_s[:-1], series.time_s) & bool(len(series))
    return np.where(missing, float(CommandSource.STOP), float(CommandSource.ANSWER))


class DrivingMode(TextEnum):
    """Who drives; `vehicle/engagement` carries the position in this list, counted from 0."""

    OFF = "off"
    READY = "ready"
    ENGAGED = "engaged"
    OVERRIDDEN = "overridden"
    HAND_OVER = "hand_over"

    @property
    def number(self) -> float:
        """Position in the list."""
        return float(list(DrivingMode).index(self))
