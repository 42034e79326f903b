"""Real time with other load: does any tick miss its schedule while two busy processes take the processor?

Headless, a controller is paced by a schedule faster than the vehicle's, with a deadline on every solve;
a tick counts as late if its command is not there when the next one is due (judged by the schedule, not
by the duration of the call). Over ROS 2, the real-time scenario is driven with the same load.
"""

from __future__ import annotations

import multiprocessing
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from benchmarks.harness import closed_loop, quantiles, run_benchmark, statuses
from benchmarks.ros_speed import drive, solves
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.solvers.interface import SolverOptions
from iptm_studies.closed_loop import run_closed_loop

CYCLE = "comprehensive"


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Keep a number of processors busy while the context is open."""
    context = multiprocessing.get_context("spawn")
    workers = [context.Process(target=_burn, daemon=True) for _ in range(count)]
    for worker in workers:
        worker.start()
    try:
        yield
    finally:
        for worker in workers:
            worker.terminate()
            worker.join()


def _burn() -> None:
    values = np.linspace(0.0, 1.0, 20_000)
    while True:
        values = np.sqrt(values * values + 1e-9)


class _Schedule:
    """Waits for the next due time of a tick and notes how late ticks end."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._start_s = time.perf_counter()
        self.answers_s: list[float] = []

    def after_decision(self, tick: int, measured: Measurements, decision: Decision) -> None:
        """Note when the command was there, then wait until the next tick is due."""
        del measured, decision
        now_s = time.perf_counter()
        self.answers_s.append(now_s - self._start_s - tick * self._period_s)
        wait_s = self._start_s + (tick + 1) * self._period_s - now_s
        if wait_s > 0.0:
            time.sleep(wait_s)


def paced(ticks: int, period_s: float, deadline_s: float, load: int) -> dict[str, Any]:
    """Run a paced closed loop with busy neighbours.

    Args:
        ticks: ticks driven.
        period_s: schedule.
        deadline_s: bound on a solve, 0 for none.
        load: number of busy processes.

    Raises:
        IptmError: the set-up fails.
    """
    trip = closed_loop(CYCLE, solver=SolverOptions(deadline_s=deadline_s), duration_s=float(ticks))
    with busy_processes(load):
        schedule = _Schedule(period_s)
        run = run_closed_loop(*trip, on_tick=schedule.after_decision)
    answers = 1e3 * np.array(schedule.answers_s)
    solves = 1e3 * run.decisions.solve_time_s
    return {
        "ticks": ticks,
        "period_ms": 1e3 * period_s,
        "deadline_ms": 1e3 * deadline_s,
        "busy_processes": load,
        "overruns": int(np.count_nonzero(answers > 1e3 * period_s)),
        "answer_ms": quantiles(answers),
        "solve_ms": quantiles(solves),
        "statuses": statuses(run.decisions),
        "fallback_ticks": int(np.count_nonzero(run.decisions.rung)),
        "smallest_gap_m": float(run.trajectory.gap_m.min()),
    }


def over_ros(duration_s: float, rate_factor: float, load: int) -> dict[str, Any]:
    """Drive the real-time scenario with busy neighbours.

    Raises:
        ScenarioError: the run fails.
    """
    options = ["--duration-s", str(duration_s), "--rate-factor", str(rate_factor)]
    with busy_processes(load):
        results = drive("real_time", options)
    decisions, answered = results["metrics"]["decisions"], solves(results)
    return {
        "trip_s": results["metrics"]["duration_s"],
        "rate_factor": rate_factor,
        "busy_processes": load,
        "good": results["good"],
        "problems": results["problems"],
        "warnings": results["warnings"],
        "decisions": decisions["decisions"],
        "solve_ms": answered["solve_time_ms"],
        "statuses": answered["statuses"],
        "rungs": {name: count for name, count in decisions["by_rung"].items() if count},
    }


def measure(
    ticks: int = 600, period_s: float = 0.1, deadline_s: float = 0.05, load: int = 2
) -> dict[str, Any]:
    """Measure both ways, without and with load.

    Args:
        ticks: ticks headless.
        period_s: schedule, s.
        deadline_s: bound on a solve, s.
        load: busy processes.

    Raises:
        IptmError: a run fails.
    """
    return {
        "headless": [paced(ticks, period_s, deadline_s, count) for count in (0, load)],
        "ros": over_ros(min(60.0, float(ticks)), 2.0, load),
    }


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
