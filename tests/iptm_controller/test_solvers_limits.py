"""Limits bite where they should, and a start outside them is solved."""

from __future__ import annotations

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_scene, plain_solver, problem_of

from iptm_controller.horizon import Horizon
from iptm_controller.measurements import Measurements
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.ocp.stages import GAP_SMOOTHING_M
from iptm_controller.plan import Plan, plan_from_variables
from iptm_controller.solvers.interface import SolverBackend
from iptm_core.physics.car_following import minimum_gap_m
from iptm_core.state import FloatArray

GRIDS = ["3x1+5x5", "15x1"]


def solve(solver: SolverBackend, measured: Measurements, grid: str, strategy: str) -> Plan:
    result = solver.solve(*problem_of(measured, grid, strategy))
    assert result.status.usable, result.reason
    return plan_from_variables(result.variables, ProblemGrid(Horizon.parse(grid)), measured.state)


def gaps_of(plan: Plan, measured: Measurements) -> FloatArray:
    """Gap to the predicted leader at the nodes."""
    times = plan.start_s + plan.node_times_s
    preview = measured.preview
    leader = np.interp(times, preview.times_s, preview.positions_m)
    return leader - plan.states[:, StateIndex.POSITION]


def expect_hard_limits(plan: Plan, measured: Measurements) -> None:
    """Whatever the situation, inputs stay within their bounds and rates."""
    limits, state = PARAMETERS.limits, measured.state
    acceleration = plan.inputs[:, InputIndex.ACCELERATION]
    power = plan.inputs[:, InputIndex.COMPRESSOR_POWER]
    assert limits.min_acceleration_m_s2 - 1e-6 <= acceleration.min()
    assert acceleration.max() <= limits.max_acceleration_m_s2 + 1e-6
    assert limits.min_compressor_power_w - 1e-3 <= power.min()
    assert power.max() <= limits.max_compressor_power_w + 1e-3
    lengths = np.diff(plan.node_times_s)
    between = np.concatenate([lengths[:1], 0.5 * (lengths[:-1] + lengths[1:])])
    jerk = np.diff(acceleration, prepend=state.acceleration_m_s2) / between
    rate = np.diff(power, prepend=state.compressor_power_w) / between
    assert np.abs(jerk).max() <= limits.max_jerk_m_s3 * (1.0 + 1e-4)
    assert np.abs(rate).max() <= limits.max_compressor_rate_w_s * (1.0 + 1e-4)


@pytest.mark.parametrize("grid", GRIDS)
def test_a_braking_leader_brings_the_plan_to_the_gap_limit(grid: str) -> None:
    measured = make_scene(
        speed_m_s=18.0, leader_speed_m_s=18.0, leader_acceleration_m_s2=-1.0, gap_m=48.0
    )
    plan = solve(plain_solver(grid), measured, grid, "aging")
    expect_hard_limits(plan, measured)
    gaps = gaps_of(plan, measured)
    leader = np.interp(
        plan.start_s + plan.node_times_s, measured.preview.times_s, measured.preview.speeds_m_s
    )
    shortest = minimum_gap_m(
        plan.states[:, StateIndex.SPEED], leader, PARAMETERS.gap, PARAMETERS.limits
    )
    shortest = np.maximum(shortest, PARAMETERS.gap.standstill_gap_m)
    margin = (gaps - shortest)[1:]
    # Inside of long steps the gap is watched, too; a smooth minimum of several is a little strict.
    strict = GAP_SMOOTHING_M if grid == "3x1+5x5" else 0.0
    assert -1e-2 <= margin.min() + plan.slacks["gap_slack_m"] <= 1e-2 + strict
    assert plan.states[:, StateIndex.SPEED].min() >= -1e-5


def test_an_emergency_brakes_as_fast_as_the_jerk_limit_permits() -> None:
    measured = make_scene(
        speed_m_s=20.0, leader_speed_m_s=20.0, leader_acceleration_m_s2=-2.0, gap_m=36.0
    )
    plan = solve(plain_solver("3x1+5x5"), measured, "3x1+5x5", "aging")
    expect_hard_limits(plan, measured)
    np.testing.assert_allclose(plan.inputs[:3, 0], [-0.5, -1.0, -1.5], atol=1e-4)
    assert plan.inputs[3, 0] == pytest.approx(-2.0, abs=1e-4)
    assert plan.slacks["gap_slack_m"] > 0.1


def test_a_leader_that_is_lost_costs_the_long_gap() -> None:
    measured = make_scene(gap_m=300.0)
    plan = solve(plain_solver("3x1+5x5"), measured, "3x1+5x5", "aging")
    gaps = gaps_of(plan, measured)
    assert plan.slacks["gap_slack_m"] == pytest.approx(gaps[1:].max() - 120.0, abs=1e-3)
    assert gaps[-1] < 200.0


@pytest.mark.parametrize("grid", GRIDS)
def test_speed_limit_binds_behind_a_leader_that_breaks_it(grid: str) -> None:
    measured = make_scene(speed_m_s=36.5, leader_speed_m_s=39.0, gap_m=75.0)
    plan = solve(plain_solver(grid), measured, grid, "reference")
    fastest = plan.states[:, StateIndex.SPEED].max()
    assert fastest == pytest.approx(PARAMETERS.limits.max_speed_m_s, abs=1e-3)
    assert plan.slacks["speed_slack_m_s"] < 1e-3


OUTSIDE: dict[str, dict[str, float]] = {
    "too_close": {"gap_m": 3.0, "speed_m_s": 10.0, "leader_speed_m_s": 10.0},
    "touching": {"gap_m": 0.0, "speed_m_s": 5.0, "leader_speed_m_s": 5.0},
    "overlapping": {"gap_m": -0.9, "speed_m_s": 0.0, "leader_speed_m_s": 0.0},
    "too_fast": {"gap_m": 100.0, "speed_m_s": 39.0, "leader_speed_m_s": 36.0},
    "far_behind": {"gap_m": 400.0},
    "cells_at_45": {"cell_1_temperature_k": 317.15, "cell_n_temperature_k": 318.15},
    "cells_at_60": {"cell_1_temperature_k": 333.15, "cell_n_temperature_k": 333.15},
    "everything": {
        "gap_m": 2.0,
        "speed_m_s": 4.0,
        "leader_speed_m_s": 4.0,
        "cell_1_temperature_k": 316.0,
        "cell_n_temperature_k": 317.0,
        "acceleration_m_s2": 2.0,
        "compressor_power_w": 4500.0,
    },
}
SLACK_OF = {"cells": "temperature_slack_k", "everything": "temperature_slack_k"}
"""Group of the slack by the first word of a scene; that of the others is the gap."""


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("name", sorted(OUTSIDE))
def test_a_measurement_outside_the_limits_is_solved_with_its_slack_reported(
    name: str, grid: str
) -> None:
    measured = make_scene(**OUTSIDE[name])
    plan = solve(plain_solver(grid), measured, grid, "aging")
    expect_hard_limits(plan, measured)
    kind = SLACK_OF.get(name.split("_", maxsplit=1)[0], "gap_slack_m")
    assert plan.slacks["speed_slack_m_s" if name == "too_fast" else kind] > 0.05


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("strategy", ["aging", "energy_aging"])
def test_cold_cells_are_no_violation_and_no_reason_to_waste(grid: str, strategy: str) -> None:
    """A cold pack drives like a warm one without temperature limits, the compressor off."""
    cold = make_scene(cell_1_temperature_k=270.15, cell_n_temperature_k=270.15)
    plan = solve(plain_solver(grid), cold, grid, strategy)
    assert plan.slacks["temperature_slack_k"] < 1e-6
    assert plan.inputs[:, 1].max() < 0.1
    warm = make_scene(cell_1_temperature_k=300.15, cell_n_temperature_k=300.15)
    usual = solve(plain_solver(grid), warm, grid, strategy)
    # A cold cell has a larger resistance: that changes the best driving a little.
    np.testing.assert_allclose(plan.inputs[:3, 0], usual.inputs[:3, 0], atol=0.15)


def test_slack_is_as_large_as_the_violation() -> None:
    measured = make_scene(cell_1_temperature_k=317.15, cell_n_temperature_k=318.15)
    plan = solve(plain_solver("3x1+5x5"), measured, "3x1+5x5", "aging")
    warmest = plan.states[1:, StateIndex.CELL_N_TEMPERATURE].max()
    excess_k = warmest - PARAMETERS.limits.max_temperature_k
    assert plan.slacks["temperature_slack_k"] == pytest.approx(excess_k, abs=1e-3)


def test_no_slack_where_none_is_needed() -> None:
    plan = solve(plain_solver("3x1+5x5"), make_scene(gap_m=50.0), "3x1+5x5", "aging")
    assert max(plan.slacks.values()) < 1e-5
