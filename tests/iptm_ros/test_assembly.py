"""Trips of one recording are separated by their stamps, and one message of each stamp counts."""

from __future__ import annotations

import random

from iptm_core.state import NS_PER_S as S
from iptm_ros.assembly import last_trip, split_trips
from iptm_ros.topics import Topic


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
    assert trips(1, 0, 2, 3) == [[0, 1, 2, 3]]


def test_a_stray_stamp_begins_no_trip() -> None:
    assert trips(0, *range(1, 40), 0, 40, 41) == [list(range(42))]
    assert trips(0, *range(1, 40), 0) == [list(range(40))]


def test_of_one_stamp_the_later_message_counts() -> None:
    (trip,) = split_trips([(S, "early"), (S, "late")])
    assert trip == {S: "late"}


def counted(*seconds: int) -> list[dict[int, int]]:
    """Trips by stamp in s, each with the place in the order of arrival."""
    found = split_trips((second * S, place) for place, second in enumerate(seconds))
    return [{stamp // S: place for stamp, place in trip.items()} for trip in found]


def test_a_plant_that_was_started_again_drives_another_trip() -> None:
    first, second = counted(*range(31), 0, 0, *range(1, 41))
    assert first == {tick: tick for tick in range(31)}
    assert second == {0: 32, **{tick: tick + 32 for tick in range(1, 41)}}
    # The first ticks of it were not heard.
    assert counted(*range(31), 3, 4)[1] == {3: 31, 4: 32}


def test_beside_a_doubled_plant_the_first_message_of_a_stamp_counts() -> None:
    """In lock-step the second plant is not answered; in real time it drives on behind the first one."""
    beginning = {tick: tick for tick in range(31)}
    assert counted(*range(31), 0, 31, 0, 32, 1, 33) == [{**beginning, 31: 32, 32: 34, 33: 36}]
    for seed in range(20):
        chance = random.Random(seed)  # noqa: S311
        own, other, heard = 30, 0, list(range(31))
        while own < 60:
            if chance.random() < 0.5 and other < own - 11:
                heard.append(other)
                other += 1
            else:
                own += 1
                heard.append(own)
        (trip,) = counted(*heard)
        assert list(trip) == list(range(61))
        assert all(place == heard.index(tick) for tick, place in trip.items())


def test_topics_are_those_of_the_same_trip() -> None:
    """A run that ended when the second trip had only been begun by one of the nodes."""
    states = [(tick * S, f"state {place}") for place, tick in enumerate((*range(31), 0, 1))]
    leaders = [(tick * S, f"leader {tick}") for tick in range(31)]
    found = last_trip({Topic.PLANT_STATE: states, Topic.LEADER: leaders})
    assert list(found[Topic.PLANT_STATE]) == list(found[Topic.LEADER])
    assert found[Topic.PLANT_STATE][S] == "state 1"


def test_a_clock_that_jumps_at_one_node_begins_no_trip() -> None:
    """The leader of before and after the jump belongs to the trip of the plant."""
    states = [(tick * S, "state") for tick in range(101)]
    ticks = (*range(61), *range(161, 170), *range(70, 101))
    leaders = [(tick * S, f"leader {tick}") for tick in ticks]
    found = last_trip({Topic.PLANT_STATE: states, Topic.LEADER: leaders})
    assert list(found[Topic.PLANT_STATE]) == [tick * S for tick in range(101)]
    known = found[Topic.LEADER].keys() & found[Topic.PLANT_STATE].keys()
    assert known == {tick * S for tick in (*range(61), *range(70, 101))}
    second = [*states, (0, "again"), *((tick * S, "again") for tick in range(1, 31))]
    answers = [*leaders, *((tick * S, f"again {tick}") for tick in range(31))]
    found = last_trip({Topic.PLANT_STATE: second, Topic.LEADER: answers})
    assert found[Topic.LEADER][7 * S] == "again 7"
    assert len(found[Topic.PLANT_STATE]) == 31
