"""The fallback ladder: order of the rungs, how long each holds, and the way back."""

from __future__ import annotations

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_leader, make_state

from iptm_controller.horizon import Horizon
from iptm_controller.ladder import FallbackLadder, controlled_stop, safe_following
from iptm_controller.ocp import layout
from iptm_controller.plan import Plan
from iptm_core.decision_record import Rung
from iptm_core.state import Command


def plan_from(start_s: float, horizon: str = "3x1+2x5") -> Plan:
    """A plan whose inputs identify their step."""
    grid = Horizon.parse(horizon)
    inputs = np.zeros((grid.steps, layout.INPUTS))
    inputs[:, 0] = 0.1 * (1 + np.arange(grid.steps))
    inputs[:, 1] = 100.0 * (1 + np.arange(grid.steps))
    states = np.zeros((grid.steps + 1, layout.STATES))
    return Plan(start_s, grid.node_times_s, states, inputs, grid.motion_steps)


def step_of(command: Command) -> int:
    return round(command.compressor_power_w / 100.0) - 1


@pytest.fixture
def ladder() -> FallbackLadder:
    return FallbackLadder(PARAMETERS, 1.0, shifted_plan_ticks=3, safe_law_ticks=5)


def test_walks_down_rung_by_rung_and_back_at_once(ladder: FallbackLadder) -> None:
    ladder.accept(plan_from(100.0))
    rungs = []
    for tick in range(1, 11):
        state = make_state(time_s=100.0 + tick)
        leader = make_leader(time_s=100.0 + tick)
        rung, command = ladder.fall_back(state, leader)
        rungs.append(rung)
        law = safe_following(state, leader, PARAMETERS)
        planned_m_s2 = 0.1 * (1 + min(tick, 3))
        expected = {
            Rung.SHIFTED_PLAN: Command(
                min(planned_m_s2, law.acceleration_m_s2), 100.0 * (1 + min(tick, 3))
            ),
            Rung.SAFE_LAW: law,
            Rung.STOP: controlled_stop(state, PARAMETERS, 1.0),
        }[rung]
        assert command.acceleration_m_s2 == pytest.approx(expected.acceleration_m_s2)
        assert command.compressor_power_w == pytest.approx(expected.compressor_power_w)
    assert rungs == [Rung.SHIFTED_PLAN] * 3 + [Rung.SAFE_LAW] * 5 + [Rung.STOP] * 2
    assert ladder.accept(plan_from(111.0))[0] is Rung.OPTIMAL
    # The count starts anew.
    later = ladder.fall_back(make_state(time_s=112.0), make_leader(time_s=112.0))
    assert later[0] is Rung.SHIFTED_PLAN
    assert step_of(later[1]) == 1


def test_plan_is_followed_by_time_not_by_count() -> None:
    """A tick may be missed, or the loop may run faster than the steps of the plan."""
    ladder = FallbackLadder(PARAMETERS, 0.5, 30, 5)
    ladder.accept(plan_from(100.0))
    steps = [
        step_of(ladder.fall_back(make_state(time_s=time_s), None)[1])
        for time_s in (100.5, 101.0, 101.5, 102.99, 103.0, 107.9, 108.0, 112.9)
    ]
    assert steps == [0, 1, 1, 2, 3, 3, 4, 4]


def test_plan_is_left_where_it_ends() -> None:
    ladder = FallbackLadder(PARAMETERS, 1.0, 30, 5)
    ladder.accept(plan_from(100.0))
    assert ladder.fall_back(make_state(time_s=112.9), make_leader())[0] is Rung.SHIFTED_PLAN
    assert ladder.fall_back(make_state(time_s=113.0), make_leader())[0] is Rung.SAFE_LAW


def test_without_a_leader_the_plan_and_then_the_stop(ladder: FallbackLadder) -> None:
    ladder.accept(plan_from(100.0))
    rungs = [ladder.fall_back(make_state(time_s=101.0 + tick), None)[0] for tick in range(5)]
    assert rungs == [Rung.SHIFTED_PLAN] * 3 + [Rung.STOP] * 2


def test_without_a_state_it_stops_whatever_else_is_known(ladder: FallbackLadder) -> None:
    ladder.accept(plan_from(100.0))
    rung, command = ladder.fall_back(None, make_leader())
    assert rung is Rung.STOP
    assert command.acceleration_m_s2 < 0.0
    assert command.compressor_power_w == 0.0
