"""Times of messages: their stamps, or those of reception."""

from __future__ import annotations

import struct
import time

import pytest

from iptm_ros.recording.message_types import message_definition
from iptm_ros.recording.timeline import (
    MAX_LEAD_NS,
    StampKind,
    Timeline,
    TimeSource,
    read_stamp_ns,
    stamp_kind,
)
from iptm_ros.topics import TOPICS, Topic

S = 10**9
HEADER, CLOCK, NONE = StampKind.HEADER, StampKind.CLOCK, StampKind.NONE


def stamped(time_ns: int, *, big_endian: bool = False) -> bytes:
    head = b"\x00\x00\x00\x00" if big_endian else b"\x00\x01\x00\x00"
    return head + struct.pack(">iI" if big_endian else "<iI", *divmod(time_ns, S)) + b"rest"


@pytest.fixture
def simulated() -> Timeline:
    return Timeline(TimeSource.SIMULATED)


@pytest.mark.parametrize("topic", list(TOPICS))
def test_kind_of_every_topic_of_the_suite(topic: Topic) -> None:
    spec = TOPICS[topic]
    kind = stamp_kind(spec.type_name, message_definition(spec.type_name).text)
    has_header = "header" in spec.message_type.get_fields_and_field_types()
    expected = CLOCK if topic is Topic.CLOCK else HEADER if has_header else NONE
    assert kind is expected


def test_constants_and_comments_before_the_header_are_skipped() -> None:
    assert stamp_kind("own/msg/X", "# c\n\nint32 A=1\nstd_msgs/Header header\n") is HEADER
    assert stamp_kind("own/msg/X", "int32 a\nstd_msgs/Header header\n") is NONE
    assert stamp_kind("own/msg/X", "") is NONE


def test_stamps_are_read_in_both_byte_orders() -> None:
    assert read_stamp_ns(stamped(5 * S + 3)) == 5 * S + 3
    assert read_stamp_ns(stamped(5 * S + 3, big_endian=True)) == 5 * S + 3
    assert read_stamp_ns(b"\x00\x01\x00\x00\x01") is None
    assert read_stamp_ns(b"\x00\x01\x00\x00" + struct.pack("<iI", -3, 0)) is None


def test_nothing_has_a_time_before_the_first_clock(simulated: Timeline) -> None:
    assert simulated.now_ns is None
    assert simulated.times_ns(stamped(7 * S), HEADER) is None
    assert simulated.times_ns(b"", NONE) is None
    assert simulated.times_ns(stamped(0), CLOCK) == (0, 0)
    assert simulated.times_ns(b"", NONE) == (0, 0)


def test_state_ahead_of_its_clock_is_logged_at_its_own_time(simulated: Timeline) -> None:
    simulated.times_ns(stamped(4 * S), CLOCK)
    assert simulated.times_ns(stamped(5 * S), HEADER) == (5 * S, 5 * S)
    assert simulated.times_ns(stamped(5 * S), CLOCK) == (5 * S, 5 * S)
    assert simulated.times_ns(b"", NONE) == (5 * S, 5 * S)


def test_late_message_keeps_its_publication_time(simulated: Timeline) -> None:
    simulated.times_ns(stamped(9 * S), CLOCK)
    assert simulated.times_ns(stamped(8 * S), HEADER) == (9 * S, 8 * S)


def test_stamp_of_another_clock_is_not_believed(simulated: Timeline) -> None:
    simulated.times_ns(stamped(9 * S), CLOCK)
    assert simulated.times_ns(stamped(9 * S + MAX_LEAD_NS + 1), HEADER) == (9 * S, 9 * S)
    assert simulated.now_ns == 9 * S


def test_messages_before_the_first_clock_set_the_time_back_unless_their_clock_is_another(
    simulated: Timeline,
) -> None:
    simulated.times_ns(stamped(100 * S), CLOCK)
    simulated.begin_with([100 * S - MAX_LEAD_NS - 1, 99 * S, 101 * S])
    assert simulated.now_ns == 99 * S


def test_log_times_follow_a_clock_that_is_set_back(simulated: Timeline) -> None:
    simulated.times_ns(stamped(90 * S), CLOCK)
    assert simulated.times_ns(stamped(1 * S), CLOCK) == (1 * S, 1 * S)


def test_another_trip_follows_the_one_before(simulated: Timeline) -> None:
    for second in range(31):
        simulated.times_ns(stamped(second * S), CLOCK)
    # The state of the new trip comes before its clock.
    assert simulated.times_ns(stamped(0), HEADER) == (30 * S, 0)
    assert simulated.times_ns(stamped(0), CLOCK) == (30 * S, 30 * S)
    assert simulated.times_ns(stamped(1 * S), HEADER) == (31 * S, 31 * S)
    assert simulated.times_ns(stamped(1 * S), CLOCK) == (31 * S, 31 * S)
    assert simulated.times_ns(stamped(0), CLOCK) == (31 * S, 31 * S)


def test_a_stray_clock_of_0_begins_no_trip(simulated: Timeline) -> None:
    simulated.times_ns(stamped(500 * S), CLOCK)
    simulated.times_ns(stamped(0), CLOCK)
    assert simulated.times_ns(stamped(501 * S), CLOCK) == (501 * S, 501 * S)


def test_wall_time() -> None:
    timeline = Timeline(TimeSource.WALL)
    before = time.time_ns()
    log_ns, publish_ns = timeline.times_ns(stamped(3 * S), HEADER) or (0, 0)
    assert before <= log_ns == publish_ns <= time.time_ns()
    log_ns, publish_ns = timeline.times_ns(stamped(before), HEADER) or (0, 0)
    assert publish_ns == before <= log_ns
