"""The order and the times in which messages of a bag are played."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from rosbags.interfaces import QosDurability

from iptm_bags.playback import Playback, PlaybackOptions
from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.recorded_topics import DEFAULT_QOS, TopicSelection

S = 10**9
Encode = Callable[[float], bytes]


def played(options: PlaybackOptions) -> list[tuple[str, float]]:
    with BagReader(options.bag) as reader:
        playback = Playback(reader, options)
        return [(m.topic, playback.due_s(m.log_time_ns)) for m in playback.messages()]


def test_everything_is_due_at_its_recorded_time(small_bag: Path) -> None:
    due = played(PlaybackOptions(small_bag))
    assert len(due) == 40
    assert due[:3] == [("/a", 0.0), ("/b", 1e-9), ("/a", 1.0)]


def test_rate_start_duration_and_topics(small_bag: Path) -> None:
    options = PlaybackOptions(
        small_bag, rate=2.0, start_s=5.0, duration_s=3.0, selection=TopicSelection(("/a",))
    )
    assert played(options) == [("/a", 0.0), ("/a", 0.5), ("/a", 1.0), ("/a", 1.5)]


def test_latched_messages_come_first_when_starting_late(tmp_path: Path, encode: Encode) -> None:
    bag = tmp_path / "bag"
    with BagWriter(bag) as writer:
        latched = DEFAULT_QOS._replace(depth=1, durability=QosDurability.TRANSIENT_LOCAL)
        slope = writer.add_topic("/slope", "std_msgs/msg/Float64", offered_qos=[latched])
        state = writer.add_topic("/state", "std_msgs/msg/Float64")
        for k in range(2):
            writer.write(slope, encode(k), k * S)
        for k in range(10):
            writer.write(state, encode(k), k * S)
    assert played(PlaybackOptions(bag, start_s=7.5)) == [
        ("/slope", 0.0),
        ("/state", 0.5),
        ("/state", 1.5),
    ]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": 0.0}, "rate is 0; allowed: 1e-06 to 1e\\+09"),
        ({"rate": math.nan}, "rate is nan"),
        ({"start_s": -1.0}, "start is -1"),
        ({"duration_s": 0.0}, "duration is 0"),
        ({"clock_hz": -1.0}, "clock rate is -1"),
        ({"delay_s": -0.1}, "delay is -0.1"),
        ({"delay_s": math.inf}, "delay is inf; allowed: 0 to 1e\\+09 s"),
        ({"duration_s": math.inf}, "duration is inf"),
        ({"start_s": math.nan}, "start is nan"),
    ],
)
def test_numbers_out_of_range(change: dict[str, float], message: str, small_bag: Path) -> None:
    with pytest.raises(BagError, match=message):
        PlaybackOptions(small_bag, **change)  # type: ignore[arg-type]


def test_nothing_to_play(small_bag: Path, tmp_path: Path) -> None:
    BagWriter(tmp_path / "empty").close()
    for options, message in (
        (PlaybackOptions(tmp_path / "empty"), "holds no messages"),
        (PlaybackOptions(small_bag, start_s=60.0), "only 19 s long"),
        (PlaybackOptions(small_bag, selection=TopicSelection(("/x",))), "no topic '/x'"),
        (PlaybackOptions(small_bag, selection=TopicSelection(exclude=("*",))), "topics asked for"),
    ):
        with pytest.raises(BagError, match=message):
            played(options)


def test_own_clock_replaces_a_clock_of_another_name(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for name in ("/car_9/clock", "/x"):
            type_name = "rosgraph_msgs/msg/Clock" if "clock" in name else "std_msgs/msg/Float64"
            writer.write(writer.add_topic(name, type_name), bytes([0, 1, 0, 0]) + bytes(8), S)
    with BagReader(tmp_path / "bag") as reader:
        own = Playback(reader, PlaybackOptions(tmp_path / "bag", clock_hz=10.0))
        assert own.clock_topic == "/car_9/clock"
        assert [topic.name for topic in own.topics] == ["/x"]
