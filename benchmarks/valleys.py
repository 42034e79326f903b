"""Plans that miss a deeper valley: the controller's plan against many starts of the solver.

Problems are drawn at random: every shipped parameter set, speeds, gaps, leaders that change speed, hills,
temperatures, compressor powers, and mean aging rates for the price of a kelvin. The plan of the default
back end (one solve, one second try at most) is compared with the best of many starts: the compressor off,
running at several powers, in the first or the last part of the horizon only, and at random.
"""

from __future__ import annotations

import math
import sys

import numpy as np

from benchmarks.harness import run_benchmark
from iptm_controller.forecast import LeaderForecaster
from iptm_controller.horizon import MULTI_HORIZON
from iptm_controller.ocp.data import ProblemData, ProblemDataBuilder
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.layout import GlobalIndex, InputIndex, StateIndex
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.plan import PlanShifter, sample_positions_m, variables_from_plan
from iptm_controller.solvers.factory import build_plain_solver
from iptm_controller.solvers.interface import SolverBackend, SolveResult, SolverOptions
from iptm_controller.solvers.switching_check import SwitchingCheck
from iptm_controller.strategy import DEFAULT_STRATEGY, strategy_by_name
from iptm_controller.temperature_value import TemperatureValuation
from iptm_core.parameters import available_parameter_sets, load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.gap_policy import minimum_gap_m
from iptm_core.state import FloatArray, LeaderPreview, LeaderState, SlopePreview, VehicleState

PREVIEW_S = 60
WORSE = (0.003, 0.01, 0.03)
"""Shares of its running cost by which a plan may be dearer than the best one known."""


def draw(
    rng: np.random.Generator, parameters: ModelParameters, grid: ProblemGrid
) -> tuple[ProblemData, FloatArray]:
    """Draw a problem of the default strategy and its cold guess."""
    speed = float(rng.uniform(0.0, 33.0))
    leader_speed = max(speed + float(rng.normal(0.0, 2.0)), 0.0)
    least = max(
        minimum_gap_m(speed, leader_speed, parameters.gap, parameters.limits),
        parameters.gap.standstill_gap_m,
    )
    gap = float(rng.uniform(least + 5.0, max(least + 10.0, parameters.gap.max_gap_m)))
    coldest = float(rng.uniform(298.2, 311.0))
    loss = 1e-3
    state = VehicleState(
        time_s=600.0,
        position_m=5000.0,
        speed_m_s=speed,
        acceleration_m_s2=float(rng.uniform(-0.5, 0.5)),
        compressor_power_w=float(rng.choice([0.0, 0.0, 400.0, 800.0, 1200.0])),
        cell_1_temperature_k=coldest,
        cell_n_temperature_k=coldest + float(rng.uniform(0.0, 2.5)),
        cell_1_capacity_loss=loss,
        cell_n_capacity_loss=loss,
    )
    leader = LeaderState(600.0, 5000.0 + gap, leader_speed)
    times = 600.0 + np.arange(0.0, PREVIEW_S + 1.0)
    changes = np.repeat(rng.normal(0.0, 0.6, PREVIEW_S // 6 + 1), 6)[:PREVIEW_S]
    speeds = np.clip(leader_speed + np.concatenate([[0.0], np.cumsum(changes)]), 0.0, 36.0)
    ways = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]))])
    preview = LeaderPreview(600.0, times, leader.position_m + ways, speeds)
    road_m = np.arange(4000.0, 9000.0, 20.0)
    grade = float(rng.choice([0.0, 0.02, 0.06]))
    slope = SlopePreview(road_m, grade * np.sin(road_m / 300.0 + rng.uniform(0.0, 6.3)))
    strategy = strategy_by_name(DEFAULT_STRATEGY)
    motion = LeaderForecaster(grid.horizon.duration_s, 10.0).forecast(leader, preview).motion
    valuation = TemperatureValuation(
        parameters, strategy.aging_weight, grid.horizon.duration_s, math.inf
    )
    value = valuation.value(state, motion)
    plan = PlanShifter(grid.horizon).cold_start(state)
    builder = ProblemDataBuilder(grid, strategy, parameters)
    expected = sample_positions_m(plan, grid.sample_times_s)
    data = builder.build(state, motion, slope, expected, value=value)
    return data, variables_from_plan(plan, grid, state)


def starts(rng: np.random.Generator, steps: int, at_random: int) -> list[FloatArray]:
    """Return compressor powers in kW to start from, each of shape (steps,)."""
    found = [np.full(steps, power) for power in (0.0, 0.6, 0.9, 1.4, 2.5)]
    for split in range(1, steps):
        on = np.arange(steps) >= split
        found += [np.where(on, 0.9, 0.0), np.where(on, 0.0, 0.9)]
    found += [rng.choice([0.0, 0.9, 1.5], steps) for _ in range(at_random)]
    return found


def best_of(
    solver: SolverBackend,
    grid: ProblemGrid,
    data: ProblemData,
    first: SolveResult,
    powers: list[FloatArray],
) -> float:
    """Return the smallest cost that any of the starts leads to."""
    best = first.objective
    for wanted in powers:
        states, inputs = grid.split(first.variables)
        inputs[:, InputIndex.COMPRESSOR_POWER] = wanted
        states[1:, StateIndex.LAST_COMPRESSOR_POWER] = wanted
        result = solver.solve(data, grid.join(states, inputs))
        if result.status.usable:
            best = min(best, result.objective)
    return best


def running_cost(grid: ProblemGrid, data: ProblemData, result: SolveResult) -> float:
    """Return what a plan costs without the price of its temperatures, whose zero is arbitrary."""
    states, _ = grid.split(result.variables)
    change = states[-1] - states[0]
    price = (
        data.parameters[GlobalIndex.CELL_1_PRICE] * change[StateIndex.CELL_1_TEMPERATURE]
        + data.parameters[GlobalIndex.CELL_N_PRICE] * change[StateIndex.CELL_N_TEMPERATURE]
    )
    return max(float(result.objective - price), 1e-3)


def measure(problems: int = 300, at_random: int = 8, seed: int = 1) -> dict[str, float]:
    """Draw problems of every shipped parameter set and look for deeper valleys.

    Args:
        problems: number of problems for each set.
        at_random: random starts beside the systematic ones.
        seed: of everything drawn.
    """
    figures: dict[str, float] = {}
    for name in available_parameter_sets():
        parameters = load_parameters(name).values
        problem = OptimalControlProblem(MULTI_HORIZON, parameters)
        solver = build_plain_solver(MULTI_HORIZON, parameters, SolverOptions())
        check = SwitchingCheck(solver, problem, try_every=0)
        rng = np.random.default_rng(seed)
        dearer, unusable = [], 0
        for _ in range(problems):
            data, guess = draw(rng, parameters, problem.grid)
            result = check.solve(data, guess)
            powers = starts(rng, problem.grid.steps, at_random)
            if not result.status.usable:
                unusable += 1
                continue
            best = best_of(solver, problem.grid, data, result, powers)
            dearer.append((result.objective - best) / running_cost(problem.grid, data, result))
        shares = np.array(dearer)
        figures[f"{name}_unusable"] = unusable
        figures[f"{name}_largest_share"] = float(shares.max())
        print(f"{name}: {problems} problems, {unusable} without a plan", end="")
        for limit in WORSE:
            count = int(np.count_nonzero(shares > limit))
            figures[f"{name}_over_{limit:g}"] = count
            print(f", {count} dearer than the best by over {100.0 * limit:g} %", end="")
        print(f", at most {100.0 * shares.max():.1f} %", flush=True)
    return figures


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
