"""The safety monitor brakes below the RSS safe distance, as the brakes can, and releases with hysteresis."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iptm_core.errors import ParameterError
from iptm_core.parameters import load_parameters
from iptm_core.physics.power_thermal import electric_traction_power_w
from iptm_core.saved_state import from_plain, to_plain
from iptm_core.settings import SafetyMonitorSettings
from iptm_core.state import Command, LeaderPreview, LeaderState, VehicleState
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_step import PlantStep
from iptm_plant_sim.safety_monitor import (
    LeadMeasurements,
    MonitorMemory,
    SafetyMonitor,
    stopping_distance_m,
    with_delivery,
)

PARAMETERS = load_parameters().values
BRAKES = PARAMETERS.brakes
SETTINGS = SafetyMonitorSettings()
MONITOR = SafetyMonitor(SETTINGS, BRAKES)
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
    safe_m = MONITOR.safe_distance_m(0.0 if still else speed, 0.0, lead_speed)
    failed = np.flatnonzero(gaps < safe_m)
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
    judged = MONITOR.judge(memory, 5.0, (0.0, speed, command), LeaderState(5.0, gap, lead_speed))
    enough = gap >= MONITOR.safe_distance_m(speed, max(command, 0.0), lead_speed, 1.0, 0.5)
    assert judged.braking is not (enough and since_s >= SETTINGS.monitor_hold_s - 1e-9)


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


# --- measurements


def test_a_silent_sensor_lets_the_last_measurement_go_on_with_its_deceleration() -> None:
    before = MonitorMemory(lead=LeaderState(0.0, 50.0, 20.0))
    known = LeadMeasurements(
        before, LeaderPreview(np.array([1.0]), np.array([68.0]), np.array([16.0]))
    )
    assert known.at(1.0) == (LeaderState(1.0, 68.0, 16.0), True)
    lead, measured = known.at(1.5)
    assert not measured
    assert lead == LeaderState(1.5, 68.0 + 8.0 - 0.5, 14.0)
    silent = LeadMeasurements(known.noted(before), None)
    lead, _ = silent.at(20.0)
    assert lead == LeaderState(20.0, 68.0 + 32.0, 0.0), "4 s to the halt"
    jumped = LeaderPreview(np.array([1.0]), np.array([30.0]), np.array([10.0]))
    assert LeadMeasurements(before, jumped).at(2.0)[0] == LeaderState(2.0, 40.0, 10.0), (
        "another car"
    )
    assert LeadMeasurements(before, LeaderPreview.empty()).at(1.0) == (None, False), "a free road"


def test_a_vehicle_that_is_not_measured_any_more_is_assumed_to_brake() -> None:
    cruising = MonitorMemory(lead=LeaderState(0.0, 50.0, 20.0))
    silent = LeadMeasurements(cruising, None)
    assert silent.at(1.5)[0] == LeaderState(1.5, 80.0, 20.0), (
        "one missed measurement changes nothing"
    )
    lead, measured = silent.at(3.5)
    assert not measured
    assert lead == LeaderState(3.5, 80.0 + 40.0 - 6.0, 14.0)
    lead, _ = silent.at(60.0)
    assert lead is not None
    assert lead.speed_m_s == 0.0
    assert lead.position_m == pytest.approx(80.0 + 20.0**2 / 6.0)


def test_the_gap_grows_behind_a_sensor_that_falls_silent() -> None:
    plant, state = driving(20.0)
    gap = MONITOR.safe_distance_m(20.0, 0.0, 20.0) + 10.0
    measured = lead_at(gap, 20.0)
    plant.watch(lambda state: measured(state) if state.time_s < 1.5 else None)
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
