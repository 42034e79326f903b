"""Speed of a string of vehicles over ROS 2 with recording: real processes and bags, driven by run_string."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.harness import run_benchmark
from iptm_core.errors import ScenarioError

TIMEOUT_S = 1800.0


def measure(
    scenario: str = "wltc", vehicles: int = 5, duration_s: float | None = None
) -> dict[str, Any]:
    """Drive a string in lock-step, every vehicle recorded.

    Args:
        scenario: shipped scenario or file.
        vehicles: number of vehicles.
        duration_s: length of the trip, None for that of the scenario.

    Returns:
        Trip time per wall time, and the processor time that one tick of one vehicle takes, start included.

    Raises:
        ScenarioError: the run fails.
    """
    options = [] if duration_s is None else ["--duration-s", str(duration_s)]
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "string"
        command = [sys.executable, "-m", "iptm_bringup.run_string", scenario, *options]
        done = subprocess.run(  # noqa: S603 - the project's own command
            [*command, "--vehicles", str(vehicles), "--output", str(output), "--no-picture"],
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
        files = sorted(output.glob("car_*/results.json"))
        if len(files) < vehicles:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise ScenarioError(f"scenario '{scenario}' ended with {done.returncode}: {last}")
        results = [json.loads(path.read_text(encoding="utf-8")) for path in files]
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    trip_s = max(float(each["metrics"]["duration_s"]) for each in results)
    wall_s = max(float(each["wall_time_s"]) for each in results)
    ticks = vehicles * trip_s
    return {
        "scenario": scenario,
        "vehicles": vehicles,
        "cores": len(os.sched_getaffinity(0)),
        "load_average": os.getloadavg()[0],
        "good": all(each["good"] for each in results),
        "trip_s": trip_s,
        "wall_s": wall_s,
        "times_real_time": trip_s / wall_s,
        "processor_ms_per_vehicle_second": 1e3 * (used.ru_utime + used.ru_stime) / ticks,
    }


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
