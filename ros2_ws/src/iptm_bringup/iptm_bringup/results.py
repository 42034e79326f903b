"""The outcome of a run as data: figures, limits, and whether all of it can be trusted."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

from iptm_bringup.scenario import Scenario
from iptm_bringup.scenario_files import scenario_text
from iptm_core.metrics import FIGURES, RunMetrics, figure_values


@dataclass(frozen=True)
class RunResults:
    """Everything there is to say about a finished run.

    Attributes:
        scenario: what was driven.
        metrics: what the run achieved, from the bag if there is one.
        wall_time_s: from the first to the last clock.
        bag_messages: messages in the bag by topic, None without a bag.
        problems: why the run does not count as good, empty if it does.
        warnings: what the nodes complained about while it ran.
        information: revision, versions and time of the start, by name.
    """

    scenario: Scenario
    metrics: RunMetrics
    wall_time_s: float
    bag_messages: Mapping[str, int] | None
    problems: tuple[str, ...]
    warnings: tuple[str, ...]
    information: Mapping[str, str]

    @property
    def speed_up(self) -> float:
        """Trip time per wall time."""
        return self.metrics.duration_s / self.wall_time_s if self.wall_time_s > 0.0 else math.nan


def results_json(results: RunResults) -> str:
    """Return results as JSON text; what is unknown (NaN) becomes null."""
    metrics = results.metrics
    values = figure_values(metrics)
    document = {
        "scenario": results.scenario.name,
        "scenario_file": scenario_text(results.scenario),
        "good": not results.problems,
        "problems": list(results.problems),
        "warnings": list(results.warnings),
        "rows": [
            {"key": key, "label": figure.label, "value": values.get(key), "unit": figure.unit}
            for key, figure in FIGURES.items()
        ],
        "metrics": asdict(metrics),
        "wall_time_s": results.wall_time_s,
        "speed_up": results.speed_up,
        "bag_messages": results.bag_messages,
        "information": dict(results.information),
    }
    return json.dumps(_plain(document), indent=2, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    """Return a value with everything that JSON does not know replaced."""
    if isinstance(value, Mapping):
        return {_name(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _name(key: object) -> str:
    return key.name.lower() if isinstance(key, Enum) else str(key)
