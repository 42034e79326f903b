"""Speed of the closed loop over ROS 2: real processes, driven by `iptm run`.

The cases alternate, so that other work on the machine affects all of them alike; ratios are to the first.
Processor time counts all processes, their start included.
"""

from __future__ import annotations

import json
import re
import resource
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import urllib.request
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from studies.speed.harness import run_benchmark, spread

from iptm_core.errors import ScenarioError
from iptm_core.markdown import table_of

ROOT = Path(__file__).resolve().parents[2]
CASES: dict[str, tuple[str, ...]] = {
    "recorded": (),
    "not recorded": ("--no-record",),
    "two browsers": ("--view",),
    "a browser that hangs": ("--view",),
    "string of five": ("--vehicles", "5"),
    "other checkout": (),
}
"""Options by case."""
USUAL = ("recorded", "not recorded")
_ADDRESS = re.compile(r"live view: (http://\S+)")
_START = 'source scripts/env.sh && exec python -m "$@"'


def _connect(case: str, url: str, stack: ExitStack) -> None:
    """Follow the page as two browsers that draw nothing, or as one that never reads."""
    if case == "a browser that hangs":
        parts = urlsplit(url)
        address = str(parts.hostname), int(parts.port or 80)
        client = stack.enter_context(socket.create_connection(address))
        client.sendall(f"GET /events HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n".encode())
        return

    def follow() -> None:
        try:
            with urllib.request.urlopen(f"{url}events") as answer:  # noqa: S310 - this machine
                while answer.read1(65536):
                    pass
        except OSError:
            pass  # the view has ended

    for _ in range(2):
        thread = threading.Thread(target=follow, daemon=True)
        thread.start()
        stack.callback(thread.join, 10.0)


def drive(scenario: str, duration_s: float | None, case: str, checkout: Path) -> dict[str, Any]:
    """Drive once by the command of a checkout; return times and outcomes."""
    options = ["--no-picture", "--against", "none", *CASES[case]]
    options += [] if duration_s is None else ["--duration-s", str(duration_s)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        output = Path(folder) / "run"
        command = ["bash", "-c", _START, "bash", "iptm.commands.run", scenario, *options]
        process = stack.enter_context(
            subprocess.Popen(  # noqa: S603 - the project's own command
                [*command, "--output", str(output)],
                cwd=checkout,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
        )
        printed = ""
        for line in process.stdout or ():
            printed += line
            if found := _ADDRESS.search(line):
                _connect(case, found[1], stack)
        process.wait()
        files = sorted(output.rglob("results.json"))
        if process.returncode or not files:
            raise ScenarioError(f"scenario '{scenario}' ended with {process.returncode}: {printed}")
        results = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    decisions = results[0]["metrics"]["decisions"]
    return {
        "vehicles": len(results),
        "good": all(each["good"] for each in results),
        "trip_s": max(each["metrics"]["duration_s"] for each in results),
        "wall_s": max(each["wall_time_s"] for each in results),
        "processor_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "solve_ms": {key: 1e3 * value for key, value in decisions["solve_time_s"].items()},
        "statuses": {name: count for name, count in decisions["by_status"].items() if count},
    }


def measure(
    scenario: str = "wltc",
    duration_s: float | None = None,
    repetitions: int = 1,
    case: tuple[str, ...] = USUAL,
    other: str = "",
) -> list[dict[str, Any]]:
    """Drive the cases in lock-step, in turn.

    Args:
        scenario: shipped scenario or file.
        duration_s: cut the trip, s.
        repetitions: runs of each case.
        case: what is compared, repeatable: see CASES.
        other: folder of the checkout of the case "other checkout", set up.

    Raises:
        ScenarioError: a case or the checkout is unknown, or a run fails.
    """
    if unknown := set(case) - set(CASES):
        raise ScenarioError(f"case is {sorted(unknown)}; allowed: {', '.join(CASES)}")
    if "other checkout" in case and not Path(other, "scripts", "env.sh").is_file():
        raise ScenarioError(f"other is '{other}'; allowed: a checkout that has been set up")
    runs: dict[str, list[dict[str, Any]]] = {name: [] for name in case}
    for _ in range(repetitions):
        for name, found in runs.items():
            checkout = Path(other).resolve() if name == "other checkout" else ROOT
            found.append(drive(scenario, duration_s, name, checkout))
    base = runs[case[0]]
    rows = []
    for name, found in runs.items():
        middle = {
            key: statistics.median(run[key] for run in found) for key in ("wall_s", "processor_s")
        }
        ratios = {
            f"{key[:-2]}_ratio": statistics.median(
                run[key] / first[key] for run, first in zip(found, base, strict=True)
            )
            for key in middle
        }
        row = {"scenario": scenario, "case": name, **found[-1], **middle, **ratios}
        row["good"] = all(run["good"] for run in found)
        row["times_real_time"] = row["trip_s"] / row["wall_s"]
        rows.append(row)
    return rows


def as_table(rows: list[dict[str, Any]]) -> str:
    """Return the table in Markdown."""
    columns = {
        "scenario": "{scenario}",
        "case": "{case}",
        "trip s:": "{trip_s:.0f}",
        "wall s:": "{wall_s:.1f}",
        "times real time:": "{times_real_time:.0f}",
        "processor s:": "{processor_s:.1f}",
        "wall / first case:": "{wall_ratio:.2f}",
        "processor / first case:": "{processor_ratio:.2f}",
        "solve median / p99 / max ms (wall):": spread("solve_ms", ".2f", "largest"),
        "solves by status": "{outcomes}",
        "good": "{good}",
    }
    shown = [
        {**row, "outcomes": ", ".join(f"{name} {n}" for name, n in row["statuses"].items())}
        for row in rows
    ]
    return table_of(shown, columns)


if __name__ == "__main__":
    sys.exit(run_benchmark(measure, text_of=as_table))
