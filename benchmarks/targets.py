"""The targets of the project for solver and closed loop, each judged by what was measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from benchmarks.harness import PROPOSED, SINGLE, WITH_THERMAL_PHASE
from iptm_controller.solvers.interface import RICCATI

REFERENCE = "reference"
DEFAULT_SOLVER = RICCATI
NOT_MEASURED = "not measured"


@dataclass(frozen=True)
class Target:
    """One target.

    Attributes:
        text: what is asked for.
        measured: what was found, in words.
        met: None if it was not measured.
    """

    text: str
    measured: str
    met: bool | None

    @property
    def verdict(self) -> str:
        """One word."""
        return "-" if self.met is None else ("yes" if self.met else "**no**")


def targets(found: dict[str, Any]) -> list[Target]:
    """Judge everything that was measured.

    Args:
        found: numbers of the benchmarks by name.
    """
    compared = [
        {**row, "cycle": cycle}
        for cycle, row in _rows(found, PROPOSED)
        if row["name"] == DEFAULT_SOLVER and row["peer_by_median"] is not None
    ]
    loops = found.get("loops") or []
    driven = [run for run in loops if run["horizon"] == PROPOSED]
    fit = ((found.get("scaling") or {}).get("fits") or {}).get(DEFAULT_SOLVER, {})
    warm = (found.get("start_up") or {}).get("warm")
    paced = (found.get("deadline") or {}).get("headless", [])
    judged: list[tuple[str, list[Any], Callable[[list[Any]], tuple[str, bool]]]] = [
        (
            "MH 3+5: at least 20 times faster than plain CasADi + IPOPT, median and p99",
            compared,
            _peer,
        ),
        (
            "MH 3+5: median of a solve at most 0.5 ms, p99 at most 2 ms",
            driven,
            partial(_solve_times, median_ms=0.5, p99_ms=2.0),
        ),
        (
            "with a thermal phase (10 x 30 s) behind it: at most 1.5 ms and 5 ms",
            [run for run in loops if run["horizon"] == WITH_THERMAL_PHASE],
            partial(_solve_times, median_ms=1.5, p99_ms=5.0),
        ),
        ("no solve over 20 ms", driven, _longest),
        ("unconverged solves below 1 in 10 000", driven, _unconverged),
        (
            "MH 3+5 at no more than half the time of the reference on SH 15, all solves of a trip",
            _solving_times(loops),
            _half,
        ),
        (
            "headless comprehensive cycle (10 000 ticks) in under 30 s",
            [run for run in driven if run["ticks"] >= 10_000],
            _headless,
        ),
        (
            "over ROS 2 with recording at least 200 times real time",
            [run for run in found.get("ros") or [] if run["recorded"]],
            _ros,
        ),
        (
            "cost linear in the number of nodes up to 1000",
            [fit["exponent"]] if math.isfinite(fit.get("exponent", math.nan)) else [],
            _linear,
        ),
        (
            "energy and degradation within 0.1 % of the reference solver",
            found.get("equivalence") or [],
            _equivalent,
        ),
        ("first command within 3 s of process start, warm cache", [warm] if warm else [], _start),
        (
            "no overrun in real time with two busy processes",
            [run for run in paced if run["busy_processes"]],
            _overruns,
        ),
    ]
    return [
        Target(text, *(judge(rows) if rows else (NOT_MEASURED, None)))
        for text, rows, judge in judged
    ]


def _rows(found: dict[str, Any], grid: str) -> list[tuple[str, dict[str, Any]]]:
    """Return the rows of the comparison on a grid, with the cycle they belong to."""
    rows = []
    for title, summaries in (found.get("comparisons") or {}).items():
        cycle, _, horizon = title.split(", ")
        if horizon == grid:
            rows += [(cycle, row) for row in summaries]
    return rows


def _solving_times(loops: Sequence[dict[str, Any]]) -> list[tuple[str, float, float]]:
    """Return cycle and computing time on the proposed grid over that of the reference and itself on SH 15.

    The computing time is that of the paper: all solves of a trip.
    """
    total_s = {
        (run["cycle"], run["strategy"], run["horizon"]): run["solve_total_s"] for run in loops
    }
    shares = []
    for (cycle, strategy, horizon), own_s in total_s.items():
        reference_s = total_s.get((cycle, REFERENCE, SINGLE))
        same_s = total_s.get((cycle, strategy, SINGLE))
        if horizon == PROPOSED and reference_s is not None and same_s is not None:
            shares.append((cycle, own_s / reference_s, own_s / same_s))
    return shares


def _peer(rows: list[Any]) -> tuple[str, bool]:
    text = "; ".join(
        f"{row['cycle']}: {row['peer_by_median']:.1f} and {row['peer_by_p99']:.1f}" for row in rows
    )
    return text, all(min(row["peer_by_median"], row["peer_by_p99"]) >= 20.0 for row in rows)


def _solve_times(runs: list[Any], median_ms: float, p99_ms: float) -> tuple[str, bool]:
    text = "; ".join(
        f"{run['cycle']}: {run['solve_ms']['median']:.2f} and {run['solve_ms']['p99']:.2f} ms"
        for run in runs
    )
    spans = [run["solve_ms"] for run in runs]
    return text, all(span["median"] <= median_ms and span["p99"] <= p99_ms for span in spans)


def _longest(runs: list[Any]) -> tuple[str, bool]:
    longest = max(run["solve_ms"]["max"] for run in runs)
    wall = max(run["solve_wall_ms"]["max"] for run in runs)
    return f"{longest:.1f} ms of the processor ({wall:.1f} ms on the wall)", longest <= 20.0


def _unconverged(runs: list[Any]) -> tuple[str, bool]:
    ticks = sum(run["ticks"] for run in runs)
    bad = ticks - sum(run["statuses"].get("solved", 0) for run in runs)
    return f"{bad} of {ticks}", bad * 10_000 < ticks


def _half(shares: list[Any]) -> tuple[str, bool]:
    text = "; ".join(
        f"{cycle}: {share:.2f} (of itself on SH 15: {same:.2f})" for cycle, share, same in shares
    )
    return text, max(share for _, share, _ in shares) <= 0.5


def _headless(runs: list[Any]) -> tuple[str, bool]:
    wall, processor = runs[0]["wall_s"], runs[0]["processor_s"]
    return f"{wall:.1f} s on the wall, {processor:.1f} s of the processor", wall < 30.0


def _ros(runs: list[Any]) -> tuple[str, bool]:
    slowest = min(run["speed_up"] for run in runs)
    return f"{slowest:.0f} times", slowest >= 200.0


def _linear(exponents: list[Any]) -> tuple[str, bool]:
    text = f"time per iteration grows as nodes^{exponents[0]:.2f} from 60 nodes on"
    return text, abs(exponents[0] - 1.0) < 0.15


def _equivalent(runs: list[Any]) -> tuple[str, bool]:
    worst = max(run["largest_relative_change"] for run in runs)
    return f"{100 * worst:.4f} %", worst <= 1e-3


def _start(starts: list[Any]) -> tuple[str, bool]:
    slowest = starts[0]["first_command_max_s"]
    text = f"{starts[0]['first_command_median_s']:.2f} s, slowest {slowest:.2f} s"
    return text, slowest <= 3.0


def _overruns(runs: list[Any]) -> tuple[str, bool]:
    run = runs[0]
    text = f"{run['overruns']} of {run['ticks']} ticks on a schedule of {run['period_ms']:.0f} ms"
    return text, run["overruns"] == 0
