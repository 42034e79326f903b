"""Solve time of the default strategy with the models of a real car against the paper's, in turn.

Each car drives the cycle once and its problems are kept; then both are solved again, a stretch of one car
and the same stretch of the other in turn, so that drift of the machine hits both alike.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from benchmarks.harness import PROPOSED, quantiles, run_benchmark, timed
from benchmarks.record_problems import record_problems, spread_blocks
from iptm_controller.horizon import Horizon
from iptm_controller.solvers.factory import build_solver
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.strategy import DEFAULT_STRATEGY
from iptm_core.parameters import DEFAULT_SET, load_parameters
from iptm_core.physics.charge import nominal_charge_parameters


def measure(
    cycle: str = "wltc_class3b",
    parameter_set: str = "bmw_i3",
    blocks: int = 60,
    block_length: int = 20,
    repeats: int = 3,
) -> dict[str, Any]:
    """Measure processor times of whole solves, the second start of the compressor included.

    Args:
        cycle: driving cycle.
        parameter_set: of the real car.
        blocks: stretches of consecutive ticks.
        block_length: ticks per stretch.
        repeats: how often all stretches are solved.
    """
    cars = (DEFAULT_SET, parameter_set)
    problems = {
        car: record_problems(cycle, DEFAULT_STRATEGY, PROPOSED, parameter_set=car) for car in cars
    }
    solvers = {
        car: build_solver(
            Horizon.parse(PROPOSED),
            nominal_charge_parameters(load_parameters(car).values),
            SolverOptions(),
        )
        for car in cars
    }
    times: dict[str, list[float]] = {car: [] for car in cars}
    iterations: dict[str, list[int]] = {car: [] for car in cars}
    total = min(len(problems[car]) for car in cars)
    for _ in range(repeats):
        for block in spread_blocks(total, blocks, block_length):
            for car in cars:
                solvers[car].solve(*problems[car].problem(block[0]))  # fills the caches
                for index in block:
                    result, elapsed = timed(
                        lambda car=car, index=index: solvers[car].solve(
                            *problems[car].problem(index)
                        )
                    )
                    times[car].append(1e3 * elapsed.processor_s)
                    iterations[car].append(result.iterations)
    solve_ms = {car: quantiles(np.array(values)) for car, values in times.items()}
    mean_ms = {car: float(np.mean(values)) for car, values in times.items()}
    per_iteration_ms = {car: sum(times[car]) / sum(iterations[car]) for car in cars}
    return {
        "cycle": cycle,
        "solves": len(times[parameter_set]),
        "solve_ms": solve_ms,
        "mean_ms": mean_ms,
        "mean_iterations": {car: float(np.mean(values)) for car, values in iterations.items()},
        "ratio": {
            "median": solve_ms[parameter_set]["median"] / solve_ms[DEFAULT_SET]["median"],
            "mean": mean_ms[parameter_set] / mean_ms[DEFAULT_SET],
            "p99": solve_ms[parameter_set]["p99"] / solve_ms[DEFAULT_SET]["p99"],
            "iteration": per_iteration_ms[parameter_set] / per_iteration_ms[DEFAULT_SET],
        },
    }


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
