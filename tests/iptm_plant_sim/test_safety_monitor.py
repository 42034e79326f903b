"""The safety monitor brakes below the RSS safe distance and releases with hysteresis, as the road permits."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.iptm_plant_sim.scenes import (
    BRAKES,
    COAST,
    MONITOR,
    PARAMETERS,
    ROAD,
    SETTINGS,
    driving,
    lead_at,
)

from iptm_core.braking import BrakingCapability, SafetyMonitorSettings
from iptm_core.errors import ParameterError
from iptm_core.state import FloatArray, LeaderState
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.safety_monitor import (
    WAITED_S,
    MonitorMemory,
    SafetyMonitor,
    stopping_distance_m,
    with_delivery,
)

SPEEDS = st.floats(0.0, 37.0)


def test_the_safe_distance_is_that_of_the_rule() -> None:
    # 20 m/s, 0.5 s + 0.1 s without braking: 12 m. 0.7 s until -7 m/s^2 at 10 m/s^3: 20 * 0.7 - 10 * 0.343 / 6
    # = 13.428 m, down to 17.55 m/s. 17.55^2 / 14 = 22.000 m. The one ahead: 400 / 18 = 22.222 m. Margin: 1 m.
    assert MONITOR.safe_distance_m(20.0, 0.0, 20.0) == pytest.approx(26.206, abs=1e-3)
    # At 2 m/s^2: 0.6 * 20 + 0.36 = 12.36 m, 21.2 m/s; 0.9 s: 19.08 + 0.81 - 1.215 m, 18.95 m/s; 25.650 m.
    assert MONITOR.safe_distance_m(20.0, 2.0, 0.0) == pytest.approx(57.685, abs=1e-3)
    # Halts while the brakes build up: 0.6 m, then 0.4472 s, 1 * 0.4472 - 10 * 0.08944 / 6 = 0.2981 m.
    assert MONITOR.safe_distance_m(1.0, 0.0, 0.0) == pytest.approx(1.898, abs=1e-3)
    # Halts while it reacts: 1 / 4 m.
    assert stopping_distance_m(1.0, -2.0, 0.6, 7.0, 10.0) == pytest.approx(0.25)
    assert MONITOR.safe_distance_m(0.0, 0.0, 0.0) == 0.0, "no distance needed at standstill"
    assert MONITOR.safe_distance_m(10.0, 0.0, 30.0) == SETTINGS.monitor_margin_m
    with pytest.raises(ParameterError, match=r"monitor_own_deceleration_m_s2 is 9\.5"):
        SafetyMonitorSettings(monitor_own_deceleration_m_s2=9.5)


@given(st.floats(0.1, 37.0), SPEEDS, st.floats(-2.0, 2.0), st.floats(0.3, 1.0))
@settings(max_examples=30, deadline=None)
def test_from_the_safe_distance_the_worst_case_leaves_the_margin(
    speed: float, lead_speed: float, acceleration: float, share: float
) -> None:
    gap = MONITOR.safe_distance_m(speed, acceleration, lead_speed, share)
    smallest, step_s, reaction_s = gap, 2e-3, SETTINGS.monitor_reaction_s + BRAKES.delay_s
    a, time_s = acceleration, 0.0
    while speed > 0.0 and time_s < 60.0:
        if time_s >= reaction_s - 1e-9:
            a = max(a - 10.0 * share * step_s, -7.0 * share)
        ahead, lead_ahead = max(speed + a * step_s, 0.0), max(lead_speed - 9.0 * step_s, 0.0)
        gap += 0.5 * step_s * (lead_speed + lead_ahead - speed - ahead)
        speed, lead_speed, time_s = ahead, lead_ahead, time_s + step_s
        smallest = min(smallest, gap)
    assert smallest >= SETTINGS.monitor_margin_m - 0.3


@given(SPEEDS, SPEEDS, st.floats(0.5, 120.0))
@settings(max_examples=30, deadline=None)
def test_it_brakes_at_the_first_check_that_the_rule_fails_and_never_before(
    speed: float, lead_speed: float, gap: float
) -> None:
    plant, state = driving(speed)
    plant.watch(lead_at(gap, lead_speed))
    step = plant.advance(state, COAST)
    still = speed < 1e-3
    times = 0.1 * np.arange(10)
    gaps = gap + (lead_speed - (0.0 if still else speed)) * times
    motion = (0.0 if still else speed, 0.0, lead_speed, 1.0, 0.0)
    full_m = MONITOR.safe_distance_m(*motion, ROAD.full)
    assert ROAD.slippery is not None
    gently_m = MONITOR.safe_distance_m(*motion, ROAD.slippery)
    failed = np.flatnonzero(gaps < max(full_m, gently_m))
    if not failed.size:
        assert step.safety.service_braking_s == 0.0
        assert not step.memory.braking
        return
    # While it brakes the gap may grow enough for the release: never before the hold is over.
    least_s = min(1.0 - times[failed[0]], SETTINGS.monitor_hold_s)
    assert step.safety.service_braking_s >= least_s - 1e-9
    assert step.memory.since_s == pytest.approx(times[failed[0]])


@given(SPEEDS, SPEEDS, st.floats(-5.0, 120.0), st.floats(0.0, 5.0), st.floats(-2.0, 2.0))
def test_it_releases_only_behind_the_hold_and_with_further_reaction_time(
    speed: float, lead_speed: float, gap: float, since_s: float, command: float
) -> None:
    memory = MonitorMemory(braking=True, since_s=5.0 - since_s, requested_m_s2=-8.0)
    lead = LeaderState(5.0, gap, lead_speed)
    judged = MONITOR.judge(memory, 5.0, (0.0, speed, command), lead, ROAD)
    assert ROAD.slippery is not None
    motion = (speed, max(command, 0.0), lead_speed, 1.0, 0.5)
    held = since_s >= SETTINGS.monitor_hold_s - 1e-9
    full_enough = gap >= MONITOR.safe_distance_m(*motion, ROAD.full)
    enough = full_enough and gap >= MONITOR.safe_distance_m(*motion, ROAD.slippery)
    assert judged.braking is not (enough and held)
    assert judged.gently is (judged.braking and full_enough and held)


def test_gentle_braking_becomes_full_at_the_distance_of_full_braking_and_without_a_new_delay() -> (
    None
):
    gently = MonitorMemory(braking=True, gently=True, since_s=4.0, reason="gentle")
    full_m = MONITOR.safe_distance_m(20.0, 0.0, 12.0)
    for gap_m, fully in ((full_m + 0.1, False), (full_m - 0.1, True)):
        lead = LeaderState(4.2, gap_m, 12.0)
        judged = MONITOR.judge(gently, 4.2, (0.0, 20.0, 0.0), lead, ROAD)
        assert judged.braking
        assert judged.gently is not fully
        assert judged.since_s == 4.0
        assert ("below the safe distance" in judged.reason) is fully


def test_the_present_acceleration_counts_when_it_begins_to_brake() -> None:
    speeding_m = MONITOR.safe_distance_m(20.0, 1.5, 20.0)
    lead = LeaderState(0.0, speeding_m - 0.1, 20.0)
    assert MONITOR.judge(MonitorMemory(), 0.0, (0.0, 20.0, 1.5), lead, ROAD).braking
    assert not MONITOR.judge(MonitorMemory(), 0.0, (0.0, 20.0, 0.0), lead, ROAD).braking


def test_on_a_free_road_brakes_are_released_after_the_hold() -> None:
    braking = MonitorMemory(braking=True, since_s=4.0)
    assert MONITOR.judge(braking, 4.3, (0.0, 20.0, 0.0), None, ROAD).braking
    assert not MONITOR.judge(braking, 4.5, (0.0, 20.0, 0.0), None, ROAD).braking


def test_a_measurement_awaited_for_long_leaves_the_rest_of_the_reaction_time() -> None:
    waited_m = MONITOR.safe_distance_m(20.0, 0.0, 20.0, further_reaction_s=-WAITED_S)
    motion = (20.0, 0.0, 20.0, 1.0, ROAD)
    for waited_s in (WAITED_S, 3.0):
        assert MONITOR.is_unsafe(waited_m - 0.1, *motion, waited_s)
        lead = LeaderState(9.0, waited_m - 0.1, 20.0)
        assert MONITOR.judge(MonitorMemory(), 9.0, (0.0, 20.0, 0.0), lead, ROAD, waited_s).braking


def test_gentle_requests_and_a_halt_say_nothing_of_the_brakes() -> None:
    memory = MonitorMemory(brake_share=0.8)
    assert with_delivery(memory, -0.2, 0.0, 20.0, 1.0) is memory
    assert with_delivery(memory, -2.0, 0.0, 0.0, 1.0) is memory
    for requested_m_s2, speed_m_s, counts in (
        (-0.29, 20.0, False),
        (-0.31, 20.0, True),
        (-2.0, 0.49, False),
        (-2.0, 0.51, True),
    ):
        learned = with_delivery(memory, requested_m_s2, 0.0, speed_m_s, 1.0)
        assert (learned is not memory) is counts, (requested_m_s2, speed_m_s)


@pytest.mark.parametrize(
    ("share", "followed_m_s2", "road_m_s2"), [(0.96, 2.0, 0.0), (0.94, 0.0, 0.0), (0.94, 1.6, 1.88)]
)
def test_brakes_that_deliver_95_percent_follow_and_less_is_road_or_brakes(
    share: float, followed_m_s2: float, road_m_s2: float
) -> None:
    """What exceeds 1.2 times an earlier deceleration by little is the limit of the road."""
    earlier = MonitorMemory(followed_m_s2=1.6 if road_m_s2 else 1.5)
    learned = with_delivery(earlier, -2.0, -2.0 * share, 20.0, 1.0)
    assert (learned.followed_m_s2, learned.road_m_s2) == pytest.approx((followed_m_s2, road_m_s2))
    assert (learned.brake_share == 1.0) is bool(road_m_s2)


def test_on_a_known_road_both_vehicles_brake_as_it_permits() -> None:
    wet = SafetyMonitor(SafetyMonitorSettings(road_friction=0.35), BRAKES)
    road = wet.road_braking()
    assert road.slippery is None, "nothing is left to be guessed"
    # 0.35 * 9.81 = 3.4335 m/s^2 of the tyres, of which 7/8 are relied on.
    assert road.full == BrakingCapability(pytest.approx(3.0043, abs=1e-4), pytest.approx(3.4335))
    down = wet.road_braking(slope_rad=-0.1)
    tyres, along = 0.35 * 9.81 * math.cos(0.1), 9.81 * math.sin(0.1)
    assert down.full.own_m_s2 == pytest.approx(0.875 * tyres - along)
    assert down.full.lead_m_s2 == pytest.approx(tyres - along)
    assert MONITOR.road_braking().full == BrakingCapability(7.0, 9.0)


def test_usual_braking_downhill_is_no_sign_of_better_grip() -> None:
    """1.4 * 1.055 * 2.75 = 4.06 m/s^2; a descent of 10 % takes 0.98 m/s^2 of what a slippery road gives."""
    level, down = MONITOR.road_braking(), MONITOR.road_braking(slope_rad=-0.1)
    assert down.descent is not None
    assert down.descent.lead_m_s2 == pytest.approx(1.055 * 2.75 - 9.81 * math.sin(0.1))
    assert down.behind(4.0) == down
    assert down.behind(4.1) != down
    assert level.better_grip_m_s2 == down.better_grip_m_s2 == pytest.approx(4.06, abs=0.01)


def test_on_a_road_that_may_be_slippery_a_descent_counts_beyond_the_reaction_time() -> None:
    """By hand: 0.6 s at 10 m/s, 2.715 m in 0.275 s until 2.75 m/s^2, 16.83 m from 9.62 m/s; margin 1 m.

    Down 10 %: 0.1 s at 10 m/s, 1.765 m in 0.177 s until 1.77 m/s^2, 27.31 m from 9.84 m/s.
    """
    level, down = MONITOR.road_braking(), MONITOR.road_braking(slope_rad=-math.atan(0.1))
    motion = (10.0, 0.0, 6.0, 1.0, 0.0)  # ahead 36 / 5.80 and 36 / 3.85 m
    level_m = MONITOR.slippery_distance_m(*motion, level)
    assert level_m == pytest.approx(6.0 + 2.715 + 16.83 - 6.20 + 1.0, abs=0.02)
    down_m = MONITOR.slippery_distance_m(*motion, down)
    assert down_m == pytest.approx(1.0 + 1.765 + 27.31 - 9.35 + 1.0, abs=0.02)
    # At equal speeds the reserve of the reaction time is the longer one.
    equal = (10.0, 0.0, 10.0, 1.0, 0.0)
    assert MONITOR.slippery_distance_m(*equal, down) == MONITOR.slippery_distance_m(*equal, level)


def test_stated_accuracy_takes_the_vehicle_ahead_nearer_and_slower() -> None:
    stated = SafetyMonitor(
        SafetyMonitorSettings(gap_accuracy_m=5.0, lead_speed_accuracy_m_s=2.0), BRAKES
    )
    exact_m = MONITOR.safe_distance_m(20.0, 0.0, 18.0)
    assert stated.safe_distance_m(20.0, 0.0, 20.0) == pytest.approx(exact_m + 5.0)


@pytest.mark.parametrize("slope_rad", [0.0, -0.08])
@pytest.mark.parametrize("friction", [0.33, 0.5, 0.9])
@pytest.mark.parametrize("prior", [0.0, 1.0])
def test_behind_a_vehicle_on_the_same_road_it_stops_in_time(
    slope_rad: float, friction: float, prior: float
) -> None:
    along_m_s2 = 9.81 * math.sin(slope_rad)
    hardest_m_s2 = min(8.0, friction * 9.81 * math.cos(slope_rad)) + along_m_s2
    for share in (0.5, 1.0):
        for speed in (8.0, 20.0, 33.0):
            safety = SafetyMonitorSettings(road_friction=prior * friction)
            plant = Plant(PARAMETERS, lambda x: np.full_like(x, slope_rad), safety=safety)
            plant.road_friction = friction
            state = plant.initial_state(speed_m_s=speed)
            road = plant.monitor.road_braking(slope_rad)
            gap = max(
                plant.monitor.safe_distance_m(speed, 0.0, speed, capability=each) + 0.5
                for each in (road.full, road.slippery or road.full)
            )
            plant.watch(lead_at(gap, speed, share * hardest_m_s2))
            while state.speed_m_s > 0.1 and state.time_s < 60.0:
                step = plant.advance(state, COAST)
                assert step.safety.smallest_gap_m > 0.0
                assert step.state.acceleration_m_s2 >= -hardest_m_s2 - 1e-9, (
                    "the road gives no more"
                )
                state = step.state
            assert state.speed_m_s <= 0.1


@pytest.mark.parametrize("deceleration_g", np.arange(0.05, 0.96, 0.15).round(2).tolist())
def test_on_the_grid_of_un_r157_a_braking_vehicle_ahead_is_not_hit(deceleration_g: float) -> None:
    """Car following of Annex 4, appendix 3: both at 12 to 128 km/h, from the own safe distance."""
    assert smallest_gaps_m(range(12, 129, 29), deceleration_g * 9.81).min() > 0.0


def smallest_gaps_m(speeds_km_h: Iterable[int], deceleration_m_s2: float) -> FloatArray:
    """Return the smallest gap behind vehicles that brake to rest from some speeds, shape (n,)."""
    gaps = []
    for speed_km_h in speeds_km_h:
        speed = speed_km_h / 3.6
        plant, state = driving(speed)
        capabilities = (ROAD.full, ROAD.slippery or ROAD.full)
        gap = max(
            MONITOR.safe_distance_m(speed, 0.0, speed, capability=one) for one in capabilities
        )
        plant.watch(lead_at(gap, speed, deceleration_m_s2))
        while state.speed_m_s > 0.1 and state.time_s < 120.0:
            step = plant.advance(state, COAST)
            gap, state = min(gap, step.safety.smallest_gap_m), step.state
        gaps.append(gap)
    return np.array(gaps)
