"""The records of a trip, the command held by a plant that does not wait, and the time between ticks."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from iptm_core.state import Command, CommandSource
from iptm_plant_sim.actuators import Clamp
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.trip import RECENT_TICKS, CommandHold, PlantTrip, Slots, TimeBetweenTicks

S = 1_000_000_000


def test_starts_at_rest_and_ends_after_the_last_interval(plant: Plant) -> None:
    trip = PlantTrip(plant, 3.0)
    assert trip.step.standstill
    assert trip.step.state.time_s == 0.0
    stamps = []
    while not trip.is_over:
        stamps.append(trip.stamp_ns)
        trip.advance(Command(0.5, 100.0))
    assert stamps == [0, S, 2 * S]
    assert trip.step.state.time_s == 3.0


@pytest.mark.parametrize(
    ("duration", "period", "ticks"), [(2.5, 1.0, 3), (0.3, 0.1, 3), (0.05, 1.0, 1), (10.0, 1.0, 10)]
)
def test_duration_is_rounded_up_to_whole_periods(
    plant: Plant, duration: float, period: float, ticks: int
) -> None:
    assert PlantTrip(plant, duration, period).ticks == ticks


def test_follows_the_plant_bit_for_bit(make_plant: Callable[..., Plant]) -> None:
    plant = make_plant("hills")
    trip = PlantTrip(plant, 50.0)
    trip.warm_up()
    state = plant.initial_state()
    for tick in range(50):
        command = Command(math.sin(tick / 5.0), 300.0 * (tick % 7))
        state = plant.advance(state, command).state
        assert trip.advance(command).state == state


def test_keeps_count_of_what_was_limited(plant: Plant) -> None:
    trip = PlantTrip(plant, 100.0)
    trip.advance(Command(0.1, 0.0))
    recent = [trip.is_limited]
    trip.advance(Command(5.0, 0.0))
    trip.advance(Command(math.nan, 0.0))
    assert trip.limited_ticks == 2
    assert trip.clamps == {Clamp.ACCELERATION_BOUND: 1, Clamp.JERK: 1, Clamp.NON_FINITE: 1}
    assert "non_finite_command" in trip.last_reason
    for _ in range(RECENT_TICKS):
        recent.append(trip.is_limited)
        trip.advance(Command(0.0, 0.0))
    recent.append(trip.is_limited)
    assert recent == [False, *[True] * RECENT_TICKS, False]


def test_the_source_of_each_command_is_part_of_what_is_observed(plant: Plant) -> None:
    trip = PlantTrip(plant, 10.0)
    command = Command(0.1, 0.0)
    given = ((command, CommandSource.ANSWER), (command, CommandSource.HELD), (None,))
    found = [trip.advance(*each).safety.command_source for each in given]
    found.append(trip.advance(Command(math.nan, 0.0)).safety.command_source)
    stop = CommandSource.STOP
    assert found == [CommandSource.ANSWER, CommandSource.HELD, stop, stop]


def test_hold_keeps_the_newest_command_until_it_is_too_old() -> None:
    hold = CommandHold(3.0)
    assert hold.command_at(0)[0] is None
    first, second = Command(1.0, 0.0), Command(0.5, 10.0)
    assert hold.offer(0, first, 0)
    assert hold.offer(S, second, 2 * S)
    assert not hold.offer(0, first, 2 * S)
    assert not hold.offer(S, first, 2 * S)
    assert hold.age_s(4 * S) == 3.0
    assert hold.command_at(S) == (second, CommandSource.ANSWER)
    assert hold.command_at(4 * S) == (second, CommandSource.HELD)
    assert hold.command_at(4 * S + 1)[0] is None
    assert hold.is_lost(4 * S + 1)
    # It recovers as soon as something current arrives.
    assert hold.offer(5 * S, first, 5 * S)
    assert hold.command_at(5 * S) == (first, CommandSource.ANSWER)


def test_hold_without_any_command_is_lost_in_the_end() -> None:
    hold = CommandHold(3.0)
    assert not hold.is_lost(3 * S)
    assert hold.is_lost(4 * S)


@pytest.mark.parametrize("stamp", [-1, 3 * S])
def test_hold_refuses_the_future_and_the_impossible(stamp: int) -> None:
    hold = CommandHold(3.0)
    assert not hold.offer(stamp, Command(0.0, 0.0), 2 * S)
    assert hold.command_at(2 * S)[0] is None


class FakeClock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_punctual_activity_has_no_overruns() -> None:
    clock = FakeClock()
    schedule = Slots(0.5, clock)
    for _ in range(10):
        clock.now_s += 0.5
        schedule.keep()
    assert schedule.overruns == 0
    assert schedule.worst_lateness_s == pytest.approx(0.0)


def test_a_pause_is_no_delay() -> None:
    clock = FakeClock()
    schedule = Slots(0.5, clock)
    clock.now_s += 60.0
    schedule.begin_again()
    clock.now_s += 0.5
    schedule.keep()
    assert schedule.overruns == 0
    assert schedule.worst_lateness_s == pytest.approx(0.0)


def test_missed_slots_are_counted_once_and_not_made_up_for() -> None:
    clock = FakeClock()
    schedule = Slots(1.0, clock)
    clock.now_s += 1.0
    schedule.keep()
    clock.now_s += 3.5  # due at +1: slots +2 and +3 pass by as well
    schedule.keep()
    assert schedule.overruns == 2
    clock.now_s = 105.0  # the next slot in the old grid
    schedule.keep()
    assert schedule.overruns == 2
    assert schedule.worst_lateness_s == pytest.approx(2.5)


def test_time_between_ticks_grows_and_stays_before_the_next_tick() -> None:
    clock = FakeClock()
    between = TimeBetweenTicks(0.5, 2.0, clock)
    assert between.take_ns() is None  # no tick yet
    between.begin(3_000_000_000)
    assert between.take_ns() is None  # the tick itself has been taken
    clock.now_s += 0.125
    assert between.take_ns() == 3_250_000_000
    assert between.take_ns() is None
    clock.now_s += 9.0  # the next tick is late
    assert between.take_ns() == 3_499_999_999
    assert between.take_ns() is None
    between.begin(3_500_000_000)
    clock.now_s += 0.125
    assert between.take_ns() == 3_750_000_000
    between.end()
    clock.now_s += 0.05
    assert between.take_ns() is None
