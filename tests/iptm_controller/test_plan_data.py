"""Problems and plans made in C are those made in Python, to the last bit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_scene

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemDataBuilder
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.plan import Plan
from iptm_controller.plan_data import PlanData, PlanDataInC, plan_data
from iptm_controller.strategy import strategy_by_name
from iptm_controller.temperature_value import NO_VALUE, TemperatureValue
from iptm_core.state import LeaderPreview, SlopePreview, VehicleState

GRIDS = ("3x1+5x5", "15x1", "1x1", "2x1+2x5+4x30t")


def both(grid: str, tick_s: float = math.inf) -> tuple[PlanData, PlanData, ProblemGrid]:
    problem_grid = ProblemGrid(Horizon.parse(grid))
    strategy = replace(strategy_by_name("energy_aging"), coldest_below_limit_k=2.0)
    builder = ProblemDataBuilder(problem_grid, strategy, PARAMETERS, tick_s)
    in_c = plan_data(problem_grid, builder)
    if not isinstance(in_c, PlanDataInC):
        pytest.skip("no C compiler on this machine")
    return PlanData(problem_grid, builder), in_c, problem_grid


def some_state(rng: np.random.Generator, time_s: float) -> VehicleState:
    state = make_scene(speed_m_s=float(rng.uniform(0.0, 30.0))).state
    return replace(
        state,
        time_s=time_s,
        position_m=float(rng.uniform(0.0, 4000.0)),
        cell_1_temperature_k=float(rng.uniform(270.0, 320.0)),
        acceleration_m_s2=float(rng.uniform(-2.0, 2.0)),
    )


def some_plan(rng: np.random.Generator, grid: ProblemGrid, start_s: float) -> Plan:
    return Plan(
        start_s,
        grid.horizon.node_times_s,
        rng.normal(300.0, 20.0, (grid.steps + 1, layout.STATES)),
        rng.normal(size=(grid.steps, layout.INPUTS)),
        grid.horizon.motion_steps,
    )


def some_motion(rng: np.random.Generator, now_s: float, nodes: int) -> LeaderPreview:
    times = now_s - 3.0 + np.cumsum(rng.uniform(0.3, 2.0, nodes))
    speeds = rng.uniform(0.0, 30.0, nodes)
    return LeaderPreview(times, 500.0 + np.cumsum(rng.uniform(0.0, 30.0, nodes)), speeds)


def assert_equal_plans(one: Plan, other: Plan) -> None:
    assert (one.start_s, one.motion_steps) == (other.start_s, other.motion_steps)
    for name in ("node_times_s", "states", "inputs"):
        assert np.array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("moved_s", [0.0, 0.1, 1.0, 2.0, 4.99, 7.5, 1000.0])
def test_plans_are_moved_on_alike(grid: str, moved_s: float) -> None:
    in_python, in_c, problem_grid = both(grid)
    rng = np.random.default_rng(3)
    for _ in range(5):
        last = some_plan(rng, problem_grid, start_s=17.3)
        state = some_state(rng, 17.3 + moved_s)
        assert_equal_plans(in_python.expected(last, state), in_c.expected(last, state))
    assert_equal_plans(in_python.expected(None, state), in_c.expected(None, state))


@pytest.mark.parametrize("grid", GRIDS)
def test_problems_are_posed_alike(grid: str) -> None:
    in_python, in_c, problem_grid = both(grid)
    rng = np.random.default_rng(5)
    thermal = problem_grid.sample_times_s.size - problem_grid.motion_samples
    for case in range(40):
        state = some_state(rng, 100.0)
        last = some_plan(rng, problem_grid, 99.0) if case % 7 else None
        leader = some_motion(rng, 100.0, int(rng.choice([1, 2, 5, 60])))
        limiting = leader if case % 3 else some_motion(rng, 100.0, 9)
        nodes = int(rng.choice([1, 3, 200]))
        slope = SlopePreview(np.cumsum(rng.uniform(0.0, 60.0, nodes)), rng.normal(0.0, 0.05, nodes))
        known_s = float(rng.choice([-1.0, 0.0, 1.0, 2.5, 8.0, math.inf]))
        limits = rng.uniform(0.0, 60.0, problem_grid.horizon.motion_steps) if case % 2 else None
        value = TemperatureValue(*rng.normal(size=8).tolist()) if case % 4 else NO_VALUE
        samples = rng.normal(size=(thermal, layout.SAMPLE_PARAMETERS)) if thermal else None
        given = (state, last, leader, limiting, slope, known_s, value, samples, limits)
        (data, start), (expected_data, expected_start) = (
            form.problem(*given, follows=case % 5 > 0) for form in (in_c, in_python)
        )
        assert np.array_equal(data.parameters, expected_data.parameters)
        assert np.array_equal(data.initial_state, expected_data.initial_state)
        assert np.array_equal(start, expected_start)


@pytest.mark.parametrize("grid", GRIDS)
def test_solutions_are_read_alike(grid: str) -> None:
    in_python, in_c, problem_grid = both(grid)
    rng = np.random.default_rng(7)
    state = some_state(rng, 12.0)
    variables = rng.normal(size=problem_grid.variable_count)
    assert_equal_plans(in_python.plan(variables, state), in_c.plan(variables, state))


def test_steps_that_are_watched_inside_are_posed_in_python() -> None:
    grid = ProblemGrid(Horizon.parse("4x2"))
    builder = ProblemDataBuilder(grid, strategy_by_name("aging"), PARAMETERS, 0.5)
    assert not isinstance(plan_data(grid, builder), PlanDataInC)
