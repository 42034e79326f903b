"""Overruns are judged by the schedule, not by how long the work took; time between ticks stays between."""

import pytest

from iptm_plant_sim.trip import Schedule, TimeBetweenTicks


class FakeClock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_punctual_activity_has_no_overruns() -> None:
    clock = FakeClock()
    schedule = Schedule(0.5, clock)
    for _ in range(10):
        clock.now_s += 0.5
        schedule.keep()
    assert schedule.overruns == 0
    assert schedule.worst_lateness_s == pytest.approx(0.0)


def test_a_pause_is_no_delay() -> None:
    clock = FakeClock()
    schedule = Schedule(0.5, clock)
    clock.now_s += 60.0
    schedule.begin_again()
    clock.now_s += 0.5
    schedule.keep()
    assert schedule.overruns == 0
    assert schedule.worst_lateness_s == pytest.approx(0.0)


def test_missed_slots_are_counted_once_and_not_made_up_for() -> None:
    clock = FakeClock()
    schedule = Schedule(1.0, clock)
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
