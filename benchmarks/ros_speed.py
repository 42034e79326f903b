"""Speed of the closed loop over ROS 2 with recording: real processes, real bag, driven by run_closed_loop."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.harness import run_benchmark
from iptm_core.errors import ScenarioError

TIMEOUT_S = 900.0


def drive(scenario: str, options: Sequence[str]) -> dict[str, Any]:
    """Drive a scenario and read its results.

    Args:
        scenario: shipped scenario or file.
        options: further options of ``run_closed_loop``.

    Returns:
        The document of ``results.json``.

    Raises:
        ScenarioError: the run fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "run"
        command = [sys.executable, "-m", "iptm_bringup.run_closed_loop", scenario]
        done = subprocess.run(  # noqa: S603 - the project's own command
            [*command, "--output", str(output), "--no-picture", *options],
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
        path = output / "results.json"
        if not path.is_file():
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise ScenarioError(f"scenario '{scenario}' ended with {done.returncode}: {last}")
        document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return document


def solves(results: dict[str, Any]) -> dict[str, Any]:
    """Return times in ms and outcomes of the solves of a run, from its results."""
    decisions = results["metrics"]["decisions"]
    times_s = decisions["solve_time_s"]
    counted = {name: count for name, count in decisions["by_status"].items() if count}
    spread = {key: 1e3 * times_s[key] for key in ("median", "p99", "largest")}
    return {"solve_time_ms": spread, "statuses": counted}


def measure(scenario: str = "wltc", duration_s: float | None = None) -> list[dict[str, Any]]:
    """Drive in lock-step with and without recording.

    Args:
        scenario: scenario.
        duration_s: cut the trip, s.

    Raises:
        ScenarioError: a run fails.
    """
    cut = [] if duration_s is None else ["--duration-s", str(duration_s)]
    runs = []
    for record in (True, False):
        results = drive(scenario, cut if record else [*cut, "--no-record"])
        runs.append(
            {
                "scenario": scenario,
                "recorded": record,
                "good": results["good"],
                "problems": results["problems"],
                "trip_s": results["metrics"]["duration_s"],
                "wall_s": results["wall_time_s"],
                "speed_up": results["speed_up"],
                **solves(results),
            }
        )
    return runs


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
