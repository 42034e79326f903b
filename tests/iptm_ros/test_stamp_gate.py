"""Which stamps a node follows: strays of every kind against trips that go on, restart and jump."""

from __future__ import annotations

import random

import pytest

from iptm_ros.stamp_gate import StampGate, Verdict

S = 1_000_000_000
STRAYS_S = (-5.0, -1e-9, 1e-9, 3.0, 400.0, 520.0, 1e4, 1.7e9, 2.0**31 - 1.0, 2.0**31, 9e9)


class Bench:
    """A gate in the middle of a trip of 1 s steps, on a clock that the test moves."""

    def __init__(self, interval_s: float = 0.01) -> None:
        self.now_s = 50.0
        self.interval_s = interval_s
        self.gate = StampGate(lambda: self.now_s)
        self.tick = 499
        for _ in range(5):
            assert self.next() is Verdict.NEXT

    def judge(self, time_s: float) -> Verdict:
        return self.gate.judge(round(time_s * S))

    def next(self) -> Verdict:
        self.tick += 1
        self.now_s += self.interval_s
        return self.judge(self.tick)


def test_a_trip_may_start_anywhere_and_miss_ticks() -> None:
    bench = Bench()
    bench.tick += 5
    assert bench.next() is Verdict.NEXT
    assert bench.judge(bench.tick) is Verdict.REPEATED
    assert bench.gate.strays == 0


@pytest.mark.parametrize("stray_s", STRAYS_S)
def test_twenty_stray_stamps_change_nothing(stray_s: float) -> None:
    bench = Bench()
    for stray in range(20):
        bench.judge(stray_s + 1e-9 * stray)
    assert bench.next() in {Verdict.NEXT, Verdict.RESUMED}
    assert {bench.next() for _ in range(20)} == {Verdict.NEXT}


def test_a_stray_zero_is_forgiven_at_once() -> None:
    bench = Bench()
    for repeat in (False, True):
        assert bench.judge(0.0) is Verdict.NEW_TRIP
        assert (bench.judge(bench.tick) if repeat else bench.next()) is Verdict.RESUMED
    assert bench.next() is Verdict.NEXT


def test_a_restarted_plant_is_followed_at_once_and_for_good() -> None:
    bench = Bench()
    assert bench.judge(0.0) is Verdict.NEW_TRIP
    for tick in range(1, 6):
        bench.now_s += 0.3
        assert bench.judge(float(tick)) is Verdict.NEXT
    # What is left of the old trip does not bring it back.
    assert bench.judge(bench.tick + 1.0) is Verdict.STRAY


def test_another_trip_has_just_begun_for_three_ticks() -> None:
    bench = Bench()
    assert not bench.gate.has_restarted  # the first trip replaces none
    restarted = []
    for tick in (0, 0, 1, 2, 3, 4):
        bench.judge(float(tick))
        restarted.append(bench.gate.has_restarted)
    assert restarted == [True, True, True, True, False, False]


def test_a_stray_zero_has_begun_nothing_once_the_trip_goes_on() -> None:
    bench = Bench()
    bench.judge(0.0)
    assert bench.next() is Verdict.RESUMED
    assert not bench.gate.has_restarted


@pytest.mark.parametrize("jump_s", [-300.0, -2.0, 60.0, 1e6])
def test_a_time_that_has_really_jumped_is_followed_when_the_old_one_is_silent(
    jump_s: float,
) -> None:
    bench = Bench()
    jumped_s = bench.tick + jump_s
    assert bench.judge(jumped_s) is Verdict.STRAY
    bench.now_s += 0.5
    assert bench.judge(jumped_s + 1.0) is Verdict.STRAY
    bench.now_s += 0.6
    # A plant in lock-step repeats its state; one in real time goes on. Strays between do not matter.
    bench.judge(1.7e9)
    assert bench.judge(jumped_s + 1.0) is Verdict.NEW_TRIP
    assert bench.judge(jumped_s + 2.0) is Verdict.NEXT


def test_no_other_time_is_followed_while_the_trip_goes_on() -> None:
    bench = Bench(interval_s=0.5)
    other_s = 9000.0
    for _ in range(100):
        other_s += 1.0
        assert bench.judge(other_s) is Verdict.STRAY
        assert bench.next() is Verdict.NEXT


def test_slow_trips_are_silent_for_longer() -> None:
    bench = Bench(interval_s=10.0)
    for _ in range(20):
        bench.judge(9000.0)
        bench.now_s += 5.0
        assert bench.judge(9001.0) is Verdict.STRAY
        assert bench.next() is Verdict.NEXT


def test_whatever_strays_come_a_trip_that_repeats_itself_is_heard_again() -> None:
    """Lock-step: a plant without an answer repeats its state every 2.5 s."""
    chance = random.Random(3)  # noqa: S311
    for _ in range(300):
        bench = Bench()
        for _ in range(chance.randrange(30)):
            stray_s = chance.choice((0.0, *STRAYS_S, bench.tick + chance.uniform(-40.0, 40.0)))
            bench.judge(stray_s)
            bench.now_s += chance.choice((0.0, 0.2, 2.0))
        bench.tick += 1
        for _ in range(4):
            verdict = bench.judge(bench.tick)
            if verdict is not Verdict.STRAY:
                break
            bench.now_s += 2.5
        assert verdict is not Verdict.STRAY
        assert bench.next() is Verdict.NEXT
