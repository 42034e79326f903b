"""Bags to test with: small, written by the project's own writer, with known content."""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader
from std_msgs.msg import Float64

from iptm_core.decision_record import DecisionRecord
from iptm_core.trajectory import Trajectory
from iptm_ros.codecs import encode_decision_record, serialized
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.recorded_topics import DEFAULT_QOS
from iptm_ros.topics import TOPICS, Topic

SECOND_NS = 10**9


def float_bytes(value: float) -> bytes:
    return serialized(Float64(data=float(value)))


def messages_of_unfinished(file: Path) -> int:
    """Return how many messages stand in a file without an end, by the library alone."""
    found = 0
    with file.open("rb") as stream, suppress(EndOfFile, struct.error):
        for record in StreamReader(stream).records:
            found += isinstance(record, Message)
    return found


@pytest.fixture
def encode() -> Callable[[float], bytes]:
    """Serialise a Float64."""
    return float_bytes


@pytest.fixture
def small_bag(tmp_path: Path) -> Path:
    """Two topics, 20 messages each, one per second from 0 s on; /a carries 0, 1, ..., /b 0, -1, ..."""
    folder = tmp_path / "small"
    with BagWriter(folder, custom_data={"scenario": "small", "seed": "7"}) as writer:
        a = writer.add_topic("/a", "std_msgs/msg/Float64", offered_qos=[DEFAULT_QOS])
        b = writer.add_topic("/b", "std_msgs/msg/Float64")
        for k in range(20):
            writer.write(a, float_bytes(k), k * SECOND_NS)
            writer.write(b, float_bytes(-k), k * SECOND_NS + 1)
    return folder


@pytest.fixture
def write_run(
    tick_messages: Callable[[Trajectory, int], dict[Topic, Any]],
    decision_record: Callable[[int], DecisionRecord],
) -> Callable[..., Path]:
    """Write the bag that a run leaves; `drop` leaves out messages by (topic, row)."""

    def write(
        folder: Path,
        run: Trajectory,
        *,
        namespace: str = "",
        drop: frozenset[tuple[Topic, int]] = frozenset(),
        custom_data: dict[str, str] | None = None,
        solve_time_s: float = 0.01,
    ) -> Path:
        with BagWriter(folder, custom_data=custom_data) as writer:
            ids: dict[Topic, int] = {}
            for row, time_s in enumerate(run.time_s):
                record = replace(decision_record(row), solve_time_s=solve_time_s)
                solve = encode_decision_record(round(float(time_s) * 1e9), record)
                for topic, message in (tick_messages(run, row) | {Topic.SOLVE: solve}).items():
                    if topic not in ids:
                        spec = TOPICS[topic]
                        ids[topic] = writer.add_topic(f"{namespace}/{spec.name}", spec.type_name)
                    if (topic, row) not in drop:
                        # The log times are unrelated to the ticks: only the stamps count.
                        data = serialized(message)
                        writer.write(ids[topic], data, 5 * SECOND_NS + row)
        return folder

    return write
