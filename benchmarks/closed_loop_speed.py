"""Speed of the headless closed loop, and where its time goes: solver, data and plan, plant, bridge."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from benchmarks.report_files import quantiles, run_benchmark
from iptm_controller.controller import Controller, ControllerOptions
from iptm_controller.horizon import Horizon
from iptm_controller.solvers.cooling_probe import CoolingProbe
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.strategy import strategy_by_name
from iptm_core.decision_record import SolveStatus
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import run_closed_loop
from iptm_v2x_bridge.bridge import V2xBridge

PARTS: dict[str, tuple[type, str]] = {
    "decide": (Controller, "decide"),
    "solve": (CoolingProbe, "solve"),
    "plant": (Plant, "advance"),
    "bridge": (V2xBridge, "answer"),
}


@contextmanager
def processor_clocks() -> Iterator[dict[str, list[float]]]:
    """Time every call of the parts on the processor while the context is open, in seconds."""
    times: dict[str, list[float]] = {name: [] for name in PARTS}
    originals = {name: getattr(owner, method) for name, (owner, method) in PARTS.items()}

    def clocked(call: Callable[..., Any], log: list[float]) -> Callable[..., Any]:
        def timed(*arguments: Any, **named: Any) -> Any:
            began = time.process_time()
            answer = call(*arguments, **named)
            log.append(time.process_time() - began)
            return answer

        return timed

    try:
        for name, (owner, method) in PARTS.items():
            setattr(owner, method, clocked(originals[name], times[name]))
        yield times
    finally:
        for name, (owner, method) in PARTS.items():
            setattr(owner, method, originals[name])


def measure(
    cycle: str, horizon: str, strategy: str, solver: str, duration_s: float | None
) -> dict[str, Any]:
    """Drive a trip and time it.

    Raises:
        IptmError: a name is unknown or the set-up fails.
    """
    parameters = load_parameters().values
    route = build_route(cycle, initial_gap_m=parameters.gap.initial_gap_m, duration_s=duration_s)
    options = ControllerOptions(
        strategy=strategy_by_name(strategy),
        horizon=Horizon.parse(horizon),
        solver=SolverOptions(name=solver),
    )
    controller = Controller(parameters, options)
    plant = Plant(parameters, route.slope.slope_at)
    with processor_clocks() as times:
        wall, processor = time.perf_counter(), time.process_time()
        run = run_closed_loop(route, plant, controller)
        wall_s, processor_s = time.perf_counter() - wall, time.process_time() - processor
    parts = {name: float(np.sum(values)) for name, values in times.items()}
    log = run.decisions
    names = {int(status): status.name.lower() for status in SolveStatus}
    statuses = Counter(names.get(int(code), "none") for code in log.status)
    solves = 1e3 * np.array(times["solve"])
    return {
        "cycle": cycle,
        "horizon": horizon,
        "strategy": strategy,
        "solver": solver,
        "ticks": int(log.status.size),
        "wall_s": wall_s,
        "processor_s": processor_s,
        "processor_share": {
            "solver": parts["solve"] / processor_s,
            "problem data, plan, limiter": (parts["decide"] - parts["solve"]) / processor_s,
            "plant": parts["plant"] / processor_s,
            "bridge": parts["bridge"] / processor_s,
            "rest": (processor_s - parts["decide"] - parts["plant"] - parts["bridge"])
            / processor_s,
        },
        "decision_ms": quantiles(1e3 * np.array(times["decide"])),
        "solve_total_s": parts["solve"],
        "solve_ms": quantiles(solves),
        "solve_wall_ms": quantiles(1e3 * log.solve_time_s[np.isfinite(log.solve_time_s)]),
        "iterations": quantiles(log.iterations.astype(float)),
        "statuses": dict(statuses),
        "fallback_ticks": int(np.count_nonzero(log.rung)),
        "unconverged": [
            {
                "tick": int(tick),
                "status": names.get(int(log.status[tick]), "none"),
                "iterations": int(log.iterations[tick]),
            }
            for tick in np.flatnonzero(log.status != int(SolveStatus.SOLVED))[:20]
        ],
    }


OPTIONS = {
    "cycle": ("comprehensive", "driving cycle"),
    "horizon": ("3x1+5x5", "grid"),
    "strategy": ("aging", "strategy"),
    "solver": ("riccati", "back end"),
    "duration_s": (None, "cut the trip, s"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; returns the exit code."""
    return run_benchmark("closed_loop_speed", __doc__, measure, OPTIONS, arguments)


if __name__ == "__main__":
    sys.exit(main())
