"""Speed of the headless closed loop, and where its time goes: solver, data and plan, plant, bridge."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from benchmarks.harness import PROPOSED, closed_loop, quantiles, run_benchmark, statuses, timed
from iptm_controller.controller import Controller
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.solvers.switching_check import SwitchingCheck
from iptm_controller.strategy import DEFAULT_STRATEGY
from iptm_core.decision_record import SolveStatus
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import run_closed_loop
from iptm_v2x_bridge.bridge import V2xBridge

PARTS: dict[str, tuple[type, str]] = {
    "decide": (Controller, "decide"),
    "solve": (SwitchingCheck, "solve"),
    "plant": (Plant, "advance"),
    "bridge": (V2xBridge, "answer"),
}


@contextmanager
def processor_clocks() -> Iterator[dict[str, list[float]]]:
    """Time every call of the parts on the processor while the context is open, in seconds."""
    times: dict[str, list[float]] = {name: [] for name in PARTS}
    originals = {name: getattr(owner, method) for name, (owner, method) in PARTS.items()}

    def clocked(call: Callable[..., Any], log: list[float]) -> Callable[..., Any]:
        def with_clock(*arguments: Any, **named: Any) -> Any:
            began = time.process_time()
            answer = call(*arguments, **named)
            log.append(time.process_time() - began)
            return answer

        return with_clock

    try:
        for name, (owner, method) in PARTS.items():
            setattr(owner, method, clocked(originals[name], times[name]))
        yield times
    finally:
        for name, (owner, method) in PARTS.items():
            setattr(owner, method, originals[name])


def measure(
    cycle: str = "comprehensive",
    horizon: str = PROPOSED,
    strategy: str = DEFAULT_STRATEGY,
    solver: str = "riccati",
    duration_s: float | None = None,
) -> dict[str, Any]:
    """Drive a trip and time it.

    Args:
        cycle: driving cycle.
        horizon: grid.
        strategy: strategy.
        solver: back end.
        duration_s: cut the trip, s.

    Raises:
        IptmError: a name is unknown or the set-up fails.
    """
    trip = closed_loop(cycle, horizon, strategy, SolverOptions(name=solver), duration_s)
    with processor_clocks() as times:
        run, elapsed = timed(lambda: run_closed_loop(*trip))
    parts = {name: float(np.sum(values)) for name, values in times.items()}
    seconds = {
        "solver": parts["solve"],
        "problem data, plan, limiter": parts["decide"] - parts["solve"],
        "plant": parts["plant"],
        "bridge": parts["bridge"],
        "rest": elapsed.processor_s - parts["decide"] - parts["plant"] - parts["bridge"],
    }
    log = run.decisions
    return {
        "cycle": cycle,
        "horizon": horizon,
        "strategy": strategy,
        "solver": solver,
        "ticks": len(log),
        "wall_s": elapsed.wall_s,
        "processor_s": elapsed.processor_s,
        "processor_share": {name: part / elapsed.processor_s for name, part in seconds.items()},
        "decision_ms": quantiles(1e3 * np.array(times["decide"])),
        "solve_total_s": parts["solve"],
        "solve_ms": quantiles(1e3 * np.array(times["solve"])),
        "solve_wall_ms": quantiles(1e3 * log.solve_time_s[np.isfinite(log.solve_time_s)]),
        "iterations": quantiles(log.iterations.astype(float)),
        "statuses": statuses(log),
        "fallback_ticks": int(np.count_nonzero(log.rung)),
        "unconverged": [
            {
                "tick": int(tick),
                "status": SolveStatus(int(log.status[tick])).name.lower(),
                "iterations": int(log.iterations[tick]),
            }
            for tick in np.flatnonzero(log.status != int(SolveStatus.SOLVED))[:20]
        ],
    }


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
