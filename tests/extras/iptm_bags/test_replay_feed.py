"""Repeated messages, as during a pause, count once when a bag is compared."""

from __future__ import annotations

from pathlib import Path

from iptm_bags.replay_check import copy_without_repeats
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter

S = 10**9


def test_the_same_bytes_at_the_same_time_are_a_repeat(tmp_path: Path) -> None:
    messages = [(0, "a"), (1, "b"), (1, "c"), (1, "b"), (1, "c"), (1, "d"), (2, "b"), (2, "b")]
    with BagWriter(tmp_path / "bag") as writer:
        keys = [writer.add_topic(name, "std_msgs/msg/String") for name in ("/repeated", "/other")]
        for second, text in messages:
            for key in keys:
                writer.write(key, _string(text), second * S)
    copy = copy_without_repeats(tmp_path / "bag", ["/repeated"], tmp_path / "copy")
    with BagReader(copy) as reader:
        kept = [(raw.topic, raw.log_time_ns // S, raw.data) for raw in reader.raw_messages()]
    expected = [(0, "a"), (1, "b"), (1, "c"), (1, "d"), (2, "b")]
    assert kept == [("/repeated", second, _string(text)) for second, text in expected]


def _string(text: str) -> bytes:
    data = text.encode() + b"\0"
    return b"\x00\x01\x00\x00" + len(data).to_bytes(4, "little") + data
