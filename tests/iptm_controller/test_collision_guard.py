"""The last word on driving: no collision that the brakes could avoid, and no braking without need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import (
    FLAT,
    PARAMETERS,
    FailingSolver,
    make_preview,
    make_scene,
    plain_solver,
)

from iptm_controller.controller import MpcController
from iptm_controller.decision import Decision
from iptm_controller.forecast import LeaderForecast, PreviewQuality
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_controller.safeguards import EMERGENCY, MARGIN_M, CollisionGuard
from iptm_controller.tick_library import tick_library
from iptm_core.braking import RoadFrictionSettings
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.physics.car_following import minimum_gap_m
from iptm_core.state import LeaderPreview, LeaderState, VehicleState

LIMITS = PARAMETERS.limits
JERK_STEP_M_S2 = LIMITS.max_jerk_m_s3
Policy = Callable[[Measurements], float]


def make_controller(*, solving: bool = True) -> MpcController:
    backend = (
        plain_solver("3x1+5x5") if solving else FailingSolver(failure=SolveStatus.NUMERICAL_ERROR)
    )
    return MpcController(PARAMETERS, ControllerOptions(), backend)


def drive(policy: Policy, *, gap_m: float, speed_m_s: float, braking_m_s2: float) -> list[float]:
    """Return the gaps of 60 s, four a second, behind a leader that from 3 s on brakes without a warning.

    Its preview has constant speed throughout.
    """
    scene = make_scene(gap_m=gap_m, speed_m_s=speed_m_s, leader_speed_m_s=speed_m_s)
    ego, leader = scene.state, scene.leader
    gaps = []
    for tick in range(60):
        frozen = make_preview(replace(leader, speed_m_s=speed_m_s))
        acceleration = policy(Measurements(ego, leader, frozen, FLAT))
        leader_acceleration = -braking_m_s2 if tick >= 3 else 0.0
        for _ in range(4):
            ego, leader = moved(ego, acceleration), moved_leader(leader, leader_acceleration)
            gaps.append(leader.position_m - ego.position_m)
    return gaps


def moved(ego: VehicleState, acceleration_m_s2: float, step_s: float = 0.25) -> VehicleState:
    before, after = ego.speed_m_s, max(ego.speed_m_s + acceleration_m_s2 * step_s, 0.0)
    return replace(
        ego,
        time_s=ego.time_s + step_s,
        position_m=ego.position_m + 0.5 * (before + after) * step_s,
        speed_m_s=after,
        acceleration_m_s2=acceleration_m_s2 if after > 0.0 else 0.0,
    )


def moved_leader(
    leader: LeaderState, acceleration_m_s2: float, step_s: float = 0.25
) -> LeaderState:
    after = max(leader.speed_m_s + acceleration_m_s2 * step_s, 0.0)
    distance_m = 0.5 * (leader.speed_m_s + after) * step_s
    return LeaderState(leader.time_s + step_s, leader.position_m + distance_m, after)


def driven_by(controller: MpcController) -> Policy:
    return lambda measured: controller.decide(measured).command.acceleration_m_s2


def hardest_once_seen(before: Policy, speed_m_s: float) -> Policy:
    """Braking in full from the first tick in which the leader is measured slower."""
    last: list[float] = []

    def policy(measured: Measurements) -> float:
        if measured.leader.speed_m_s == speed_m_s:
            return before(measured)
        now = last[-1] if last else measured.state.acceleration_m_s2
        last.append(max(now - JERK_STEP_M_S2, LIMITS.min_acceleration_m_s2))
        return last[-1]

    return policy


@pytest.mark.parametrize("braking_m_s2", [2.0, 8.0])
@pytest.mark.parametrize("speed_m_s", [8.0, 30.0])
@pytest.mark.parametrize("headway_s", [1.0, 1.5, 3.0])
@pytest.mark.parametrize("solving", [True, False])
def test_no_collision_that_the_brakes_could_avoid(
    speed_m_s: float, headway_s: float, braking_m_s2: float, *, solving: bool
) -> None:
    gap_m = 5.0 + headway_s * speed_m_s
    scene = {"gap_m": gap_m, "speed_m_s": speed_m_s, "braking_m_s2": braking_m_s2}
    braking = hardest_once_seen(driven_by(make_controller(solving=solving)), speed_m_s)
    best = min(drive(braking, **scene))
    smallest = min(drive(driven_by(make_controller(solving=solving)), **scene))
    if best > MARGIN_M:
        assert smallest > 0.0
    else:
        # What cannot be avoided is at least not made worse.
        assert smallest > best - 0.1


def decide(controller: MpcController, *leaders: tuple[float, float], **ego: float) -> Decision:
    """Return the decision after ticks with these gaps and leader speeds; the ego vehicle keeps its speed."""
    decision = None
    for tick, (gap_m, leader_speed_m_s) in enumerate(leaders):
        scene = make_scene(
            gap_m=gap_m,
            leader_speed_m_s=leader_speed_m_s,
            time_s=100.0 + tick,
            position_m=1000.0 + tick * ego.get("speed_m_s", 15.0),
            **ego,
        )
        decision = controller.decide(scene)
    return decision


@pytest.mark.parametrize("solving", [True, False])
@pytest.mark.parametrize("gap_m", [0.7, -0.5, -3.0])
def test_brakes_never_ease_off_before_or_after_the_touch(gap_m: float, *, solving: bool) -> None:
    decision = decide(
        make_controller(solving=solving), (gap_m, 0.0), speed_m_s=5.6, acceleration_m_s2=-2.0
    )
    assert decision.command.acceleration_m_s2 == pytest.approx(-2.0)
    assert decision.rung is Rung.EMERGENCY_BRAKING
    assert decision.reason.startswith(EMERGENCY)


def test_a_leader_lost_in_an_emergency_is_still_there() -> None:
    controller = make_controller()
    decide(controller, (30.0, 12.0), (20.0, 4.0), speed_m_s=12.0, acceleration_m_s2=-0.5)
    blind = replace(
        make_scene(time_s=102.0, position_m=1012.0, speed_m_s=11.5, acceleration_m_s2=-1.0),
        leader=None,
    )
    decision = controller.decide(blind)
    assert decision.rung is Rung.EMERGENCY_BRAKING
    assert decision.command.acceleration_m_s2 == pytest.approx(-1.5)


def test_a_leader_not_measured_for_long_may_have_braked() -> None:
    controller = make_controller()
    decide(controller, (35.0, 15.0), (35.0, 15.0))
    rungs = []
    for tick in range(1, 6):
        blind = make_scene(time_s=101.0 + tick, position_m=1000.0 + 15.0 * tick)
        rungs.append(controller.decide(replace(blind, leader=None)).rung)
    assert rungs == [Rung.SHIFTED_PLAN] * 3 + [Rung.EMERGENCY_BRAKING] * 2


def test_creeping_into_a_standing_leader_is_stopped() -> None:
    limits = PARAMETERS.limits
    guard = CollisionGuard(limits, 1.0, 3)
    scene = make_scene(gap_m=1.1, leader_speed_m_s=0.0, speed_m_s=0.0)
    guard.observe(scene.leader)
    threatens = [guard.collision_threatens(a, scene.state, None) for a in (-0.5, 0.0, 0.5)]
    assert threatens == [False, False, True]


def test_a_leader_that_pulls_away_is_no_emergency() -> None:
    decision = decide(make_controller(), (0.8, 9.0), (0.8, 9.0), speed_m_s=6.0)
    assert decision.rung is Rung.OPTIMAL


def test_closer_than_s_min_is_no_emergency_with_a_confirmed_preview() -> None:
    """With a preview the optimiser may follow closer than behind a leader of unknown intentions."""
    gap_m = 0.8 * float(minimum_gap_m(20.0, 20.0, PARAMETERS.gap, LIMITS))
    decision = decide(make_controller(), (gap_m, 20.0), (gap_m, 20.0), speed_m_s=20.0)
    assert decision.rung is Rung.OPTIMAL


def watching(leader_m: float, *speeds_m_s: float) -> tuple[CollisionGuard, VehicleState]:
    """Return a guard that has measured these speeds of a leader at a place, and an ego vehicle at 10 m/s."""
    guard = CollisionGuard(LIMITS, 1.0, 3)
    for tick, speed_m_s in enumerate(speeds_m_s):
        guard.observe(LeaderState(99.0 + tick, leader_m, speed_m_s))
    state = make_scene(speed_m_s=10.0, position_m=0.0, time_s=98.0 + len(speeds_m_s)).state
    return guard, state


def test_weak_brakes_count_in_the_way_to_standstill() -> None:
    guard, state = watching(55.0, 0.0)
    threatens = [guard.collision_threatens(-1.0, state, None, share) for share in (1.0, 0.4)]
    assert threatens == [False, True]


@pytest.mark.parametrize(("leader_m", "threatens"), [(32.81, True), (32.815, False)])
def test_a_metre_is_left_where_both_stand(leader_m: float, *, threatens: bool) -> None:
    """9.5 + 8.25 + 6.5 + 4.5 + 2.5 m in five seconds, then 0.5625 m in 0.75 s: 31.8125 m."""
    guard, state = watching(leader_m, 0.0, 0.0)
    assert guard.collision_threatens(-1.0, state, None) is threatens


def test_a_leader_that_brakes_stands_where_it_has_halted() -> None:
    # Braking from -1 m/s^2 the ego vehicle stops after 31.8 m; the gap must not fall below 1 m.
    threatens = []
    for leader_m in (31.0, 30.0):
        guard, state = watching(leader_m, 10.0, 5.0)
        assert guard.deceleration_m_s2 == 5.0
        threatens.append(guard.collision_threatens(-1.0, state, None))
    assert threatens == [False, True], "it halts after 2.5 m and stays there"


@pytest.mark.parametrize(
    ("known_s", "predicted_m_s", "threatens"),
    [
        (20.0, 10.0, True),
        (20.0, 1.6, True),
        (20.0, 1.4, False),
        (2.9, 0.5, True),
        (3.1, 0.5, False),
        (20.0, 0.5, False),
    ],
)
def test_a_preview_that_is_not_confirmed_counts_no_more_than_what_is_measured(
    known_s: float, predicted_m_s: float, *, threatens: bool
) -> None:
    guard, state = watching(20.0, 0.5, 0.5)
    times = state.time_s + np.arange(21.0)
    moving = predicted_m_s * np.arange(21.0) + 2.0 * np.arange(21.0) ** 2
    motion = LeaderPreview(times, 20.0 + moving, predicted_m_s + 4.0 * np.arange(21.0))
    forecast = LeaderForecast(motion, motion, PreviewQuality.FULL, "", 0.0, known_s)
    assert guard.collision_threatens(0.0, state, forecast) is threatens


@pytest.mark.parametrize(("leader_m", "threatens"), [(16.81, True), (16.815, False)])
def test_beyond_a_preview_the_leader_keeps_the_deceleration_of_its_end(
    leader_m: float, *, threatens: bool
) -> None:
    """12 m at 4 m/s, 3 m while it slows to 2 m/s, 1 m until it stands; the ego vehicle takes 31.8125 m."""
    guard, state = watching(leader_m, 4.0, 4.0)
    times_s = state.time_s + np.array([0.0, 3.0, 4.0])
    motion = LeaderPreview(times_s, leader_m + np.array([0.0, 12.0, 15.0]), np.array([4.0, 4, 2]))
    forecast = LeaderForecast(motion, motion, PreviewQuality.SHORT, "", 0.0, 4.0)
    assert guard.collision_threatens(-1.0, state, forecast) is threatens


@pytest.mark.parametrize("in_c", [False, True])
def test_a_preview_that_announces_no_braking_never_asks_for_more_than_none(*, in_c: bool) -> None:
    """Random states, previews that slow down no faster than the leader was measured to, and known times."""
    library = tick_library() if in_c else None
    if in_c and library is None:
        pytest.skip("no C compiler on this machine")
    rng = np.random.default_rng(50)
    found = set()
    for _ in range(200):
        tick_s, step_s = rng.choice([0.1, 0.5, 1.0], 2)
        start_s, speed_m_s, gap_m = rng.uniform([0.0, 0.0, 1.0], [2000.0, 30.0, 90.0])
        braking_m_s2 = float(rng.choice([0.0, rng.uniform(0.0, 3.0)]))
        guard = CollisionGuard(LIMITS, float(tick_s), 3, library)
        for ticks, faster_m_s in ((1, braking_m_s2 * tick_s), (0, 0.0)):
            seen_s = start_s - ticks * tick_s
            guard.observe(LeaderState(seen_s, 500.0, float(speed_m_s + faster_m_s)))
        gained = rng.exponential(rng.choice([0.0, 0.3]), 300) - guard.deceleration_m_s2
        speeds = np.maximum(speed_m_s + np.append(0.0, np.cumsum(gained * step_s)), 0.0)
        moved_m = np.append(0.0, np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * step_s))
        motion = LeaderPreview(start_s + step_s * np.arange(301), 500.0 + moved_m, speeds)
        state = make_scene(speed_m_s=float(rng.uniform(0.0, 30.0)), position_m=500.0 - gap_m).state
        state = replace(state, time_s=start_s + float(rng.choice([0.0, 0.7])))
        for known_s in (0.0, 1e-6, *rng.uniform(0.0, 30.0, 4), *rng.uniform(0.0, 3.0, 4)):
            known = LeaderForecast(motion, motion, PreviewQuality.SHORT, "", 0.0, float(known_s))
            for asked_m_s2 in (-2.0, -0.5, 0.0, 1.0):
                threats = [
                    guard.collision_threatens(asked_m_s2, state, forecast)
                    for forecast in (known, None)
                ]
                assert threats != [True, False], (known_s, asked_m_s2)
                found.add(tuple(threats))
    assert found == {(True, True), (False, True), (False, False)}


def test_on_ice_the_guard_brakes_from_farther_away() -> None:
    """0.8 m/s² from 15 to 5 m/s in 60 m would do, but ice permits only a part of the hardest braking."""
    scene = make_scene(gap_m=60.0, speed_m_s=15.0, leader_speed_m_s=5.0)
    for friction, rung in ((0.0, Rung.OPTIMAL), (0.1, Rung.EMERGENCY_BRAKING)):
        road = RoadFrictionSettings(road_friction=friction)
        controller = MpcController(
            PARAMETERS, ControllerOptions(road=road), plain_solver("3x1+5x5")
        )
        assert controller.decide(scene).rung is rung
