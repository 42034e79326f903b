"""Plans in physical units, and their shift in time on unequal grids."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.iptm_controller.scenes import make_state

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.layout import InputIndex, StateIndex
from iptm_controller.plan import (
    Plan,
    PlanShifter,
    plan_from_variables,
    sample_positions_m,
    variables_from_plan,
)
from iptm_core.state import FloatArray, VehicleState

GRIDS = st.sampled_from(["15x1", "3x1+5x5", "1x1", "2x0.5+3x2+2x10", "8x5"])
SEEDS = st.integers(0, 2**32 - 1)


def random_plan(horizon: Horizon, seed: int, state: VehicleState) -> Plan:
    """A plan with random inputs whose states follow from them step by step."""
    rng = np.random.default_rng(seed)
    inputs = rng.uniform(0.0, 2.0, (horizon.steps, layout.INPUTS))
    inputs[:, InputIndex.ACCELERATION] -= 1.0
    inputs[:, InputIndex.COMPRESSOR_POWER] *= 1000.0
    rows = [
        [state.position_m, state.speed_m_s, state.cell_1_temperature_k,
         state.cell_n_temperature_k, state.acceleration_m_s2, state.compressor_power_w]
    ]  # fmt: skip
    for length, (acceleration, power, *_) in zip(horizon.step_lengths_s, inputs, strict=True):
        position, speed, cell_1, cell_n, _, _ = rows[-1]
        rows.append(
            [
                position + speed * length + 0.5 * acceleration * length**2,
                speed + acceleration * length,
                cell_1 + rng.uniform(-0.1, 0.1),
                cell_n + rng.uniform(-0.1, 0.1),
                acceleration,
                power,
            ]
        )
    return Plan(state.time_s, horizon.node_times_s, np.array(rows), inputs, horizon.motion_steps)


def integral(plan: Plan, start_s: float, end_s: float) -> FloatArray:
    """Integral of the inputs between two trip times, the last input held on beyond the plan."""
    nodes = plan.start_s + plan.node_times_s
    edges = np.append(nodes[:-1], np.inf)
    low = np.clip(edges[:-1], start_s, end_s)
    high = np.append(low[1:], end_s)
    total: FloatArray = ((high - low)[:, None] * plan.inputs).sum(axis=0)
    return total


def later_state(plan: Plan, moved_s: float) -> VehicleState:
    """A state off the plan, as disturbances make it."""
    return make_state(
        time_s=plan.start_s + moved_s,
        position_m=1000.0 + 14.0 * moved_s,
        speed_m_s=12.0,
        acceleration_m_s2=-0.3,
        compressor_power_w=333.0,
        cell_1_temperature_k=306.0,
    )


def expect_consistent_kinematics(plan: Plan) -> None:
    lengths = np.diff(plan.node_times_s)
    acceleration = plan.inputs[:, InputIndex.ACCELERATION]
    position, speed = plan.states[:, StateIndex.POSITION], plan.states[:, StateIndex.SPEED]
    np.testing.assert_allclose(np.diff(speed), acceleration * lengths, atol=1e-9)
    np.testing.assert_allclose(
        np.diff(position), lengths * (speed[:-1] + 0.5 * lengths * acceleration), atol=1e-7
    )
    np.testing.assert_array_equal(plan.states[1:, StateIndex.LAST_ACCELERATION], acceleration)
    np.testing.assert_array_equal(
        plan.states[1:, StateIndex.LAST_COMPRESSOR_POWER],
        plan.inputs[:, InputIndex.COMPRESSOR_POWER],
    )


def expect_starts_at(plan: Plan, state: VehicleState) -> None:
    assert plan.start_s == state.time_s
    assert plan.states[0].tolist() == [
        state.position_m, state.speed_m_s, state.cell_1_temperature_k,
        state.cell_n_temperature_k, state.acceleration_m_s2, state.compressor_power_w,
    ]  # fmt: skip


@given(text=GRIDS, seed=SEEDS)
def test_scaling_there_and_back(text: str, seed: int) -> None:
    grid, state = ProblemGrid(Horizon.parse(text)), make_state()
    plan = random_plan(grid.horizon, seed, state)
    again = plan_from_variables(variables_from_plan(plan, grid, state), grid, state)
    np.testing.assert_allclose(again.states, plan.states, rtol=1e-13, atol=1e-9)
    np.testing.assert_allclose(again.inputs, plan.inputs, rtol=1e-13, atol=1e-12)


@given(text=GRIDS, seed=SEEDS, moved_s=st.floats(0.0, 120.0))
def test_shift_keeps_the_mean_of_the_inputs(text: str, seed: int, moved_s: float) -> None:
    horizon = Horizon.parse(text)
    plan = random_plan(horizon, seed, make_state())
    state = later_state(plan, moved_s)
    shifted = PlanShifter(horizon).shift(plan, state)
    for step, (start, end) in enumerate(
        zip(shifted.node_times_s[:-1], shifted.node_times_s[1:], strict=True)
    ):
        mean = integral(plan, state.time_s + start, state.time_s + end) / (end - start)
        np.testing.assert_allclose(shifted.inputs[step], mean, atol=1e-7)


@given(text=GRIDS, seed=SEEDS, moved_s=st.floats(0.0, 120.0))
def test_shift_starts_at_the_measured_state_and_obeys_the_kinematics(
    text: str, seed: int, moved_s: float
) -> None:
    horizon = Horizon.parse(text)
    plan = random_plan(horizon, seed, make_state())
    state = later_state(plan, moved_s)
    shifted = PlanShifter(horizon).shift(plan, state)
    expect_starts_at(shifted, state)
    expect_consistent_kinematics(shifted)
    # Inputs stay between the smallest and the largest of the old plan.
    assert (shifted.inputs <= plan.inputs.max(axis=0) + 1e-7).all()
    assert (shifted.inputs >= plan.inputs.min(axis=0) - 1e-7).all()


@pytest.mark.parametrize("text", ["15x1", "3x1+5x5"])
def test_cold_start_rolls_on(text: str) -> None:
    state = make_state(compressor_power_w=450.0, acceleration_m_s2=0.8)
    plan = PlanShifter(Horizon.parse(text)).cold_start(state)
    expect_starts_at(plan, state)
    expect_consistent_kinematics(plan)
    assert (plan.states[:, StateIndex.SPEED] == state.speed_m_s).all()
    assert (plan.inputs[:, InputIndex.COMPRESSOR_POWER] == 450.0).all()
    assert (plan.inputs[:, InputIndex.GAP_SHORT :] == 0.0).all()


@given(text=GRIDS, seed=SEEDS, elapsed_s=st.floats(0.0, 60.0))
def test_positions_between_the_nodes(text: str, seed: int, elapsed_s: float) -> None:
    """Exact inside the plan; beyond it the last step goes on."""
    horizon = Horizon.parse(text)
    plan = random_plan(horizon, seed, make_state())
    step = int(np.searchsorted(plan.node_times_s[1:-1], elapsed_s, side="right"))
    rest = elapsed_s - plan.node_times_s[step]
    position, speed = plan.states[step, :2]
    expected = position + speed * rest + 0.5 * plan.inputs[step, 0] * rest**2
    found = sample_positions_m(plan, np.array([elapsed_s]))
    assert found[0] == pytest.approx(expected, abs=1e-7)
    np.testing.assert_allclose(
        sample_positions_m(plan, plan.node_times_s), plan.states[:, 0], atol=1e-7
    )
