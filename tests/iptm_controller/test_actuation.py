"""Late commands and weak brakes, inferred from what was actuated."""

from __future__ import annotations

import math

import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_state

from iptm_controller.actuation import ActuationObserver
from iptm_core.state import Command, VehicleState

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
