"""A recording: ticks, pauses, and what is in the file at a kill."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rosbags.interfaces import Qos, QosDurability
from tests.iptm_ros.recording.conftest import messages_of_unfinished

from iptm_core.errors import BagError
from iptm_ros.recording import session as session_module
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.recorded_topics import DEFAULT_QOS
from iptm_ros.recording.session import RecordingSession
from iptm_ros.recording.timeline import Timeline, TimeSource

S = 10**9
FLOAT, TEMPERATURE = "std_msgs/msg/Float64", "sensor_msgs/msg/Temperature"
Encode = Callable[[float], bytes]


def clock(time_ns: int) -> bytes:
    return b"\x00\x01\x00\x00" + struct.pack("<iI", *divmod(time_ns, S))


@pytest.fixture
def session(tmp_path: Path) -> Iterator[RecordingSession]:
    with BagWriter(tmp_path / "bag") as writer:
        yield RecordingSession(writer, Timeline(TimeSource.SIMULATED))


def recorded(tmp_path: Path) -> list[tuple[str, int]]:
    with BagReader(tmp_path / "bag") as reader:
        return [(m.topic, m.log_time_ns) for m in reader.raw_messages()]


def saved(tmp_path: Path) -> int:
    """Return how many messages a kill could not take away."""
    return messages_of_unfinished(tmp_path / "bag" / "bag_0.mcap")


@pytest.mark.parametrize("is_first_missed", [False, True])
def test_messages_before_the_clock_are_kept_in_order(
    session: RecordingSession, tmp_path: Path, encode: Encode, *, is_first_missed: bool
) -> None:
    """What belongs to the first tick is not logged in the second, even if its clock is missed."""
    slope = session.channel("/slope", FLOAT, list)
    state = session.channel("/state", TEMPERATURE, list)
    take_clock = session.channel("/clock", "rosgraph_msgs/msg/Clock", list)
    slope(encode(1.0))
    state(clock(100 * S) + bytes(32))
    assert session.now_ns is None
    (slope if is_first_missed else take_clock)(clock(100 * S))
    state(clock(101 * S) + bytes(32))
    take_clock(clock(101 * S))
    slope(encode(2.0))
    session.close()
    assert recorded(tmp_path) == [
        ("/slope", 100 * S),
        ("/state", 100 * S),
        ("/slope" if is_first_missed else "/clock", 100 * S),
        ("/state", 101 * S),
        ("/clock", 101 * S),
        ("/slope", 101 * S),
    ]


def test_without_a_clock_the_time_of_reception_orders_the_bag(
    session: RecordingSession, tmp_path: Path, encode: Encode
) -> None:
    take = session.channel("/a", FLOAT, list)
    other_clock = session.channel("/car_2/clock", "rosgraph_msgs/msg/Clock", list)
    before = time.time_ns()
    for k in range(3):
        take(encode(k))
    other_clock(clock(7 * S))
    between = time.time_ns()
    session.stop_waiting()
    take(encode(3.0))
    session.flush()
    assert saved(tmp_path) == 5
    session.close()
    found = recorded(tmp_path)
    assert [topic for topic, _ in found] == ["/a"] * 3 + ["/car_2/clock", "/a"]
    assert all(before <= time_ns <= between for _, time_ns in found[:4])
    assert found[4][1] >= between


@pytest.mark.parametrize("limit", ["MAX_EARLY_MESSAGES", "MAX_EARLY_BYTES"])
def test_memory_is_bounded_without_a_clock(
    limit: str,
    session: RecordingSession,
    tmp_path: Path,
    encode: Encode,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(session_module, limit, 5)
    take = session.channel("/a", FLOAT, list)
    for k in range(8):
        take(encode(k))
    assert session.is_ordered_by_reception
    session.close()
    assert len(recorded(tmp_path)) == 8


def test_topic_enters_the_bag_with_its_first_message(
    session: RecordingSession, tmp_path: Path, encode: Encode
) -> None:
    asked = []

    def offered() -> list[Qos]:
        asked.append(1)
        return [DEFAULT_QOS._replace(depth=77)]

    session.channel("/silent", FLOAT, list)
    take_clock = session.channel("/clock", "rosgraph_msgs/msg/Clock", list)
    take = session.channel("/a", FLOAT, offered)
    take_clock(clock(0))
    for k in range(3):
        take(encode(k))
    session.close()
    assert asked == [1]
    with BagReader(tmp_path / "bag") as reader:
        assert set(reader.topics) == {"/a", "/clock"}
        assert reader.topics["/a"].offered_qos == (DEFAULT_QOS._replace(depth=77),)


def test_tick_is_in_the_file_when_the_next_one_begins(
    session: RecordingSession, tmp_path: Path, encode: Encode
) -> None:
    """Else a kill would lose more than one tick."""
    take_clock = session.channel("/clock", "rosgraph_msgs/msg/Clock", list)
    take = session.channel("/a", FLOAT, list)
    for tick in range(3):
        take_clock(clock(tick * S))
        take(encode(tick))
        take(encode(tick))
        assert saved(tmp_path) == 3 * tick
    session.flush()
    assert saved(tmp_path) == 9


def test_unknown_type_is_refused(session: RecordingSession) -> None:
    with pytest.raises(BagError, match="unknown"):
        session.channel("/a", "own_msgs/msg/Thing", list)


def test_a_pause_leaves_out_whole_ticks_and_keeps_what_is_latched(
    session: RecordingSession, tmp_path: Path, encode: Encode
) -> None:
    """Messages of a tick arrive in any order, also after those of the next one."""
    latched = DEFAULT_QOS._replace(durability=QosDurability.TRANSIENT_LOCAL, depth=1)
    kept = latched._replace(depth=10)  # a stream, of which late subscribers get the beginning
    state = session.channel("/state", TEMPERATURE, list)
    late = session.channel("/late", TEMPERATURE, lambda: [kept])
    slope = session.channel("/slope", FLOAT, lambda: [latched])
    take_clock = session.channel("/clock", "rosgraph_msgs/msg/Clock", list)
    for tick in range(8):
        state(clock(tick * S) + bytes(32))
        take_clock(clock(tick * S))
        if tick == 2:
            session.pause()
        if tick == 4:
            slope(encode(1.0))
        if tick == 5:
            assert session.is_paused
            session.resume()
        late(clock(tick * S) + bytes(32))
    session.close()
    kept = [tick * S for tick in (0, 1, 2, 6, 7)]
    found = recorded(tmp_path)
    for topic in ("/state", "/late", "/clock"):
        assert [time_ns for name, time_ns in found if name == topic] == kept
    assert [time_ns for name, time_ns in found if name == "/slope"] == [4 * S]
    (pause,) = session.pauses
    assert (pause.after_ns, pause.until_ns, pause.passed_over) == (2 * S, 5 * S, 9)


def test_a_recording_that_starts_paused(session: RecordingSession, tmp_path: Path) -> None:
    session.pause()
    state = session.channel("/state", TEMPERATURE, list)
    take_clock = session.channel("/clock", "rosgraph_msgs/msg/Clock", list)
    for tick in range(3):
        state(clock(tick * S) + bytes(32))
        take_clock(clock(tick * S))
        if tick == 1:
            session.resume()
    session.close()
    assert recorded(tmp_path) == [("/state", 2 * S), ("/clock", 2 * S)]
