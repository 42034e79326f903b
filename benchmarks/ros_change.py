"""What a change does to the speed of the closed loop over ROS 2: this checkout against another one, in turn.

Runs alternate, so that other work on the machine hits both alike. Processor time is that of all processes,
their start included; it is more reliable than wall time on a busy machine.
"""

from __future__ import annotations

import json
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.harness import run_benchmark
from iptm_core.errors import ScenarioError

ROOT = Path(__file__).resolve().parents[1]
TIMEOUT_S = 900.0
_RUN = 'source scripts/env.sh && exec python -m iptm_bringup.run_closed_loop "$@"'


def _drive(checkout: Path, scenario: str, duration_s: float) -> dict[str, float]:
    """Drive once, recorded, by the command of a checkout; return wall time of the trip and processor time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "run"
        options = ["--mode", "lock_step", "--duration-s", str(duration_s), "--against", "none"]
        command = ["bash", "-c", _RUN, "bash", scenario, *options]
        done = subprocess.run(  # noqa: S603 - the project's own command
            [*command, "--no-picture", "--output", str(output)],
            capture_output=True,
            text=True,
            cwd=checkout,
            timeout=TIMEOUT_S,
            check=False,
        )
        if done.returncode != 0:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise ScenarioError(f"scenario {scenario!r} ended with {done.returncode}: {last}")
        wall_s = json.loads((output / "results.json").read_text(encoding="utf-8"))["wall_time_s"]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"wall_s": wall_s, "processor_s": used_s}


def measure(
    other: str, scenario: str = "wltc", duration_s: float = 900.0, repetitions: int = 5
) -> list[dict[str, Any]]:
    """Drive both checkouts in turn.

    Args:
        other: folder of the other checkout, set up.
        scenario: scenario.
        duration_s: length of the trip, s.
        repetitions: runs of each.

    Raises:
        ScenarioError: the checkout is missing, or a run fails.
    """
    checkouts = {"other": Path(other).resolve(), "this": ROOT}
    if not (checkouts["other"] / "scripts" / "env.sh").is_file():
        raise ScenarioError(f"other is {other!r}; allowed: a checkout that has been set up")
    runs: dict[str, list[dict[str, float]]] = {name: [] for name in checkouts}
    for _ in range(repetitions):
        for name, checkout in checkouts.items():
            runs[name].append(_drive(checkout, scenario, duration_s))
    results: list[dict[str, Any]] = []
    for name, found in runs.items():
        result: dict[str, Any] = {"checkout": name, "runs": len(found)}
        for key in ("wall_s", "processor_s"):
            ratios = [
                run[key] / against[key] for run, against in zip(found, runs["other"], strict=True)
            ]
            values = [run[key] for run in found]
            result[key] = {"median": statistics.median(values), "least": min(values)}
            result[f"{key[:-2]}_ratio"] = statistics.median(ratios)
        results.append(result)
    return results


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
