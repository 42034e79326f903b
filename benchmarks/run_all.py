"""Runs the benchmarks one after the other and writes docs/solver-benchmarks.md from their numbers.

Each part is a process of its own, so that none inherits the memory or threads of another. Numbers of
parts that are not run again are kept from the last time.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks import (
    closed_loop_equivalence,
    closed_loop_speed,
    deadline_under_load,
    node_scaling,
    ros_speed,
)
from benchmarks.compare_solvers import compare
from benchmarks.contenders import CONTENDER_NAMES
from benchmarks.harness import (
    PROPOSED,
    SINGLE,
    WITH_THERMAL_PHASE,
    machine_description,
    write_numbers,
)
from benchmarks.page import write_page
from benchmarks.record_problems import ProblemSet, record_problems
from benchmarks.targets import REFERENCE
from iptm_controller.strategy import DEFAULT_STRATEGY
from iptm_core.errors import IptmError

ROOT = Path(__file__).resolve().parents[1]
NUMBERS = ROOT / "benchmarks" / "results"
PAGE = ROOT / "docs" / "solver-benchmarks.md"
CYCLES = ("wltc_class3b", "comprehensive")
# Grid to the contenders that are of use on it; dense QP solvers are not on long ones.
SHORT, LONG = (PROPOSED, SINGLE), ("5x1+20x5", "60x1")
LONG_CONTENDERS = tuple(
    name for name in CONTENDER_NAMES if name not in {"sqp_daqp", "riccati_interpreted"}
)
GRIDS = {**dict.fromkeys(SHORT, CONTENDER_NAMES), **dict.fromkeys(LONG, LONG_CONTENDERS)}


def _say(text: str) -> None:
    print(f"benchmark: {text}", file=sys.stderr, flush=True)


def _comparisons(*, quick: bool) -> dict[str, Any]:
    """Compare both cycles on the paper's grids, the comprehensive one on the long grids."""
    numbers = {}
    for cycle in CYCLES:
        for grid, contenders in GRIDS.items():
            long = grid in LONG
            if long and cycle != "comprehensive":
                continue
            problems = _recorded(cycle, grid, quick=quick, long=long)
            blocks = (3 if quick else 6) if long else (5 if quick else 15)
            _say(f"comparing on {cycle}, {grid}")
            numbers[f"{cycle}, {DEFAULT_STRATEGY}, {problems.horizon}"] = compare(
                problems, contenders, blocks, 10 if long else 20, 10 if long else 5
            )
            write_numbers(NUMBERS / "comparisons.json", numbers)  # so that a stop loses little
    return numbers


def _recorded(cycle: str, grid: str, *, quick: bool, long: bool) -> ProblemSet:
    count = 300 if quick or long else None
    first = 1250 if long else 0
    path = NUMBERS / f"problems_{cycle}_{grid}_{first}_{count}.npz"
    if path.is_file():
        return ProblemSet.load(path)
    _say(f"recording {cycle}, {grid}")
    problems = record_problems(cycle, DEFAULT_STRATEGY, grid, first, count)
    problems.save(path)
    return problems


def _start_up(*, quick: bool) -> dict[str, Any]:
    from benchmarks.start_up import measure  # noqa: PLC0415 - the only part that needs rclpy here

    return measure(2 if quick else 4, 1)


PARTS: dict[str, Callable[..., Any]] = {
    "comparisons": _comparisons,
    "scaling": lambda *, quick: node_scaling.measure(
        node_scaling.GRIDS[: 4 if quick else 5], count=4 if quick else 6
    ),
    "loops": lambda *, quick: [
        closed_loop_speed.measure(cycle, grid, strategy, duration_s=300.0 if quick else None)
        for cycle in CYCLES
        for grid, strategy in (
            (PROPOSED, DEFAULT_STRATEGY),
            (WITH_THERMAL_PHASE, DEFAULT_STRATEGY),
            (SINGLE, DEFAULT_STRATEGY),
            (SINGLE, REFERENCE),
        )
    ],
    "equivalence": lambda *, quick: [
        closed_loop_equivalence.measure(cycle, duration_s=300.0 if quick else None)
        for cycle in CYCLES
    ],
    "ros": lambda *, quick: ros_speed.measure(duration_s=300.0 if quick else None),
    "start_up": _start_up,
    "deadline": lambda *, quick: deadline_under_load.measure(100 if quick else 300),
}


def _run_part(part: str, *, quick: bool) -> bool:
    """Run one part in a process of its own; True if it succeeded."""
    command = [sys.executable, "-m", "benchmarks.run_all", "--inside", part]
    began = time.monotonic()
    _say(f"{part} ...")
    done = subprocess.run([*command, *(["--quick"] if quick else [])], check=False)  # noqa: S603
    _say(f"{part}: {time.monotonic() - began:.0f} s, exit code {done.returncode}")
    return done.returncode == 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all or some parts; returns the exit code."""
    parser = argparse.ArgumentParser(prog="benchmark", description=__doc__)
    parser.add_argument(
        "--only", action="append", choices=PARTS, help="run only these parts; repeatable"
    )
    parser.add_argument("--quick", action="store_true", help="short trips, for a first look")
    parser.add_argument("--page-only", action="store_true", help="run nothing, write the page")
    parser.add_argument("--page", type=Path, default=PAGE, help="page to write (%(default)s)")
    parser.add_argument("--inside", choices=PARTS, help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.inside is not None:
        try:
            numbers = PARTS[given.inside](quick=given.quick)
        except IptmError as error:
            print(f"benchmark: {given.inside}: {error}", file=sys.stderr)
            return 2
        write_numbers(NUMBERS / f"{given.inside}.json", numbers)
        return 0
    failed = []
    if not given.page_only:
        write_numbers(NUMBERS / "machine.json", machine_description())
        failed = [part for part in given.only or PARTS if not _run_part(part, quick=given.quick)]
    for target in write_page(NUMBERS, given.page):
        print(f"{target.verdict:>6}  {target.text}: {target.measured}")
    if failed:
        print(f"benchmark: failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
