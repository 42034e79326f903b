"""Speed of the shipped default: the closed loop without ROS, and where its time goes; then over ROS 2.

Processor times equal wall times on a quiet machine.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from studies.session import Session
from studies.speed.harness import machine_in_words, quantiles, spread

from iptm.closed_loop import run_closed_loop
from iptm_controller.controller import MpcController
from iptm_controller.horizon import MULTI_HORIZON, SINGLE_HORIZON, Horizon
from iptm_controller.options import ControllerOptions
from iptm_controller.solvers.switching_check import SwitchingCheck
from iptm_controller.strategy import DEFAULT_STRATEGY, strategy_by_name
from iptm_core.decision_record import SolveStatus
from iptm_core.markdown import table_of
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_plant_sim.plant import Plant
from iptm_v2x_bridge.bridge import V2xBridge

MEASURES_TIME = True
SHORT_S = 8.0
CYCLES = ("wltc_class3b", "comprehensive")
GRIDS = {
    str(MULTI_HORIZON): DEFAULT_STRATEGY,
    f"{MULTI_HORIZON}+10x30t": DEFAULT_STRATEGY,
    str(SINGLE_HORIZON): DEFAULT_STRATEGY,
}
"""Strategy by prediction grid."""
CLOCKED: dict[str, tuple[type, str]] = {
    "decide": (MpcController, "decide"),
    "solve": (SwitchingCheck, "solve"),
    "plant": (Plant, "advance"),
    "bridge": (V2xBridge, "answer"),
}


@contextmanager
def processor_clocks() -> Iterator[dict[str, list[float]]]:
    """Time every call of the parts on the processor while the context is open, in seconds."""
    times: dict[str, list[float]] = {name: [] for name in CLOCKED}
    originals = {name: getattr(owner, method) for name, (owner, method) in CLOCKED.items()}

    def clocked(call: Callable[..., Any], log: list[float]) -> Callable[..., Any]:
        def with_clock(*arguments: Any, **named: Any) -> Any:
            began = time.process_time()
            answer = call(*arguments, **named)
            log.append(time.process_time() - began)
            return answer

        return with_clock

    try:
        for name, (owner, method) in CLOCKED.items():
            setattr(owner, method, clocked(originals[name], times[name]))
        yield times
    finally:
        for name, (owner, method) in CLOCKED.items():
            setattr(owner, method, originals[name])


def headless(
    cycle: str, horizon: str, strategy: str, duration_s: float | None = None
) -> dict[str, Any]:
    """Drive a trip without ROS and time it."""
    parameters = load_parameters().values
    route = build_route(cycle, initial_gap_m=parameters.gap.initial_gap_m, duration_s=duration_s)
    options = ControllerOptions(strategy=strategy_by_name(strategy), horizon=Horizon.parse(horizon))
    plant, controller = Plant(parameters, route.slope.slope_at), MpcController(parameters, options)
    began_s = time.process_time()
    with processor_clocks() as times:
        run = run_closed_loop(route, plant, controller)
    total_s = time.process_time() - began_s
    spent = {name: float(np.sum(values)) for name, values in times.items()}
    shares = {
        "solver": spent["solve"],
        "data and plan": spent["decide"] - spent["solve"],
        "plant": spent["plant"],
        "bridge": spent["bridge"],
        "rest": total_s - spent["decide"] - spent["plant"] - spent["bridge"],
    }
    codes = run.decisions.status
    return {
        "cycle": cycle,
        "grid": f"{strategy}, {horizon}",
        "ticks": len(run.decisions),
        "processor_s": total_s,
        "share": {name: part / total_s for name, part in shares.items()},
        "decision_ms": quantiles(1e3 * np.array(times["decide"])),
        "solve_ms": quantiles(1e3 * np.array(times["solve"])),
        "iterations": quantiles(run.decisions.iterations.astype(float)),
        "statuses": dict(Counter(SolveStatus(int(code)).name.lower() for code in codes)),
        "fallback_ticks": int(np.count_nonzero(run.decisions.rung)),
    }


def run(session: Session) -> bool:
    """Run the study; returns True. Nothing is kept: times are meant for a quiet machine."""
    if session.short:
        numbers = {"headless": [headless("nycc", "2x1+1x5", DEFAULT_STRATEGY, SHORT_S)], "ros": []}
    else:
        trips = [
            headless(name, grid, strategy) for name in CYCLES for grid, strategy in GRIDS.items()
        ]
        numbers = {"headless": trips, "ros": []}
        if not session.options.without_ros:
            # Needs ROS 2, which the other part does without.
            from studies.speed import ros_speed  # noqa: PLC0415

            numbers["ros"] = ros_speed.measure()
    session.fill(tables({**numbers, "machine": machine_in_words()}))
    return True


def tables(numbers: dict[str, Any]) -> dict[str, str]:
    """Return the measured part of the page."""
    rows = [
        {
            **run,
            "shares": " / ".join(f"{100 * value:.0f} %" for value in run["share"].values()),
            "bad": run["ticks"] - run["statuses"].get("solved", 0),
        }
        for run in numbers["headless"]
    ]
    columns = {
        "trip": "{cycle}",
        "strategy, grid": "{grid}",
        "ticks:": "{ticks}",
        "processor s:": "{processor_s:.1f}",
        "share of solver / data and plan / plant / bridge / rest:": "{shares}",
        "decision median / p99 / max ms:": spread("decision_ms", ".2f"),
        "solve median / p99 / max ms:": spread("solve_ms", ".2f"),
        "iterations median / p99 / max:": spread("iterations", ".0f"),
        "not converged:": "{bad}",
        "fallback ticks:": "{fallback_ticks}",
    }
    parts = [numbers["machine"], table_of(rows, columns)]
    if numbers["ros"]:
        # Needs ROS 2, which the other part does without.
        from studies.speed import ros_speed  # noqa: PLC0415

        parts.append(ros_speed.as_table(numbers["ros"]))
    return {"speed": "\n\n".join(parts)}
