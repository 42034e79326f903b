"""Driving without an optimiser: the rungs, the law that follows the leader, the soft stop, the thermostat."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.iptm_controller.scenes import PARAMETERS, make_leader, make_state

from iptm_controller.horizon import Horizon
from iptm_controller.ladder import (
    THERMOSTAT_ON_K,
    THERMOSTAT_POWER_W,
    FallbackLadder,
    controlled_stop,
    safe_following,
    thermostat_power_w,
)
from iptm_controller.ocp import layout
from iptm_controller.plan import Plan
from iptm_controller.safeguards import CommandLimiter
from iptm_core.decision_record import Rung
from iptm_core.parameters.model import LimitParameters
from iptm_core.routes import CYCLE_NAMES, build_route
from iptm_core.state import Command, LeaderState, VehicleState


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
    assert step_of(ladder.accept(plan_from(111.0))) == 0
    # The count starts again.
    later = ladder.fall_back(make_state(time_s=112.0), make_leader(time_s=112.0))
    assert later[0] is Rung.SHIFTED_PLAN
    assert step_of(later[1]) == 1


@pytest.mark.parametrize(
    ("warmest_k", "power_w"),
    [(305.0, 0.0), (305.15, 0.0), (308.15, 750.0), (311.15, 1500.0), (320.0, 1500.0)],
)
def test_the_thermostat_cools_in_full_6_k_above_32_degrees(
    warmest_k: float, power_w: float
) -> None:
    state = make_state(cell_1_temperature_k=300.0, cell_n_temperature_k=warmest_k)
    assert thermostat_power_w(state, PARAMETERS) == pytest.approx(power_w)


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


LEADER_BRAKING_M_S2 = 2.0
"""A leader that brakes no harder than the ego vehicle can."""


def roll(position_m: float, speed_m_s: float, acceleration_m_s2: float) -> tuple[float, float]:
    """One second of constant acceleration; near standstill the brakes hold."""
    end = speed_m_s + acceleration_m_s2
    if max(speed_m_s, end) < 1e-3:
        return position_m, 0.0
    if end >= 0.0:
        return position_m + speed_m_s + 0.5 * acceleration_m_s2, end
    return position_m - 0.5 * speed_m_s**2 / acceleration_m_s2, 0.0


def actuate(state: VehicleState, wanted: Command, limiter: CommandLimiter) -> VehicleState:
    """Carry out a command for a second, within the limits of the actuators."""
    command, _ = limiter.limit(wanted, state)
    position, speed = roll(state.position_m, state.speed_m_s, command.acceleration_m_s2)
    return replace(
        state,
        time_s=state.time_s + 1.0,
        position_m=position,
        speed_m_s=speed,
        acceleration_m_s2=command.acceleration_m_s2 if speed > 0.0 else 0.0,
        compressor_power_w=command.compressor_power_w,
    )


def follow(state: VehicleState, leaders: Iterator[LeaderState]) -> Iterator[float]:
    """Gap at the end of every second behind a leader."""
    limiter = CommandLimiter(PARAMETERS.limits, 1.0)
    leader = next(leaders)
    for after in leaders:
        state = actuate(state, safe_following(state, leader, PARAMETERS), limiter)
        leader = after
        yield leader.position_m - state.position_m


def stopping_distance_m(
    speed_m_s: float, acceleration_m_s2: float, limits: LimitParameters
) -> float:
    """Way to standstill with the brakes applied as fast as the jerk limit permits."""
    position, speed, acceleration = 0.0, speed_m_s, acceleration_m_s2
    while speed > 0.0:
        acceleration = max(acceleration - limits.max_jerk_m_s3, limits.min_acceleration_m_s2)
        position, speed = roll(position, speed, acceleration)
    return position


def test_free_road_and_tight_gap() -> None:
    state = make_state(speed_m_s=10.0)
    free = safe_following(state, make_leader(1e6, 20.0), PARAMETERS)
    assert free.acceleration_m_s2 == pytest.approx(2.0 * (1.0 - (10.0 / 37.5) ** 4), abs=1e-6)
    for gap in (3.0, 0.0, -0.5):
        tight = safe_following(state, make_leader(gap, 10.0), PARAMETERS)
        assert tight.acceleration_m_s2 == PARAMETERS.limits.min_acceleration_m_s2
    at_top = safe_following(make_state(speed_m_s=37.5), make_leader(1e6, 37.5), PARAMETERS)
    assert at_top.acceleration_m_s2 <= 0.0


@pytest.mark.parametrize("cycle", sorted(CYCLE_NAMES))
def test_drives_the_published_cycles_without_touching(cycle: str) -> None:
    route = build_route(cycle, "flat", initial_gap_m=PARAMETERS.gap.initial_gap_m)
    leaders = (route.leader.state_at(float(t)) for t in range(int(route.duration_s) + 1))
    start = make_state(time_s=0.0, position_m=0.0, speed_m_s=0.0)
    assert min(follow(start, leaders)) > 0.0


def erratic_leader(
    rng: np.random.Generator, gap_m: float, speed_m_s: float
) -> Iterator[LeaderState]:
    """Speeds up and brakes at random, down to the hardest braking, for three minutes."""
    position, speed, acceleration = gap_m, speed_m_s, 0.0
    for tick in range(180):
        yield LeaderState(float(tick), position, speed)
        if rng.random() < 0.2:
            acceleration = float(rng.uniform(-LEADER_BRAKING_M_S2, 2.0))
        if rng.random() < 0.03:
            acceleration = -LEADER_BRAKING_M_S2
        position, speed = roll(position, speed, min(acceleration, 36.0 - speed))


def test_never_touches_a_leader_that_brakes_no_harder_than_itself() -> None:
    """From any situation in which a stop behind the stopping leader is possible at all."""
    for seed in range(300):
        rng = np.random.default_rng(seed)
        speed, leader_speed = (float(rng.uniform(0.0, 33.0)) for _ in range(2))
        way = stopping_distance_m(speed, 0.0, PARAMETERS.limits)
        gap = max(way - leader_speed**2 / (2.0 * LEADER_BRAKING_M_S2), 0.0) + rng.uniform(3.0, 30.0)
        start = make_state(time_s=0.0, position_m=0.0, speed_m_s=speed)
        leader = erratic_leader(rng, gap, leader_speed)
        assert min(follow(start, leader)) > 0.0, f"seed {seed}"


@pytest.mark.parametrize("speed", [5.0, 15.0, 25.0, 33.0])
def test_stops_a_standstill_gap_behind_a_leader_that_stops(speed: float) -> None:
    """From steady following, where the intelligent driver model alone is much closer."""
    positions, speeds = [3.0 * speed + 5.0], [speed]
    for tick in range(200):
        braking = 0.0 if tick < 100 else -LEADER_BRAKING_M_S2
        position, slower = roll(positions[-1], speeds[-1], braking)
        positions.append(position)
        speeds.append(slower)
    leaders = (
        LeaderState(float(tick), *motion)
        for tick, motion in enumerate(zip(positions, speeds, strict=True))
    )
    start = make_state(time_s=0.0, position_m=0.0, speed_m_s=speed)
    gaps = list(follow(start, leaders))
    assert min(gaps) > PARAMETERS.gap.standstill_gap_m - 0.5


def test_room_to_stop_counts_the_tick_ahead() -> None:
    """The longer a command holds, the earlier it brakes."""
    state, leader = make_state(speed_m_s=20.0), make_leader(60.0, 20.0)
    quick, slow = (
        safe_following(state, leader, PARAMETERS, tick_s).acceleration_m_s2 for tick_s in (0.2, 1.0)
    )
    assert slow < 0.0 < quick


@given(speed=st.floats(1.0, 30.0))
@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
def test_settles_behind_a_steady_leader(speed: float) -> None:
    leaders = (LeaderState(float(t), 100.0 + speed * t, speed) for t in range(800))
    start = make_state(time_s=0.0, position_m=0.0, speed_m_s=speed)
    gaps = list(follow(start, leaders))
    assert max(gaps[-20:]) - min(gaps[-20:]) < 0.1
    assert gaps[-1] >= PARAMETERS.gap.standstill_gap_m


def test_thermostat_rises_with_the_warmer_cell() -> None:
    powers = []
    for excess_k in (-10.0, 0.0, 1.5, 3.0, 6.0, 20.0):
        warm = THERMOSTAT_ON_K + excess_k
        one = thermostat_power_w(make_state(cell_1_temperature_k=warm - 2.0,
                                            cell_n_temperature_k=warm), PARAMETERS)  # fmt: skip
        other = thermostat_power_w(make_state(cell_1_temperature_k=warm,
                                              cell_n_temperature_k=warm - 2.0), PARAMETERS)  # fmt: skip
        assert one == other
        powers.append(one)
    expected = [0.0, 0.0, 0.25, 0.5, 1.0, 1.0]
    assert powers == pytest.approx([share * THERMOSTAT_POWER_W for share in expected])


@given(speed=st.floats(0.0, 37.5), acceleration=st.floats(-2.0, 2.0))
@settings(max_examples=50)
def test_controlled_stop_halts_within_the_jerk_limit(speed: float, acceleration: float) -> None:
    limiter = CommandLimiter(PARAMETERS.limits, 1.0)
    state = make_state(speed_m_s=speed, acceleration_m_s2=acceleration)
    speeds = [speed]
    for _ in range(120):
        wanted = controlled_stop(state, PARAMETERS, 1.0)
        # The stop keeps the rates by itself, unless the top speed asks for more than the jerk limit.
        reasons = set(limiter.limit(wanted, state)[1])
        assert reasons <= {"compressor rate"} or "top speed" in reasons
        state = actuate(state, wanted, limiter)
        speeds.append(state.speed_m_s)
        if state.speed_m_s == 0.0:
            break
    assert speeds[-1] == 0.0
    # Once it brakes it goes on braking.
    slower = np.diff(speeds) <= 0.0
    assert slower[int(np.argmax(slower)) :].all()
