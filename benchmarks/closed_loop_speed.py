"""Speed of the headless closed loop, and where its time goes: solver, data and plan, plant, bridge."""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report_files import finish
from iptm_controller.controller import Controller, ControllerOptions
from iptm_controller.horizon import Horizon
from iptm_controller.solvers.cooling_probe import CoolingProbe
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.strategy import strategy_by_name
from iptm_core.decision_record import SolveStatus
from iptm_core.errors import IptmError
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
        "decision_ms": _quantiles(1e3 * np.array(times["decide"])),
        "solve_total_s": parts["solve"],
        "solve_ms": _quantiles(solves),
        "solve_wall_ms": _quantiles(1e3 * log.solve_time_s[np.isfinite(log.solve_time_s)]),
        "iterations": _quantiles(log.iterations.astype(float)),
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


def _quantiles(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> dict[str, float]:
    if values.size == 0:
        return {}
    return {
        "median": float(np.median(values)),
        "p99": float(np.quantile(values, 0.99)),
        "p99.9": float(np.quantile(values, 0.999)),
        "max": float(values.max()),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; returns the exit code."""
    parser = argparse.ArgumentParser(prog="closed_loop_speed", description=__doc__)
    parser.add_argument("--cycle", default="comprehensive", help="driving cycle (%(default)s)")
    parser.add_argument("--horizon", default="3x1+5x5", help="grid (%(default)s)")
    parser.add_argument("--strategy", default="aging", help="strategy (%(default)s)")
    parser.add_argument("--solver", default="riccati", help="back end (%(default)s)")
    parser.add_argument("--duration", type=float, help="cut the trip, s")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    given = parser.parse_args(arguments)
    try:
        numbers = measure(given.cycle, given.horizon, given.strategy, given.solver, given.duration)
    except IptmError as error:
        print(f"closed_loop_speed: {error}", file=sys.stderr)
        return 2
    return finish(numbers, given.json)


if __name__ == "__main__":
    sys.exit(main())
