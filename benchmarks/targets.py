"""The targets of the project for solver and closed loop, each judged by what was measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from iptm_controller.solvers.interface import RICCATI

PROPOSED = "3x1+5x5"
SINGLE = "15x1"
REFERENCE = "reference"
DEFAULT_SOLVER = RICCATI
PEER = "peer_plain"
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
    judges: list[tuple[str, Callable[[dict[str, Any]], tuple[str, bool] | None]]] = [
        ("MH 3+5: at least 20 times faster than plain CasADi + IPOPT, median and p99", _peer),
        ("MH 3+5: median of a solve at most 1 ms, p99 below 5 ms", _median),
        ("no solve over 20 ms", _longest),
        ("unconverged solves below 1 in 10 000", _unconverged),
        (
            "MH 3+5 at no more than half the time of the reference on SH 15, all solves of a trip",
            _half,
        ),
        ("headless comprehensive cycle (10 000 ticks) in under 30 s", _headless),
        ("over ROS 2 with recording at least 200 times real time", _ros),
        ("cost linear in the number of nodes up to 1000", _linear),
        ("energy and degradation within 0.1 % of the reference solver", _equivalent),
        ("first command within 3 s of process start, warm cache", _start),
        ("no overrun in real time with two busy processes", _overruns),
    ]
    reached = []
    for text, judge in judges:
        verdict = judge(found)
        measured, met = (NOT_MEASURED, None) if verdict is None else verdict
        reached.append(Target(text, measured, met))
    return reached


def _row(found: dict[str, Any], grid: str, name: str) -> list[tuple[str, dict[str, Any]]]:
    """Return the rows of a contender on a grid, with the cycle they belong to."""
    rows = []
    for title, summaries in (found.get("comparisons") or {}).items():
        cycle, _, horizon = title.split(", ")
        if horizon == grid:
            rows += [(cycle, row) for row in summaries if row["name"] == name]
    return rows


def _peer(found: dict[str, Any]) -> tuple[str, bool] | None:
    rows = _row(found, PROPOSED, DEFAULT_SOLVER)
    if not rows or any(row["peer_by_median"] is None for _, row in rows):
        return None
    said = "; ".join(
        f"{cycle}: {row['peer_by_median']:.1f} and {row['peer_by_p99']:.1f}" for cycle, row in rows
    )
    met = all(min(row["peer_by_median"], row["peer_by_p99"]) >= 20.0 for _, row in rows)
    return said, met


def _loop(found: dict[str, Any], grid: str) -> list[dict[str, Any]]:
    return [run for run in found.get("loops") or [] if run["horizon"] == grid]


def _median(found: dict[str, Any]) -> tuple[str, bool] | None:
    runs = _loop(found, PROPOSED)
    if not runs:
        return None
    said = "; ".join(
        f"{run['cycle']}: {run['solve_ms']['median']:.2f} and {run['solve_ms']['p99']:.2f} ms"
        for run in runs
    )
    return said, all(r["solve_ms"]["median"] <= 1.0 and r["solve_ms"]["p99"] < 5.0 for r in runs)


def _longest(found: dict[str, Any]) -> tuple[str, bool] | None:
    runs = _loop(found, PROPOSED)
    if not runs:
        return None
    longest = max(run["solve_ms"]["max"] for run in runs)
    wall = max(run["solve_wall_ms"]["max"] for run in runs)
    return f"{longest:.1f} ms of the processor ({wall:.1f} ms on the wall)", longest <= 20.0


def _unconverged(found: dict[str, Any]) -> tuple[str, bool] | None:
    runs = _loop(found, PROPOSED)
    if not runs:
        return None
    ticks = sum(run["ticks"] for run in runs)
    bad = ticks - sum(run["statuses"].get("solved", 0) for run in runs)
    return f"{bad} of {ticks}", bad * 10_000 < ticks


def _half(found: dict[str, Any]) -> tuple[str, bool] | None:
    """Judge the computing time as in the paper: all solves of a trip, against the reference on SH 15."""
    singles = {
        (run["cycle"], run["strategy"]): run["solve_total_s"] for run in _loop(found, SINGLE)
    }
    said, shares = [], []
    for run in _loop(found, PROPOSED):
        reference = singles.get((run["cycle"], REFERENCE))
        same = singles.get((run["cycle"], run["strategy"]))
        if reference is None or same is None:
            continue
        total = run["solve_total_s"]
        shares.append(total / reference)
        said.append(f"{run['cycle']}: {shares[-1]:.2f} (of aging on SH 15: {total / same:.2f})")
    return ("; ".join(said), max(shares) <= 0.5) if shares else None


def _headless(found: dict[str, Any]) -> tuple[str, bool] | None:
    runs = [run for run in _loop(found, PROPOSED) if run["ticks"] >= 10_000]
    if not runs:
        return None
    wall, processor = runs[0]["wall_s"], runs[0]["processor_s"]
    return f"{wall:.1f} s on the wall, {processor:.1f} s of the processor", wall < 30.0


def _ros(found: dict[str, Any]) -> tuple[str, bool] | None:
    runs = [run for run in found.get("ros") or [] if run["recorded"]]
    if not runs:
        return None
    slowest = min(run["speed_up"] for run in runs)
    return f"{slowest:.0f} times", slowest >= 200.0


def _linear(found: dict[str, Any]) -> tuple[str, bool] | None:
    fit = ((found.get("scaling") or {}).get("fits") or {}).get(DEFAULT_SOLVER)
    if not fit or fit["exponent"] != fit["exponent"]:
        return None
    said = f"time per iteration grows as nodes^{fit['exponent']:.2f} from 60 nodes on"
    return said, abs(fit["exponent"] - 1.0) < 0.15


def _equivalent(found: dict[str, Any]) -> tuple[str, bool] | None:
    runs = found.get("equivalence")
    if not runs:
        return None
    worst = max(run["largest_relative_change"] for run in runs)
    return f"{100 * worst:.4f} %", worst <= 1e-3


def _start(found: dict[str, Any]) -> tuple[str, bool] | None:
    warm = (found.get("start_up") or {}).get("warm")
    if not warm:
        return None
    slowest = warm["first_command_max_s"]
    return f"{warm['first_command_median_s']:.2f} s, slowest {slowest:.2f} s", slowest <= 3.0


def _overruns(found: dict[str, Any]) -> tuple[str, bool] | None:
    loaded = [
        run for run in (found.get("deadline") or {}).get("headless", []) if run["busy_processes"]
    ]
    if not loaded:
        return None
    run = loaded[0]
    said = f"{run['overruns']} of {run['ticks']} ticks on a schedule of {run['period_ms']:.0f} ms"
    return said, run["overruns"] == 0
