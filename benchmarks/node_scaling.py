"""How the cost of a solve grows with the number of nodes: 8 to 1000, steps of 1 s beyond the paper's grids.

Each grid drives its own closed loop for some ticks of the same stretch of road; its problems are then
replayed. The time per iteration is fitted by a straight line through all grids of 1 s steps.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.contenders import build_contender
from benchmarks.harness import run_benchmark
from benchmarks.record_problems import record_problems
from iptm_controller.horizon import Horizon
from iptm_controller.strategy import DEFAULT_STRATEGY
from iptm_core.parameters import load_parameters

GRIDS = ("15x1", "60x1", "200x1", "500x1", "1000x1")
CYCLE = "wltc_class3b"
FIRST_TICK = 200
SOLVERS = ("riccati", "fatrop", "ipopt")


def measure(
    grids: tuple[str, ...] = GRIDS, solvers: tuple[str, ...] = SOLVERS, count: int = 15
) -> dict[str, Any]:
    """Record and replay every grid.

    Args:
        grids: grids of 1 s steps, repeatable.
        solvers: contenders, repeatable.
        count: problems per grid.

    Returns:
        Rows per grid and solver, and the straight line per solver.

    Raises:
        IptmError: a name is unknown or a set-up fails.
    """
    parameters = load_parameters().values
    rows: list[dict[str, Any]] = []
    for grid in grids:
        problems = record_problems(CYCLE, DEFAULT_STRATEGY, grid, FIRST_TICK, count)
        horizon = Horizon.parse(grid)
        for name in solvers:
            contender = build_contender(name, horizon, parameters)
            outcomes = [contender.solve(*problems.problem(i)) for i in range(len(problems))]
            # The first problem starts cold, and the caches are cold as well.
            kept = outcomes[1:] or outcomes
            times = 1e3 * np.array([outcome.elapsed.processor_s for outcome in kept])
            iterations = np.array([outcome.result.iterations for outcome in kept])
            rows.append(
                {
                    "solver": name,
                    "grid": grid,
                    "nodes": horizon.steps,
                    "problems": len(kept),
                    "median_ms": float(np.median(times)),
                    "max_ms": float(times.max()),
                    "iterations": float(np.median(iterations)),
                    "ms_per_iteration": float(np.median(times / np.maximum(iterations, 1))),
                    "unconverged": sum(not outcome.converged for outcome in kept),
                }
            )
            print(f"{grid} {name}: {rows[-1]['median_ms']:.2f} ms", file=sys.stderr)
    return {"rows": rows, "fits": {name: _fit(rows, name) for name in solvers}}


def _fit(rows: Sequence[dict[str, Any]], solver: str) -> dict[str, float]:
    """Fit a straight line and a power law to the time per iteration over the nodes."""
    own = [row for row in rows if row["solver"] == solver]
    nodes = np.array([row["nodes"] for row in own], dtype=float)
    times = np.array([row["ms_per_iteration"] for row in own])
    if nodes.size < 2:
        return {"offset_ms": float("nan"), "per_node_us": float("nan"), "exponent": float("nan")}
    # Relative residuals: small grids count as much as large ones.
    weights = 1.0 / times
    slope, offset = np.polyfit(nodes, times, 1, w=weights)
    large = nodes >= 60
    exponent = (
        np.polyfit(np.log(nodes[large]), np.log(times[large]), 1)[0]
        if np.count_nonzero(large) > 1
        else float("nan")
    )
    worst = float(np.max(np.abs(offset + slope * nodes - times) / times))
    return {
        "offset_ms": float(offset),
        "per_node_us": float(1e3 * slope),
        "largest_relative_residual": worst,
        "exponent": float(exponent),
    }


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
