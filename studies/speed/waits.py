"""What a person waits for: the first tick of `scripts/run_demo`, its end, help, and reading a long bag."""

from __future__ import annotations

import json
import math
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from studies.speed.harness import machine_in_words, run_benchmark

from iptm_core.errors import ScenarioError
from iptm_core.markdown import table_of

ROOT = Path(__file__).resolve().parents[2]
HELPS = ("scripts/run_demo", "scripts/study", "scripts/setup", "scripts/test", "scripts/iptm")
SUB_COMMANDS = ("run", "info", "compare", "export", "view", "traffic", "check", "codegen", "param")
_TRIP_TIME = re.compile(rb"^\d+ of \d+ s ", re.MULTILINE)


_WITNESS = """
import json, resource, subprocess, sys
code = subprocess.call(sys.argv[1:])
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3]), file=sys.stderr)
sys.exit(code)
"""
"""Starts a command: the peak memory of a child is at least what its parent has."""


def call(command: Sequence[str]) -> dict[str, float]:
    """Run a command; return wall and processor time and first line of a trip in s, and peak memory in MB."""
    with tempfile.TemporaryFile() as errors:
        began_s, first_s, printed = time.monotonic(), math.nan, b""
        with subprocess.Popen(  # noqa: S603 - the project's own commands
            [sys.executable, "-c", _WITNESS, *command],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=errors,
        ) as process:
            assert process.stdout is not None  # noqa: S101  it is a pipe
            while part := os.read(process.stdout.fileno(), 65536):
                printed += part
                if math.isnan(first_s) and _TRIP_TIME.search(printed):
                    first_s = time.monotonic() - began_s
        wall_s = time.monotonic() - began_s
        errors.seek(0)
        *said, used = errors.read().decode().splitlines()
    if process.returncode:
        raise ScenarioError(f"{' '.join(command)}: {' '.join(said)}")
    processor_s, megabytes = json.loads(used)
    return {"wall": wall_s, "first": first_s, "processor": processor_s, "mb": megabytes}


def demo() -> dict[str, float]:
    """Run the demo; return the wait for its first tick and from its last one to the prompt, in s."""
    with tempfile.TemporaryDirectory() as folder:
        found = call(["scripts/run_demo", "--output", f"{folder}/run"])
        results = json.loads(Path(folder, "run", "results.json").read_text("utf-8"))
    return {**found, "last": found["wall"] - found["first"] - results["wall_time_s"]}


def measure(bag: str = "", repetitions: int = 3) -> list[dict[str, Any]]:
    """Time the waits.

    Args:
        bag: that is read and compared with itself, such as of ten hours.
        repetitions: runs of each, of which the median counts.
    """
    demos = [demo() for _ in range(repetitions)]
    rows = [
        {"what": f"`scripts/run_demo`, {what}", "s": statistics.median(run[key] for run in demos)}
        for what, key in (("first tick", "first"), ("from the last tick to the prompt", "last"))
    ]
    commands = {
        f"`{command} --help`": [*command.split(), "--help"]
        for command in (*HELPS, *(f"scripts/iptm {name}" for name in SUB_COMMANDS))
    }
    with tempfile.TemporaryDirectory() as folder:
        if bag:
            name, table = Path(bag).name, f"{folder}/table.parquet"
            commands |= {
                f"`iptm info` of `{name}`": ["scripts/iptm", "info", bag],
                f"`iptm export` of `{name}`": ["scripts/iptm", "export", bag, "--output", table],
                f"`iptm compare --exact` of `{name}`": ["scripts/iptm", "compare", "--exact", bag, bag],
            }  # fmt: skip
        for what, command in commands.items():
            runs = []
            for _ in range(repetitions):
                Path(folder, "table.parquet").unlink(missing_ok=True)
                runs.append(call(command))
            middle = {key: statistics.median(run[key] for run in runs) for key in runs[0]}
            rows.append({"what": what, "s": middle["wall"], **middle})
    return rows


def as_table(rows: list[dict[str, Any]]) -> str:
    """Return machine and table in Markdown."""
    columns = {"wait": "{what}", "s:": "{s:.2f}", "processor s:": "{used}", "peak MB:": "{memory}"}
    shown = [
        {
            **row,
            "used": f"{row['processor']:.2f}" if "processor" in row else "",
            "memory": f"{row['mb']:.0f}" if "mb" in row else "",
        }
        for row in rows
    ]
    return f"{machine_in_words()}\n\n{table_of(shown, columns)}"


if __name__ == "__main__":
    sys.exit(run_benchmark(measure, text_of=as_table))
