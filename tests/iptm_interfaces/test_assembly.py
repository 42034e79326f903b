"""Trips of one recording are told apart by their stamps."""

from __future__ import annotations

from iptm_core.trip_time import NS_PER_S as S
from iptm_interfaces.assembly import split_trips


def trips(*seconds: int) -> list[list[int]]:
    stamped = ((second * S, second) for second in seconds)
    return [[stamp // S for stamp in trip] for trip in split_trips(stamped)]


def test_a_stamp_of_0_begins_a_trip() -> None:
    assert trips(0, 1, 2, 0, 1) == [[0, 1, 2], [0, 1]]
    assert trips(7, 8) == [[7, 8]]
    assert trips() == [[]]


def test_a_first_state_that_is_repeated_is_one_trip() -> None:
    assert trips(0, 0, 1, 2, 0, 0, 1) == [[0, 1, 2], [0, 1]]


def test_late_messages_are_put_in_their_place() -> None:
    assert trips(0, 2, 1, 3) == [[0, 1, 2, 3]]


def test_a_stray_stamp_begins_no_trip() -> None:
    assert trips(0, *range(1, 40), 0, 40, 41) == [list(range(42))]


def test_of_one_stamp_the_later_message_counts() -> None:
    (trip,) = split_trips([(S, "early"), (S, "late")])
    assert trip == {S: "late"}
