"""Bags of the suite in the hands of others: read, converted, and those of earlier recorders."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from tests.foreign_readers import assert_read_by_all, with_rosbags

from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter

EXAMPLE = Path(__file__).resolve().parents[3] / "bags" / "example_us06_120s"
SURPLUS = {"sensor_msgs/msg/JointState": 8, "nav_msgs/msg/Odometry": 140}


def test_the_example_is_read_by_all() -> None:
    with BagReader(EXAMPLE) as reader:
        counts = {name: topic.message_count for name, topic in reader.topics.items()}
    assert assert_read_by_all(EXAMPLE) == counts


def convert(source: Path, *arguments: str | Path) -> Path:
    """Run `rosbags-convert`; the last argument is what it makes."""
    command = (Path(sys.executable).with_name("rosbags-convert"), "--src", source, *arguments)
    subprocess.run(command, check=True, capture_output=True)
    return Path(arguments[-1])


def test_the_example_is_converted_to_sqlite_and_back(tmp_path: Path) -> None:
    other = convert(EXAMPLE, "--dst-storage", "sqlite3", "--dst", tmp_path / "other")
    again = convert(other, "--dst-storage", "mcap", "--dst", tmp_path / "again")
    expected = sorted(with_rosbags(EXAMPLE), key=lambda entry: entry[:4])
    for bag in (other, again):
        assert sorted(with_rosbags(bag), key=lambda entry: entry[:4]) == expected
    with BagReader(again) as reader:
        assert Counter(m.topic for m in reader.messages()) == Counter(e[0] for e in expected)


def test_the_example_is_converted_to_ros_1_and_back(tmp_path: Path) -> None:
    bag = convert(EXAMPLE, "--dst", tmp_path / "one.bag")
    again = convert(bag, "--dst-typestore", "ros2_jazzy", "--dst", tmp_path / "again")
    expected = sorted(with_rosbags(EXAMPLE), key=lambda entry: entry[:3])
    found = sorted(with_rosbags(again), key=lambda entry: entry[:3])
    assert [entry[:3] for entry in found] == [entry[:3] for entry in expected]
    assert [entry[4] for entry in found] == [entry[4] for entry in expected]


@pytest.fixture
def old_bag(tmp_path: Path) -> Path:
    """Return the example as recorders once wrote it: with memory of theirs after the ends of messages."""
    with BagReader(EXAMPLE) as reader, BagWriter(tmp_path / "old") as writer:
        topics: dict[str, Any] = {}
        for message in reader.raw_messages():
            name, kind = message.topic, message.type_name
            if name not in topics:
                topics[name] = writer.add_topic(
                    name, kind, offered_qos=reader.topics[name].offered_qos
                )
            data = message.data + b"\x5a" * SURPLUS.get(kind, 0)
            writer.write(topics[name], data, message.log_time_ns, message.publish_time_ns)
    return tmp_path / "old"


def test_a_bag_with_surplus_bytes_is_refused_with_the_remedy(old_bag: Path) -> None:
    with (
        BagReader(old_bag) as reader,
        pytest.raises(BagError, match=r"bytes follow its end; scripts/iptm recover removes them"),
    ):
        list(reader.messages())
