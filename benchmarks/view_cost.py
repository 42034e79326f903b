"""What the live view costs a run in lock-step: without it, with two browsers, with one that hangs.

The runs alternate, so that a slow moment of the machine hits all of them alike.
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
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from benchmarks.harness import run_benchmark
from iptm_core.errors import ScenarioError

_ADDRESS = re.compile(r"live view: (http://\S+)")
_READ_BYTES = 65536


def _browsers(url: str, stack: ExitStack) -> None:
    """Follow the page twice, as two browsers that draw nothing."""

    def follow() -> None:
        try:
            with urllib.request.urlopen(f"{url}events") as answer:  # noqa: S310 - this machine
                while answer.read1(_READ_BYTES):
                    pass
        except OSError:
            pass  # the view has ended

    for _ in range(2):
        thread = threading.Thread(target=follow, daemon=True)
        thread.start()
        stack.callback(thread.join, 10.0)


def _stalled_browser(url: str, stack: ExitStack) -> None:
    """Ask for the events and never read them."""
    parts = urlsplit(url)
    client = stack.enter_context(
        socket.create_connection((str(parts.hostname), int(parts.port or 80)))
    )
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.sendall(f"GET /events HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n".encode())


_CASES: dict[str, Callable[[str, ExitStack], None] | None] = {
    "no view": None,
    "view, two browsers": _browsers,
    "view, a browser that hangs": _stalled_browser,
}


def _drive(
    scenario: str, duration_s: float, connect: Callable[[str, ExitStack], None] | None
) -> dict[str, float]:
    """Drive once; return wall time of the trip and processor time of all processes, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        output = Path(folder) / "run"
        options = ["--mode", "lock_step", "--duration-s", str(duration_s), "--no-picture"]
        command = [sys.executable, "-m", "iptm_bringup.run_closed_loop", scenario, *options]
        command += ["--output", str(output), *([] if connect is None else ["--view"])]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)  # noqa: S603 - our own
        output = ""
        for line in process.stdout or ():
            output += line
            found = _ADDRESS.search(line)
            if found and connect is not None:
                connect(found.group(1), stack)
        if process.wait() != 0:
            raise ScenarioError(
                f"scenario {scenario!r} ended with {process.returncode}: {output[-200:]}"
            )
        wall_s = json.loads((output / "results.json").read_text(encoding="utf-8"))["wall_time_s"]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"wall_s": wall_s, "processor_s": used_s}


def measure(
    scenario: str = "wltc", duration_s: float = 600.0, repetitions: int = 5
) -> list[dict[str, Any]]:
    """Drive the cases in turn.

    Args:
        scenario: scenario.
        duration_s: length of the trip, s.
        repetitions: runs of each case.

    Raises:
        ScenarioError: a run fails.
    """
    runs: dict[str, list[dict[str, float]]] = {case: [] for case in _CASES}
    for _ in range(repetitions):
        for case, connect in _CASES.items():
            runs[case].append(_drive(scenario, duration_s, connect))
    base = runs["no view"]
    results = []
    for case, found in runs.items():
        walls = [run["wall_s"] for run in found]
        ratios = [run["wall_s"] / other["wall_s"] for run, other in zip(found, base, strict=True)]
        results.append(
            {
                "case": case,
                "wall_s": {"median": statistics.median(walls), "least": min(walls)},
                "processor_s": statistics.median(run["processor_s"] for run in found),
                "wall_against_no_view": {
                    "median": statistics.median(ratios),
                    "least": min(walls) / min(run["wall_s"] for run in base),
                },
            }
        )
    return results


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
