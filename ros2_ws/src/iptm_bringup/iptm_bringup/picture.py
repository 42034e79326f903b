"""The picture of a run over ROS 2: that of the library, with the heading and the pace of the scenario."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path

from iptm.picture import HEADING_COLUMNS, run_picture
from iptm.run import Run
from iptm_bringup.evaluation import RunResults
from iptm_bringup.summary import AGING_SAVED
from iptm_core.decision_record import DecisionSeries


def save_picture(path: Path, results: RunResults) -> None:
    """Draw a run.

    Args:
        path: PNG file to write.
        results: of the run.
    """
    prepared, other = results.prepared, results.comparison
    model, slope = prepared.model.values, prepared.route.slope
    run = Run(prepared.heading, {}, model, results.trajectory, results.decisions, slope)
    against = (
        None
        if other is None
        else Run(other.strategy, {}, model, other.trajectory, DecisionSeries.from_records([], []))
    )
    picture = run_picture(run, against, _headline(results), _footer(results))
    picture.savefig(path, metadata={"Software": "iptm"}, pil_kwargs={"compress_level": 9})


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
