"""The vehicle under its safety monitor: brakes act late and build up, and what they deliver is noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
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

from iptm_core.braking import BrakingCapability
from iptm_core.physics.power_thermal import electric_traction_power_w
from iptm_core.saved_state import from_plain, to_plain
from iptm_core.state import Command
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant


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


@pytest.mark.parametrize("gap_m", [40.6, 55.0])
def test_a_vehicle_ahead_may_brake_harder_than_the_road_under_the_own_vehicle_permits(
    gap_m: float,
) -> None:
    plant, state = driving(18.1)
    plant.road_friction = 0.3
    plant.watch(lead_at(gap_m, 18.1, 5.9))
    step = plant.advance(state, COAST)
    assert step.memory.since_s == pytest.approx(0.2), "two steps of its speed show it"
    smallest_m = step.safety.smallest_gap_m
    while step.state.speed_m_s > 0.0:
        step = plant.advance(step.state, COAST)
        smallest_m = min(smallest_m, step.safety.smallest_gap_m)
    assert smallest_m > 1.0


def test_a_vehicle_ahead_that_brakes_as_in_published_cycles_may_be_on_a_slippery_road() -> None:
    plant, state = driving(18.1)
    plant.watch(lead_at(55.0, 18.1, 3.9))
    assert not plant.advance(state, COAST).memory.braking


def test_downhill_it_brakes_earlier() -> None:
    plant = Plant(PARAMETERS, lambda x: np.full_like(x, -0.1))
    state = plant.initial_state(speed_m_s=20.0)
    gap = MONITOR.safe_distance_m(20.0, 0.0, 20.0) + 1.0
    plant.watch(lead_at(gap, 20.0))
    assert plant.advance(state, COAST).safety.service_braking_s > 0.0
    level, state = driving(20.0)
    level.watch(lead_at(gap, 20.0))
    assert level.advance(state, COAST).safety.service_braking_s == 0.0


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
