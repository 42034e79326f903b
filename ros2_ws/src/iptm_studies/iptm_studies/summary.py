"""The figures of a finished run: the paper's rows, the limits kept, and the solver's record."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from iptm_controller.ladder import Rung
from iptm_controller.solvers.result import SolveStatus
from iptm_core.metrics import MetricRow, RunMetrics, compute_metrics, metric_rows
from iptm_core.parameters.model import ModelParameters
from iptm_core.trajectory import Trajectory
from iptm_studies.closed_loop import NO_SOLVE, DecisionLog
from iptm_studies.whole_trip import WholeTripRecord

NO_PROBLEM = "no_problem"
GAP_CHECKS = ("smallest_gap", "collision")


@dataclass(frozen=True)
class SolverSummary:
    """The solver's record over a run.

    Attributes:
        by_status: number of ticks by status name; ``no_problem`` where none could be posed.
        by_rung: number of ticks by the rung of the fallback ladder that the command came from.
        limiter_ticks: ticks at which the last limiter changed the command.
        mean_iterations: iterations per solve.
        max_iterations: most iterations of one solve.
        median_ms: median wall time of a solve.
        p99_ms: 99th percentile.
        max_ms: longest.
        total_s: sum over the run, the computing time of the paper.
        gap_slack_m: largest predicted violation of a gap limit.
        speed_slack_m_s: largest predicted violation of a speed limit.
        temperature_slack_k: largest predicted violation of a temperature limit.
    """

    by_status: Mapping[str, int]
    by_rung: Mapping[str, int]
    limiter_ticks: int
    mean_iterations: float
    max_iterations: int
    median_ms: float
    p99_ms: float
    max_ms: float
    total_s: float
    gap_slack_m: float
    speed_slack_m_s: float
    temperature_slack_k: float

    @property
    def ticks(self) -> int:
        """Number of decisions."""
        return sum(self.by_rung.values())

    @property
    def fallbacks(self) -> int:
        """Ticks whose command did not come from a fresh solution."""
        return self.ticks - self.by_rung[Rung.OPTIMAL.name.lower()]

    @property
    def unconverged(self) -> int:
        """Ticks without a converged solution."""
        return self.ticks - self.by_status[SolveStatus.SOLVED.name.lower()]


@dataclass(frozen=True)
class RunSummary:
    """All figures of a run.

    Attributes:
        metrics: of the trajectory.
        peak_battery_power_w: largest pack power of an interval.
        lowest_battery_power_w: smallest, negative when recuperating.
        mean_battery_power_w: mean pack power.
        solver: record of the solver; None for a whole trip.
        whole_trip: how a whole trip was solved; None for a closed loop.
    """

    metrics: RunMetrics
    peak_battery_power_w: float
    lowest_battery_power_w: float
    mean_battery_power_w: float
    solver: SolverSummary | None
    whole_trip: WholeTripRecord | None

    @property
    def gap_violations(self) -> int:
        """Rows with a gap below its lower limit, or with a collision."""
        return sum(
            check.violations for check in self.metrics.constraints if check.key in GAP_CHECKS
        )

    @property
    def total_degradation(self) -> float:
        """Capacity lost by both cells together, the paper's J4."""
        return self.metrics.degradation.cell_1 + self.metrics.degradation.cell_n

    def rows(self) -> tuple[MetricRow, ...]:
        """Every figure as a row; keys and order are the same for every run."""
        return (*metric_rows(self.metrics), *self._own_rows(), *self._solver_rows())

    def values(self) -> dict[str, float | None]:
        """Figures by the key of their row, in the unit of the row."""
        return {row.key: row.value for row in self.rows()}

    def _own_rows(self) -> tuple[MetricRow, ...]:
        return (
            MetricRow(
                "total_degradation",
                "Degradation of both cells",
                1e5 * self.total_degradation,
                "1e-5",
            ),
            MetricRow("gap_violations", "Gap limit broken", float(self.gap_violations), "rows"),
            MetricRow("peak_power", "Peak battery power", 1e-3 * self.peak_battery_power_w, "kW"),
            MetricRow(
                "lowest_power", "Lowest battery power", 1e-3 * self.lowest_battery_power_w, "kW"
            ),
            MetricRow("mean_power", "Mean battery power", 1e-3 * self.mean_battery_power_w, "kW"),
        )

    def _solver_rows(self) -> tuple[MetricRow, ...]:
        statuses = [*(status.name.lower() for status in SolveStatus), NO_PROBLEM]
        rungs = [rung.name.lower() for rung in Rung]
        return (
            *(
                self._row(
                    f"solves_{status}",
                    f"Solves: {status.replace('_', ' ')}",
                    "ticks",
                    partial(_status_count, status),
                )
                for status in statuses
            ),
            *(
                self._row(
                    f"commands_{rung}",
                    f"Commands: {rung.replace('_', ' ')}",
                    "ticks",
                    partial(_rung_count, rung),
                )
                for rung in rungs
            ),
            *(self._row(key, label, unit, pick) for key, label, unit, pick in _SOLVER_ROWS),
        )

    def _row(
        self, key: str, label: str, unit: str, pick: Callable[[SolverSummary], float]
    ) -> MetricRow:
        value = None if self.solver is None else float(pick(self.solver))
        return MetricRow(key, label, value, unit)


def _status_count(status: str, solver: SolverSummary) -> int:
    return solver.by_status[status]


def _rung_count(rung: str, solver: SolverSummary) -> int:
    return solver.by_rung[rung]


_SOLVER_ROWS: tuple[tuple[str, str, str, Callable[[SolverSummary], float]], ...] = (
    ("fallbacks", "Fallbacks", "ticks", lambda solver: solver.fallbacks),
    ("limiter_ticks", "Last limiter active", "ticks", lambda solver: solver.limiter_ticks),
    ("mean_iterations", "Iterations, mean", "1", lambda solver: solver.mean_iterations),
    ("max_iterations", "Iterations, most", "1", lambda solver: solver.max_iterations),
    ("solve_median", "Solve time, median", "ms", lambda solver: solver.median_ms),
    ("solve_p99", "Solve time, 99th percentile", "ms", lambda solver: solver.p99_ms),
    ("solve_max", "Solve time, longest", "ms", lambda solver: solver.max_ms),
    ("solve_total", "Computing time", "s", lambda solver: solver.total_s),
)


def summarise(
    trajectory: Trajectory,
    log: DecisionLog | None,
    whole_trip: WholeTripRecord | None,
    parameters: ModelParameters,
) -> RunSummary:
    """Work out the figures of a run.

    Args:
        trajectory: what happened, at least two rows.
        log: what the controller answered, None for a whole trip.
        whole_trip: how a whole trip was solved, None for a closed loop.
        parameters: limits to judge it by.

    Raises:
        StateError: the run has a single row.
    """
    metrics = compute_metrics(trajectory, parameters)
    powers = trajectory.battery_power_w[1:]
    return RunSummary(
        metrics=metrics,
        peak_battery_power_w=float(powers.max()),
        lowest_battery_power_w=float(powers.min()),
        mean_battery_power_w=metrics.energy.battery_j / metrics.duration_s,
        solver=None if log is None else summarise_log(log),
        whole_trip=whole_trip,
    )


def summarise_log(log: DecisionLog) -> SolverSummary:
    """Count and rank what the controller answered."""
    times_ms = 1e3 * log.solve_time_s
    by_status = {
        status.name.lower(): int(np.count_nonzero(log.status == status)) for status in SolveStatus
    }
    by_status[NO_PROBLEM] = int(np.count_nonzero(log.status == NO_SOLVE))
    return SolverSummary(
        by_status=by_status,
        by_rung={rung.name.lower(): int(np.count_nonzero(log.rung == rung)) for rung in Rung},
        limiter_ticks=int(np.count_nonzero(log.limiter_active)),
        mean_iterations=float(np.mean(log.iterations)),
        max_iterations=int(np.max(log.iterations)),
        median_ms=float(np.median(times_ms)),
        p99_ms=float(np.percentile(times_ms, 99.0)),
        max_ms=float(np.max(times_ms)),
        total_s=float(np.sum(log.solve_time_s)),
        gap_slack_m=_largest(log.gap_slack_m),
        speed_slack_m_s=_largest(log.speed_slack_m_s),
        temperature_slack_k=_largest(log.temperature_slack_k),
    )


def _largest(values: NDArray[np.float64]) -> float:
    """Largest value of those that exist, 0 if none does."""
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else 0.0
