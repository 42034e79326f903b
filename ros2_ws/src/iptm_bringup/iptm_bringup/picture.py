"""Picture and page of a run over ROS 2: those of the library, with heading and pace of the scenario."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path

from iptm.run import Run
from iptm.run_picture import HEADING_COLUMNS, run_picture
from iptm_bringup.evaluation import RunResults
from iptm_bringup.scenario import Scenario
from iptm_bringup.summary import AGING_SAVED
from iptm_core.decision_record import DecisionSeries
from iptm_core.declaration import parameter_specs, plain


def save_picture(path: Path, results: RunResults) -> None:
    """Draw a run.

    Args:
        path: PNG file to write.
        results: of the run.
    """
    prepared, other = results.prepared, results.comparison
    picture = run_picture(
        results.trajectory,
        prepared.model.values,
        results.decisions,
        prepared.route.slope,
        (other.strategy, other.trajectory) if other else None,
        _headline(results),
        _footer(results),
    )
    picture.savefig(path, metadata={"Software": "iptm"}, pil_kwargs={"compress_level": 9})


def save_report(path: Path, results: RunResults) -> None:
    """Write a run as one HTML page; see `Run.report`.

    Args:
        path: new file.
        results: of the run.
    """
    prepared, other = results.prepared, results.comparison
    model, scenario = prepared.model.values, prepared.scenario
    settings = {
        spec.name: plain(getattr(scenario, spec.name)) for spec in parameter_specs(Scenario)
    }
    slope = prepared.route.slope
    run = Run(prepared.heading, settings, model, results.trajectory, results.decisions, slope)
    against = None
    if other is not None:
        no_decisions = DecisionSeries.from_records([], [])
        against = Run(other.strategy, {}, model, other.trajectory, no_decisions)
    run.report(path, against)


def _headline(results: RunResults) -> str:
    lines = dict(results.summary.lines)
    shown = [f"{label}: {lines[label]}" for label in (AGING_SAVED, "energy") if label in lines]
    heading = textwrap.wrap(results.prepared.heading, HEADING_COLUMNS)
    return "\n".join([*heading, *shown])


def _footer(results: RunResults) -> str:
    parts = [f"model {results.prepared.model.name}"]
    if math.isfinite(results.speed_up):
        mode = results.prepared.scenario.mode.replace("_", "-")
        parts.append(f"{mode} over ROS 2, {results.speed_up:.0f} × real time")
    return "; ".join(parts)
