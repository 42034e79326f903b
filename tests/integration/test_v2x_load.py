"""A crowd of cars by radio in real time, in small; `scripts/benchmark v2x_load` has two thousand a second."""

from __future__ import annotations

from benchmarks.v2x_load import measure


def test_nothing_that_a_crowd_sends_is_lost() -> None:
    numbers = measure(cars=20, seconds=4)
    assert numbers["sent"] == 21 * 40
    assert numbers["read"] == numbers["sent"]
    assert "overflow" not in numbers["refused"]
