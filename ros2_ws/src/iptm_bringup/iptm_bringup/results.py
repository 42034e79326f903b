"""The outcome of a run as data: figures, solver, limits, and whether all of it can be trusted."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from iptm_bringup.scenario import Scenario
from iptm_bringup.scenario_files import scenario_text
from iptm_controller.ladder import Rung
from iptm_controller.solvers.result import SolveStatus
from iptm_core.metrics import RunMetrics, metric_rows
from iptm_core.state import FloatArray
from iptm_recording.trajectory_reader import SolveSeries

NO_SOLVE = "no_problem_posed"


@dataclass(frozen=True)
class Quantiles:
    """Median, 99th percentile and largest of a series; NaN for an empty one."""

    median: float
    p99: float
    largest: float


@dataclass(frozen=True)
class SolverStatistics:
    """How the decisions of a run came about.

    Attributes:
        decisions: number of decisions.
        by_status: solves by status, in words.
        by_rung: decisions by rung of the fallback ladder, in words.
        limited: decisions that the last limiter changed.
        without_preview: decisions before which no prediction of the leader had arrived.
        preview_age_s: age of the prediction in use, where there was one.
        solve_time_ms: wall time of a solve.
        iterations: iterations of a solve.
        gap_slack_m: largest violation of a gap limit in any plan.
        temperature_slack_k: largest violation of a temperature limit in any plan.
    """

    decisions: int
    by_status: Mapping[str, int]
    by_rung: Mapping[str, int]
    limited: int
    without_preview: int
    preview_age_s: Quantiles
    solve_time_ms: Quantiles
    iterations: Quantiles
    gap_slack_m: float
    temperature_slack_k: float


@dataclass(frozen=True)
class RunResults:
    """Everything there is to say about a finished run.

    Attributes:
        scenario: what was driven.
        metrics: figures of the run, from the bag if there is one.
        solver: how the decisions came about.
        wall_time_s: from the first to the last clock.
        live_equals_bag: whether the runner heard exactly what the bag holds; None without a bag.
        bag_messages: messages in the bag by topic, None without a bag.
        problems: why the run does not count as good, empty if it does.
        warnings: what the nodes complained about while it ran.
        information: revision, versions and time of the start, by name.
    """

    scenario: Scenario
    metrics: RunMetrics
    solver: SolverStatistics
    wall_time_s: float
    live_equals_bag: bool | None
    bag_messages: Mapping[str, int] | None
    problems: tuple[str, ...]
    warnings: tuple[str, ...]
    information: Mapping[str, str]

    @property
    def speed_up(self) -> float:
        """Trip time per wall time."""
        return self.metrics.duration_s / self.wall_time_s if self.wall_time_s > 0.0 else math.nan


def solver_statistics(solves: SolveSeries) -> SolverStatistics:
    """Summarise the controller's reports of a run."""
    values = solves.values
    status_names = {status.value: status.name.lower() for status in SolveStatus}
    rung_names = {rung.value: rung.name.lower() for rung in Rung}
    return SolverStatistics(
        decisions=int(solves.time_s.size),
        by_status=_counted(values["status_code"], status_names, NO_SOLVE),
        by_rung=_counted(values["fallback_rung"], rung_names, "unknown"),
        limited=int(np.count_nonzero(values["limiter_active"])),
        without_preview=int(np.count_nonzero(~np.isfinite(values["preview_age_s"]))),
        preview_age_s=_quantiles(values["preview_age_s"]),
        solve_time_ms=_quantiles(1e3 * values["solve_time_s"]),
        iterations=_quantiles(values["iterations"]),
        gap_slack_m=_largest(values["gap_slack_m"]),
        temperature_slack_k=_largest(values["temperature_slack_k"]),
    )


def results_json(results: RunResults) -> str:
    """Return results as JSON text; what is unknown (NaN) becomes null."""
    metrics = results.metrics
    document = {
        "scenario": results.scenario.name,
        "scenario_file": scenario_text(results.scenario),
        "good": not results.problems,
        "problems": list(results.problems),
        "warnings": list(results.warnings),
        "rows": [
            {"key": row.key, "label": row.label, "value": row.value, "unit": row.unit}
            for row in metric_rows(metrics)
        ],
        "metrics": asdict(metrics),
        "solver": asdict(results.solver),
        "wall_time_s": results.wall_time_s,
        "speed_up": results.speed_up,
        "live_equals_bag": results.live_equals_bag,
        "bag_messages": results.bag_messages,
        "information": dict(results.information),
    }
    return json.dumps(_plain(document), indent=2, allow_nan=False) + "\n"


def _counted(codes: FloatArray, names: Mapping[int, str], otherwise: str) -> dict[str, int]:
    found, counts = np.unique(codes.astype(int), return_counts=True)
    return {
        names.get(int(code), otherwise): int(count)
        for code, count in zip(found, counts, strict=True)
    }


def _quantiles(values: FloatArray) -> Quantiles:
    known = values[np.isfinite(values)]
    if known.size == 0:
        return Quantiles(math.nan, math.nan, math.nan)
    median, p99, largest = (float(np.quantile(known, q)) for q in (0.5, 0.99, 1.0))
    return Quantiles(median, p99, largest)


def _largest(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.max(known)) if known.size else math.nan


def _plain(value: Any) -> Any:
    """Return a value with everything that JSON does not know replaced."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
