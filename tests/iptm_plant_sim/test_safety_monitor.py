"""The safety monitor brakes below the RSS safe distance, as the brakes can, and releases with hysteresis."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iptm_core.errors import ParameterError
from iptm_core.lead_track import LeadStatus, LeadTrack, clear_lane
from iptm_core.monitor_settings import SafetyMonitorSettings
from iptm_core.parameters import load_parameters
from iptm_core.physics.power_thermal import electric_traction_power_w
from iptm_core.road_friction import BrakingCapability
from iptm_core.saved_state import from_plain, to_plain
from iptm_core.state import Command, FloatArray, LeaderPreview, LeaderState, VehicleState
from iptm_plant_sim.lead_measurements import LeadMeasurements
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_step import PlantStep
from iptm_plant_sim.safety_monitor import (
    WAITED_S,
    MonitorMemory,
    SafetyMonitor,
    stopping_distance_m,
    with_delivery,
)

PARAMETERS = load_parameters().values
BRAKES = PARAMETERS.brakes
SETTINGS = SafetyMonitorSettings()
MONITOR = SafetyMonitor(SETTINGS, BRAKES)
ROAD = MONITOR.road_braking()
SPEEDS = st.floats(0.0, 37.0)
COAST = Command(0.0, 0.0)


def lead_at(
    position_m: float, speed_m_s: float, deceleration_m_s2: float = 0.0
) -> Callable[[VehicleState], LeaderPreview]:
    """Return a range sensor, 0.1 s between measurements, on a vehicle that brakes from 0 s on."""

    def sensor(state: VehicleState) -> LeaderPreview:
        times = state.time_s + 0.1 * np.arange(10)
        moving = times
        if deceleration_m_s2 > 0.0:
            moving = np.minimum(times, speed_m_s / deceleration_m_s2)
        positions = position_m + moving * (speed_m_s - 0.5 * deceleration_m_s2 * moving)
        return LeaderPreview(
            times, positions, np.maximum(speed_m_s - deceleration_m_s2 * times, 0.0)
        )

    return sensor


def driving(speed_m_s: float) -> tuple[Plant, VehicleState]:
    plant = Plant(PARAMETERS, np.zeros_like)
    return plant, plant.initial_state(speed_m_s=speed_m_s)


# --- the rule


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


# --- the vehicle under it


def test_brakes_act_after_their_delay_and_build_up_inside_the_interval() -> None:
    plant, state = driving(20.0)
    plant.watch(lead_at(20.0, 20.0))
    step = plant.advance(state, COAST)
    # 0.1 s at 20 m/s; 0.8 s down to -8 m/s^2: 16 - 10 * 0.512 / 6 m, 16.8 m/s; 0.1 s: 1.64 m, 16 m/s.
    assert step.state.speed_m_s == pytest.approx(16.0, abs=1e-9)
    assert step.state.position_m == pytest.approx(2.0 + 15.1467 + 1.64, abs=2e-3)
    assert step.state.acceleration_m_s2 == pytest.approx(-8.0)
    assert step.state.time_s == 1.0
    assert step.safety.service_braking_s == pytest.approx(1.0)
    assert step.safety.smallest_gap_m == pytest.approx(20.0, abs=1e-6)
    assert "gap 20.0 m is below the safe distance of 26.2 m at 20.0 m/s" in step.memory.reason


def test_energies_of_the_pieces_add_up_and_the_motor_takes_no_more_than_it_can() -> None:
    plant, state = driving(20.0)
    plant.watch(lead_at(20.0, 20.0))
    step = plant.advance(state, COAST)
    times = np.linspace(0.0, 1.0, 20001)
    acceleration = -np.clip(10.0 * (times - 0.1), 0.0, 8.0)
    speeds = (
        20.0
        + np.concatenate(([0.0], np.cumsum(0.5 * (acceleration[1:] + acceleration[:-1])))) / 20000
    )
    by_motor = np.maximum(acceleration, -BRAKES.regenerative_deceleration_m_s2)
    power = [
        float(electric_traction_power_w(v, a, 0.0, PARAMETERS))
        for v, a in zip(speeds, by_motor, strict=True)
    ]
    assert step.powers.traction_power_w == pytest.approx(float(np.mean(power)), rel=5e-3)
    regenerated = float(np.mean(np.minimum(power, 0.0)))
    assert step.regenerative_power_w == pytest.approx(regenerated, rel=5e-3)
    assert step.powers.auxiliary_power_w == PARAMETERS.cooling.auxiliary_power_w
    lost = step.state.cell_1_capacity_loss - state.cell_1_capacity_loss
    assert 0.0 < lost < 1e-6


def test_an_interval_without_need_is_bit_by_bit_that_of_a_vehicle_without_monitor() -> None:
    watched, state = driving(20.0)
    plain = Plant(PARAMETERS, np.zeros_like)
    watched.watch(lead_at(60.0, 20.0))
    for acceleration in (0.3, -0.2, -0.7, -1.2, -0.7):
        command = Command(acceleration, 300.0)
        step, expected = watched.advance(state, command), plain.advance(state, command)
        assert replace(step, memory=expected.memory, safety=expected.safety) == expected
        assert step.memory.brake_share == 1.0
        state = step.state


def test_brakes_are_held_across_the_end_of_an_interval() -> None:
    """It brakes from 0.9 s on; then the vehicle ahead leaves the lane."""
    assert ROAD.slippery is not None
    motion = (10.0, 0.0, 0.0, 1.0, 0.0)
    safe_m = max(MONITOR.safe_distance_m(*motion, road) for road in (ROAD.full, ROAD.slippery))
    plant, state = driving(10.0)
    plant.watch(lead_at(safe_m + 8.5, 0.0))
    step = plant.advance(state, COAST)
    assert step.memory.since_s == pytest.approx(0.9)
    plant.watch(lead_at(500.0, 20.0), step.memory)
    held = plant.advance(step.state, COAST)
    assert not held.memory.braking
    rest_s = SETTINGS.monitor_hold_s - 0.1
    assert rest_s - 1e-9 <= held.safety.service_braking_s < rest_s + 0.2  # released with a ramp


def test_after_an_intervention_commands_of_comfort_take_over() -> None:
    plant, state = driving(20.0)
    plant.watch(lead_at(20.0, 20.0, 0.0))
    braked = plant.advance(state, COAST)
    step = braked
    for _ in range(6):
        step = plant.advance(step.state, Command(-0.5, 0.0))
    assert not step.memory.braking
    assert step.safety.service_braking_s == 0.0
    assert -2.0 <= step.state.acceleration_m_s2 <= -0.5
    assert step.state.speed_m_s > 5.0


@pytest.mark.parametrize("deceleration", [2.0, 5.0, 9.0])
@pytest.mark.parametrize("strength", [1.0, 0.9])
def test_no_braking_of_the_vehicle_ahead_leads_to_a_collision(
    deceleration: float, strength: float
) -> None:
    for speed in (5.0, 20.0, 35.0):
        plant, state = driving(speed)
        plant.brake_strength = strength
        gap = MONITOR.safe_distance_m(speed, 0.0, speed) + 1.0
        plant.watch(lead_at(gap, speed, deceleration))
        smallest = gap
        while state.speed_m_s > 0.0:
            step = plant.advance(state, COAST)
            smallest = min(smallest, step.safety.smallest_gap_m)
            state = step.state
        assert smallest > 0.0


def test_where_only_a_slippery_road_calls_for_it_the_vehicle_brakes_with_what_that_gives() -> None:
    assert ROAD.slippery == BrakingCapability(2.75, pytest.approx(2.9, abs=2e-3))
    plant, state = driving(20.0)
    full_m = MONITOR.safe_distance_m(20.0, 0.0, 12.0, capability=ROAD.full)
    gently_m = MONITOR.safe_distance_m(20.0, 0.0, 12.0, capability=ROAD.slippery)
    assert gently_m > full_m + 15.0
    plant.watch(lead_at(gently_m - 1.0, 12.0))
    step = plant.advance(state, COAST)
    assert step.memory.gently
    # 7/8 of what it brakes with is what it relies on.
    assert step.state.acceleration_m_s2 == pytest.approx(-2.75 / 0.875)


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


def test_downhill_it_brakes_earlier() -> None:
    plant = Plant(PARAMETERS, lambda x: np.full_like(x, -0.1))
    state = plant.initial_state(speed_m_s=20.0)
    gap = MONITOR.safe_distance_m(20.0, 0.0, 20.0) + 1.0
    plant.watch(lead_at(gap, 20.0))
    assert plant.advance(state, COAST).safety.service_braking_s > 0.0
    level, state = driving(20.0)
    level.watch(lead_at(gap, 20.0))
    assert level.advance(state, COAST).safety.service_braking_s == 0.0


# --- weak brakes


@pytest.mark.parametrize("strength", [0.85, 0.6])
def test_weak_brakes_show_within_a_second_of_braking_in_comfort(strength: float) -> None:
    plant, state = driving(20.0)
    plant.brake_strength = strength
    plant.watch(lead_at(500.0, 20.0))
    step = plant.advance(state, Command(-0.5, 0.0))
    assert step.safety.brake_share == pytest.approx(strength, abs=0.05)
    plant.brake_strength = 1.0
    for _ in range(3):
        step = plant.advance(step.state, Command(-1.0, 0.0))
    assert step.safety.brake_share > 0.98, "brakes that recover are relied on again"
    assert MONITOR.safe_distance_m(20.0, 0.0, 20.0, 0.6) > MONITOR.safe_distance_m(20.0, 0.0, 20.0)


def test_gentle_requests_and_a_halt_say_nothing_of_the_brakes() -> None:
    memory = MonitorMemory(brake_share=0.8)
    assert with_delivery(memory, -0.2, 0.0, 20.0, 1.0) is memory
    assert with_delivery(memory, -2.0, 0.0, 0.0, 1.0) is memory


# --- slippery roads


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


def test_a_road_that_gives_no_more_is_not_a_share_of_the_brakes() -> None:
    plant, state = driving(25.0)
    plant.road_friction = 0.32
    plant.watch(lead_at(10.0, 25.0))
    step = plant.advance(state, COAST)
    assert step.memory.road_m_s2 == pytest.approx(0.32 * 9.81, abs=1e-6)
    assert step.safety.brake_share > 0.99
    assert plant.monitor.road_braking(0.0, step.memory.road_m_s2).full.own_m_s2 < 3.14
    plant.road_friction = 0.0
    step = plant.advance(step.state, COAST)
    assert step.memory.road_m_s2 > 7.9, "a better road shows as well"


def test_stated_accuracy_takes_the_vehicle_ahead_nearer_and_slower() -> None:
    stated = SafetyMonitor(
        SafetyMonitorSettings(gap_accuracy_m=5.0, lead_speed_accuracy_m_s=2.0), BRAKES
    )
    exact_m = MONITOR.safe_distance_m(20.0, 0.0, 18.0)
    assert stated.safe_distance_m(20.0, 0.0, 20.0) == pytest.approx(exact_m + 5.0)


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


# --- measurements


def still(after_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.zeros_like(after_s), np.zeros_like(after_s)


def measured(*rows: tuple[float, float, float]) -> LeaderPreview:
    return LeaderPreview(*np.array(rows, dtype=float).reshape(-1, 3).T)


def test_a_vehicle_brakes_as_hard_as_it_can_from_the_first_measurement_that_is_missing() -> None:
    track = LeadMeasurements(LeadTrack(), measured((0.0, 50.0, 20.0)), still, 0.0).track
    known = LeadMeasurements(track, measured((1.0, 68.0, 16.0)), still, 1.0)
    assert known.at(1.0, 9.0) == (LeaderState(1.0, 68.0, 16.0), 0.0, True)
    lead, unseen_s, is_measured = known.at(1.5, 9.0)
    assert (lead, unseen_s, is_measured) == (LeaderState(1.5, 68.0 + 8.0 - 0.5, 14.0), 0.0, False)
    silent = LeadMeasurements(known.track, None, still, 2.0)
    # One measurement per second: the next one is missing from 2 s on, at 82 m and 12 m/s. Then 9 m/s^2.
    lead, unseen_s, _ = silent.at(3.0, 9.0)
    assert lead == LeaderState(3.0, pytest.approx(82.0 + 12.0 - 4.5), pytest.approx(3.0))
    assert unseen_s == pytest.approx(1.0)
    lead, _, _ = silent.at(60.0, 9.0)
    assert lead == LeaderState(60.0, pytest.approx(82.0 + 144.0 / 18.0), 0.0)


def test_an_empty_lane_is_free_when_it_has_been_empty_for_long_or_a_source_reports_it() -> None:
    track = LeadMeasurements(LeadTrack(), measured((0.0, 50.0, 20.0)), still, 0.0).track
    for now_s in range(1, 11):
        leads = LeadMeasurements(track, LeaderPreview.empty(), still, float(now_s))
        lead, _, _ = leads.at(now_s + 0.5, 9.0)
        assert lead is not None, f"lost at {now_s} s, not free"
        track = leads.track
    gone = LeadMeasurements(track, LeaderPreview.empty(), still, 11.0)
    assert gone.at(11.0, 9.0) == (None, 0.0, False)
    clear = LeadMeasurements(track, clear_lane(5.0), still, 5.0)
    assert clear.at(5.0, 9.0) == (None, 0.0, False)
    assert clear.bounds() is None


def test_a_frozen_sensor_is_worse_than_a_silent_one_only_until_its_third_measurement() -> None:
    plant, state = driving(20.0)
    sound = lead_at(60.0, 20.0)
    frozen = sound(replace(state, time_s=0.9))

    def sensor(now: VehicleState) -> LeaderPreview:
        if now.time_s < 1.0:
            return sound(now)
        times = now.time_s + 0.1 * np.arange(10)
        gap_m = float(frozen.positions_m[0]) - 18.0
        return LeaderPreview(times, np.full(10, now.position_m + gap_m), np.full(10, 20.0))

    plant.watch(sensor)
    for _ in range(2):
        step = plant.advance(state, COAST)
        state = step.state
    assert step.memory.lead.status(2.0) is LeadStatus.FROZEN
    assert step.memory.lead.seen == LeaderState(1.0, pytest.approx(80.0), 20.0)
    while state.speed_m_s > 0.0 and state.time_s < 30.0:
        step = plant.advance(state, COAST)
        state = step.state
    # It would stop 0.1 s and 20^2 / 18 m farther on, if it began to brake at once.
    assert state.position_m < 80.0 + 2.0 + 400.0 / 18.0 - SETTINGS.monitor_margin_m


def test_the_gap_grows_behind_a_sensor_that_falls_silent() -> None:
    plant, state = driving(20.0)
    gap = MONITOR.safe_distance_m(20.0, 0.0, 20.0) + 10.0
    sensor = lead_at(gap, 20.0)
    plant.watch(lambda state: sensor(state) if state.time_s < 1.5 else None)
    braked_s = 0.0
    for _ in range(6):
        step = plant.advance(state, COAST)
        braked_s += step.safety.service_braking_s
        state = step.state
    assert braked_s > 0.0
    assert state.speed_m_s < 20.0


def test_without_a_vehicle_ahead_it_does_not_brake() -> None:
    plant, state = driving(30.0)
    plant.watch(lambda _: LeaderPreview.empty())
    step = plant.advance(state, COAST)
    assert step.safety.service_braking_s == 0.0
    assert math.isnan(step.safety.smallest_gap_m)


def test_it_goes_on_from_a_saved_step() -> None:
    plant, state = driving(20.0)
    plant.watch(lead_at(15.0, 20.0))
    first = plant.advance(state, COAST)
    second = plant.advance(first.state, COAST)
    other = Plant(PARAMETERS, np.zeros_like)
    loaded = from_plain(PlantStep, to_plain(first))
    assert loaded == first
    other.watch(lead_at(15.0, 20.0), loaded.memory)
    assert other.advance(loaded.state, COAST) == second
    fresh = Plant(PARAMETERS, np.zeros_like)
    fresh.watch(lead_at(15.0, 20.0))
    assert fresh.advance(loaded.state, COAST) != second
