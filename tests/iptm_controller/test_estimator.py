"""What is inferred from measurements: noise, which is filtered, late commands and weak brakes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_state

from iptm_controller.actuation import ActuationObserver
from iptm_controller.estimator import Estimator, NoiseSettings
from iptm_core.state import Command, LeaderState, VehicleState

TICKS = 300


def truth(tick: int, tick_s: float = 1.0) -> tuple[VehicleState, LeaderState]:
    """Return an ego vehicle at constant acceleration within a tick behind a lead vehicle in gentle waves."""
    time_s = tick * tick_s
    # Integrals of a held acceleration and of a sinusoidal speed.
    held = [0.5 * math.sin(0.3 * index * tick_s) for index in range(tick)]
    speed = 15.0 + sum(held) * tick_s
    state = make_state(
        time_s=time_s,
        position_m=0.0,
        speed_m_s=speed,
        acceleration_m_s2=held[-1] if held else 0.0,
        cell_1_temperature_k=305.0 + 0.01 * time_s,
        cell_n_temperature_k=306.0 + 0.01 * time_s,
    )
    position = 40.0 + 15.0 * time_s + 40.0 * (1.0 - math.cos(0.05 * time_s))
    return state, LeaderState(time_s, position, 15.0 + 2.0 * math.sin(0.05 * time_s))


def noisy(
    random: np.random.Generator, state: VehicleState, leader: LeaderState
) -> tuple[VehicleState, LeaderState]:
    errors = random.standard_normal(5).tolist()
    return (
        replace(
            state,
            speed_m_s=state.speed_m_s + 0.1 * errors[0],
            cell_1_temperature_k=state.cell_1_temperature_k + 0.5 * errors[1],
            cell_n_temperature_k=state.cell_n_temperature_k + 0.5 * errors[2],
        ),
        replace(
            leader,
            position_m=leader.position_m + 0.5 * errors[3],
            speed_m_s=leader.speed_m_s + 0.1 * errors[4],
        ),
    )


def estimator(noise: NoiseSettings | None = None, tick_s: float = 1.0) -> Estimator:
    return Estimator(noise or NoiseSettings(), PARAMETERS.limits, tick_s)


@pytest.mark.parametrize("tick_s", [0.1, 1.0])
def test_perfect_measurements_pass_to_the_last_bit(tick_s: float) -> None:
    filtering = estimator(tick_s=tick_s)
    for tick in range(TICKS):
        state, leader = truth(tick, tick_s)
        assert filtering.update(state, leader) == (state, leader)
    assert filtering.noise == ""


def test_noise_is_noticed_and_its_level_estimated() -> None:
    filtering, random = estimator(), np.random.default_rng(1)
    noticed = None
    for tick in range(TICKS):
        filtering.update(*noisy(random, *truth(tick)))
        if noticed is None and filtering.noise:
            noticed = tick
    assert noticed <= 5
    speed, gap, temperature = filtering._levels
    assert speed == pytest.approx(0.1, rel=0.6)
    assert gap == pytest.approx(0.5, rel=0.6)
    assert temperature == pytest.approx(0.5, rel=0.6)


def test_levels_are_right_in_the_mean_of_a_long_trip() -> None:
    filtering, random, squares = estimator(), np.random.default_rng(5), []
    for tick in range(2000):
        state, leader = truth(0)
        moved = replace(state, time_s=float(tick)), replace(leader, time_s=float(tick))
        ahead = replace(moved[1], position_m=40.0 + leader.speed_m_s * tick)
        filtering.update(*noisy(random, moved[0], ahead))
        squares.append(filtering.memory.squared)
    # Kept is the variance of a difference of two errors.
    speed, gap, temperature = np.sqrt(0.5 * np.mean(squares[200:], axis=0))
    assert speed == pytest.approx(0.1, rel=0.1)
    assert gap == pytest.approx(0.5, rel=0.1)
    assert temperature == pytest.approx(0.5, rel=0.1)


@pytest.mark.parametrize("stated", [True, False])
def test_filtered_values_are_nearer_to_the_truth(stated: bool) -> None:
    noise = NoiseSettings(0.5, 0.1, 0.5) if stated else NoiseSettings()
    filtering, random = estimator(noise), np.random.default_rng(2)
    raw, filtered, nearer = [], [], 0
    for tick in range(TICKS):
        state, leader = truth(tick)
        measured_state, measured_leader = noisy(random, state, leader)
        estimated_state, estimated_leader = filtering.update(measured_state, measured_leader)
        if tick < 30:
            continue

        def errors(each: VehicleState, lead: LeaderState) -> list[float]:
            return [
                each.speed_m_s - state.speed_m_s,  # noqa: B023  called in the same tick
                lead.speed_m_s - leader.speed_m_s,  # noqa: B023
                each.cell_1_temperature_k - state.cell_1_temperature_k,  # noqa: B023
            ]

        raw.append(errors(measured_state, measured_leader))
        filtered.append(errors(estimated_state, estimated_leader))
        nearer += estimated_leader.position_m <= leader.position_m
    before = np.sqrt(np.mean(np.square(raw), axis=0))
    after = np.sqrt(np.mean(np.square(filtered), axis=0))
    assert after[0] < 0.6 * before[0]
    assert after[1] < before[1]
    assert after[2] < 0.6 * before[2]
    # The margin covers the error of the position in nearly all ticks.
    assert nearer >= 0.97 * (TICKS - 30)


def test_vehicle_that_cuts_in_counts_at_once() -> None:
    filtering, random = estimator(), np.random.default_rng(3)
    for tick in range(50):
        filtering.update(*noisy(random, *truth(tick)))
    state, leader = noisy(random, *truth(50))
    _, nearer = filtering.update(state, replace(leader, position_m=leader.position_m - 25.0))
    assert nearer.position_m <= leader.position_m - 23.0


def test_single_outlier_farther_away_is_discarded_and_a_lasting_one_believed() -> None:
    filtering, random = estimator(), np.random.default_rng(4)
    for tick in range(50):
        filtering.update(*noisy(random, *truth(tick)))
    positions = []
    for tick in (50, 51, 52):
        state, leader = noisy(random, *truth(tick))
        _, seen = filtering.update(state, replace(leader, position_m=leader.position_m + 60.0))
        positions.append(seen.position_m - leader.position_m)
    assert positions[0] < 5.0
    assert positions[1] > 50.0
    assert positions[2] > 50.0


def test_wild_values_do_not_count_as_noise() -> None:
    """One leap of everything is a fault or another vehicle; filters and margins do not follow from it."""
    filtering = estimator()
    for tick in range(20):
        filtering.update(*truth(tick))
    state, leader = truth(20)
    leap = replace(state, speed_m_s=state.speed_m_s + 12.0, cell_1_temperature_k=370.0)
    filtering.update(leap, replace(leader, position_m=leader.position_m - 30.0))
    state, leader = truth(21)
    filtering.update(state, leader)
    assert filtering.noise == ""


LIMITS = PARAMETERS.limits


class Vehicle:
    """A vehicle in exact motion whose actuators are late or weak."""

    def __init__(self, tick_s: float, late_ticks: int = 0, brakes: float = 1.0) -> None:
        self.tick_s = tick_s
        self.brakes = brakes
        self.queue = [0.0] * late_ticks
        self.state = make_state(time_s=0.0, position_m=0.0, speed_m_s=20.0)

    def advance(self, acceleration_m_s2: float) -> VehicleState:
        self.queue.append(acceleration_m_s2)
        actuated = self.queue.pop(0)
        if actuated < 0.0:
            actuated *= self.brakes
        state, dt = self.state, self.tick_s
        self.state = VehicleState(
            **{
                **vars(state),
                "time_s": state.time_s + dt,
                "position_m": state.position_m + dt * (state.speed_m_s + 0.5 * dt * actuated),
                "speed_m_s": state.speed_m_s + dt * actuated,
                "acceleration_m_s2": actuated,
            }
        )
        return self.state


def commanded(time_s: float) -> float:
    """Return a command that changes within the jerk limit, braking and driving."""
    return 1.2 * math.sin(0.4 * time_s)


def drive(observer: ActuationObserver, vehicle: Vehicle, ticks: int) -> None:
    for _ in range(ticks):
        state = vehicle.state
        observer.observe(state)
        command = commanded(state.time_s)
        observer.issue(state.time_s, Command(command, 500.0))
        vehicle.advance(command)
    observer.observe(vehicle.state)


@pytest.mark.parametrize("tick_s", [0.1, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("late_ticks", [0, 1, 2, 3])
def test_delay_is_found_whatever_the_tick(tick_s: float, late_ticks: int) -> None:
    observer = ActuationObserver(LIMITS, tick_s)
    drive(observer, Vehicle(tick_s, late_ticks), 40)
    assert observer.delay_s == pytest.approx(late_ticks * tick_s)
    assert observer.brake_share == 1.0
    assert bool(observer.reason) == (late_ticks > 0)


@pytest.mark.parametrize("late_ticks", [0, 1, 2])
def test_prediction_is_the_state_at_which_the_next_command_acts(late_ticks: int) -> None:
    observer = ActuationObserver(LIMITS, 1.0)
    vehicle = Vehicle(1.0, late_ticks)
    drive(observer, vehicle, 40)
    now = vehicle.state
    predicted = observer.predicted(now)
    if late_ticks == 0:
        assert predicted is now
    for _ in range(late_ticks):
        vehicle.advance(0.0)
    truth = vehicle.state
    assert predicted.time_s == truth.time_s
    assert predicted.position_m == pytest.approx(truth.position_m, abs=1e-9)
    assert predicted.speed_m_s == pytest.approx(truth.speed_m_s, abs=1e-9)
    assert predicted.acceleration_m_s2 == pytest.approx(truth.acceleration_m_s2, abs=1e-9)


def test_delay_that_begins_and_ends_while_driving_is_followed() -> None:
    observer = ActuationObserver(LIMITS, 1.0)
    vehicle = Vehicle(1.0)
    drive(observer, vehicle, 20)
    assert observer.delay_s == 0.0
    vehicle.queue.append(0.0)
    drive(observer, vehicle, 8)
    assert observer.delay_s == 1.0
    vehicle.queue.clear()
    drive(observer, vehicle, 8)
    assert observer.delay_s == 0.0


@pytest.mark.parametrize("share", [0.6, 0.7, 0.85])
def test_weak_brakes_are_noticed_within_a_second_of_braking(share: float) -> None:
    observer = ActuationObserver(LIMITS, 1.0)
    vehicle = Vehicle(1.0, brakes=share)
    for command in (0.0, 0.0, -0.5):
        observer.issue(vehicle.state.time_s, Command(command, 0.0))
        observer.observe(vehicle.advance(command))
    assert observer.has_weak_brakes
    assert observer.brake_share == pytest.approx(share)
    assert f"{share:.0%}" in observer.reason
    assert observer.delay_s == 0.0


def test_a_delay_that_shows_at_the_onset_of_braking_is_no_weak_brake() -> None:
    """Braking builds up slowly; one tick late it looks like brakes that deliver too little."""
    for late_ticks in (1, 2):
        observer, vehicle = ActuationObserver(LIMITS, 1.0), Vehicle(1.0, late_ticks)
        for command in (*[0.0] * 8, -0.35, -0.52, -0.58, -0.7, -0.9, -1.3, -1.5):
            observer.issue(vehicle.state.time_s, Command(command, 0.0))
            observer.observe(vehicle.advance(command))
            assert not observer.has_weak_brakes
            assert observer.found[2] >= 0.9
        assert observer.delay_s == late_ticks


def test_braking_of_the_safety_monitor_answers_no_command() -> None:
    """Within a tick it moves the vehicle as no command asks for; delay and brakes are as before."""
    observer = ActuationObserver(LIMITS, 1.0)
    driven = [
        *((17.83, 0.10, 0.10), (18.33, 0.50, -0.40), (18.43, 0.10, -0.19)),
        *((18.03, -0.40, -0.20), (17.83, -0.19, -0.07), (17.63, -0.20, 0.14), (17.56, -0.07, 0.27)),
        *((17.70, 0.14, 0.36), (17.97, 0.27, -0.14)),
        # It begins to brake at the end of the first tick, ends in the second, and commands are limited then.
        *((18.27, -0.39, -0.64), (16.01, -0.14, -0.51), (15.36, -0.64, -0.59)),
        *((14.85, -0.51, -0.96), (14.26, -0.59, -1.34), (13.30, -0.96, -1.85)),
    ]
    for tick, (speed_m_s, measured_m_s2, command_m_s2) in enumerate(driven):
        state = make_state(time_s=float(tick), speed_m_s=speed_m_s, acceleration_m_s2=measured_m_s2)
        observer.observe(state)
        observer.issue(state.time_s, Command(command_m_s2, 0.0))
        assert not observer.has_weak_brakes
        assert tick < 8 or observer.delay_s == 1.0


def test_a_state_that_is_repeated_leaves_the_commands_under_way() -> None:
    observer, vehicle = ActuationObserver(LIMITS, 1.0), Vehicle(1.0, late_ticks=1)
    drive(observer, vehicle, 20)
    before = observer.memory
    observer.issue(vehicle.state.time_s, Command(0.0, 0.0))
    observer.observe(vehicle.state)
    assert observer.memory.delay_ticks == before.delay_ticks == 1
    assert observer.memory.mismatches == before.mismatches


@pytest.mark.parametrize("late_ticks", [0, 1])
def test_vehicle_with_weak_brakes_drives_off_again(late_ticks: int) -> None:
    """At rest, the next command starts from the last one and is released step by step."""
    observer = ActuationObserver(LIMITS, 1.0)
    drive(observer, Vehicle(1.0, late_ticks, brakes=0.7), 40)
    accelerations = []
    command = -1.5
    for tick in range(41, 50):
        standing = make_state(time_s=float(tick), speed_m_s=0.0, acceleration_m_s2=0.0)
        observer.observe(standing)
        command = min(observer.predicted(standing).acceleration_m_s2 + 0.5, 1.0)
        observer.issue(float(tick), Command(command, 0.0))
        accelerations.append(command)
    assert accelerations[-1] >= 0.5


def test_brakes_that_recover_are_strong_again() -> None:
    observer = ActuationObserver(LIMITS, 1.0)
    vehicle = Vehicle(1.0, brakes=0.7)
    drive(observer, vehicle, 32)
    vehicle.brakes = 1.0
    drive(observer, vehicle, 32)
    assert not observer.has_weak_brakes


def test_vehicle_held_at_rest_and_service_braking_show_nothing() -> None:
    observer = ActuationObserver(LIMITS, 1.0)
    standing = make_state(time_s=0.0, speed_m_s=0.0)
    for tick in range(10):
        state = VehicleState(**{**vars(standing), "time_s": float(tick)})
        observer.observe(state)
        observer.issue(state.time_s, Command(-1.0, 0.0))
    braking = make_state(time_s=10.0, speed_m_s=20.0, acceleration_m_s2=-8.0)
    observer.observe(braking)
    assert observer.reason == ""


def test_prediction_stops_at_standstill() -> None:
    observer = ActuationObserver(LIMITS, 1.0)
    drive(observer, Vehicle(1.0, late_ticks=2), 40)
    slow = make_state(time_s=40.0, position_m=500.0, speed_m_s=0.2)
    observer.issue(38.0, Command(-1.0, 0.0))
    observer.issue(39.0, Command(-1.5, 0.0))
    predicted = observer.predicted(slow)
    assert predicted.speed_m_s == 0.0
    assert predicted.position_m == pytest.approx(500.0 + 0.2**2 / 2.0)
