"""The player as a real process: order, pace, a part with a clock of its own, and how it ends."""

from __future__ import annotations

import signal
import struct
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import Temperature
from std_msgs.msg import Float64

from iptm_interfaces.topics import Topic
from iptm_recording.bag_writer import BagWriter

S = 10**9


@pytest.fixture
def play(launcher: Any) -> Callable[..., Any]:
    """Start a player."""

    def start(bag: Path, *arguments: str) -> Any:
        return launcher.start_module("iptm_recording.player_cli", bag, *arguments)

    return start


@pytest.fixture
def slow_bag(tmp_path: Path) -> Path:
    """Float64 messages 0 to 9, a quarter of a second apart, in simulated time from 100 s on."""
    with BagWriter(tmp_path / "slow") as writer:
        topic = writer.add_topic("/number", "std_msgs/msg/Float64")
        for k in range(10):
            data = bytes([0, 1, 0, 0]) + struct.pack("<d", k)
            writer.write(topic, data, 100 * S + k * S // 4)
    return tmp_path / "slow"


def test_replay_keeps_order_and_never_runs_ahead(
    peer: Any, play: Callable[..., Any], slow_bag: Path
) -> None:
    arrivals: list[tuple[float, float]] = []
    peer.node.create_subscription(
        Float64, "/number", lambda m: arrivals.append((time.monotonic(), m.data)), 10
    )
    player = play(slow_bag, "--rate", "2.5", "--wait-for-subscribers", "1", "--delay", "0.2")
    peer.wait_until(lambda: len(arrivals) == 10, what="ten messages")
    assert player.wait() == 0
    assert [value for _, value in arrivals] == [float(k) for k in range(10)]
    # Nine quarters of a second at 2.5 times the speed; a late first message must not fail the test.
    assert arrivals[-1][0] - arrivals[0][0] > 0.5 * 9 * 0.25 / 2.5


@pytest.mark.parametrize("storage", ["packed SQLite", "ROS 1"])
def test_bags_of_other_storages_are_played(
    storage: str, peer: Any, play: Callable[..., Any], tmp_path: Path
) -> None:
    """Of ROS 1 another layout of the header, too."""
    kind = "sensor_msgs/msg/Temperature"
    is_ros1 = storage == "ROS 1"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_JAZZY)
    stamp = store.types["builtin_interfaces/msg/Time"](7, 8)
    head = store.types["std_msgs/msg/Header"](*([1] if is_ros1 else []), stamp, "pack")
    messages = [store.types[kind](head, float(k), 0.0) for k in range(3)]
    bag = tmp_path / ("old.bag" if is_ros1 else "packed")
    if is_ros1:
        with Ros1Writer(bag) as writer:
            topic = writer.add_connection("/cell", kind, typestore=store, latching=1)
            for k, message in enumerate(messages):
                writer.write(topic, k, bytes(store.serialize_ros1(message, kind)))
    else:
        other = Ros2Writer(bag, version=9, storage_plugin=StoragePlugin.SQLITE3)
        other.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
        with other:
            topic = other.add_connection("/cell", kind, typestore=store)
            for k, message in enumerate(messages):
                other.write(topic, k, bytes(store.serialize_cdr(message, kind)))
    heard: list[Temperature] = []
    peer.node.create_subscription(Temperature, "/cell", heard.append, 10)
    player = play(bag, "--wait-for-subscribers", "1")
    peer.wait_until(lambda: len(heard) == 3, what="three messages")
    assert player.wait() == 0
    assert [message.temperature for message in heard] == [0.0, 1.0, 2.0]
    assert {(m.header.stamp.sec, m.header.stamp.nanosec, m.header.frame_id) for m in heard} == {
        (7, 8, "pack")
    }


def test_part_with_a_clock_of_its_own(peer: Any, play: Callable[..., Any], slow_bag: Path) -> None:
    clocks: list[float] = []
    values: list[tuple[float, float]] = []
    peer.node.listen(Topic.CLOCK, lambda m: clocks.append(m.clock.sec + 1e-9 * m.clock.nanosec))
    peer.node.create_subscription(
        Float64, "/number", lambda m: values.append((m.data, clocks[-1] if clocks else 0.0)), 10
    )
    part = ("--start", "1", "--duration", "1", "--clock", "100", "--wait-for-subscribers", "1")
    player = play(slow_bag, *part)
    peer.wait_until(lambda: len(values) == 5, what="five messages")
    assert player.wait() == 0
    assert [value for value, _ in values] == [4.0, 5.0, 6.0, 7.0, 8.0]
    assert clocks[0] == pytest.approx(101.0, abs=0.2)
    assert all(earlier <= later for earlier, later in pairwise(clocks))
    assert max(clocks) <= 102.0
    for value, clock in values[1:]:
        assert clock <= 100.0 + 0.25 * value + 1e-6, "the clock runs ahead of the messages"


def test_player_stops_on_request(peer: Any, play: Callable[..., Any], slow_bag: Path) -> None:
    arrivals: list[float] = []
    peer.node.create_subscription(Float64, "/number", lambda m: arrivals.append(m.data), 10)
    player = play(slow_bag, "--rate", "0.01", "--wait-for-subscribers", "1")
    peer.wait_until(lambda: arrivals, what="first message")
    assert player.stop(signal.SIGINT) == 0
    waiting = play(slow_bag, "--wait-for-subscribers", "99")
    peer.wait_until(lambda: "waiting for 99" in waiting.stdout, what="player to wait")
    assert waiting.stop(signal.SIGTERM) == 0


def test_bags_that_cannot_be_played(
    play: Callable[..., Any], slow_bag: Path, tmp_path: Path
) -> None:
    whole = (slow_bag / "slow_0.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[:-200])
    (tmp_path / "foreign.mcap").write_bytes(b"text" * 100)
    for bag, message in (
        (tmp_path / "none", "does not exist"),
        (tmp_path / "cut.mcap", "scripts/recover_bag"),
        (tmp_path / "foreign.mcap", "not an MCAP file"),
    ):
        play(bag).assert_refused(message)


def test_a_damaged_bag_ends_the_player_with_one_sentence(
    play: Callable[..., Any], tmp_path: Path
) -> None:
    with BagWriter(tmp_path / "bag", compression="lz4") as writer:
        topic = writer.add_topic("/number", "std_msgs/msg/Float64")
        for k in range(200):
            writer.write(topic, bytes([0, 1, 0, 0]) + struct.pack("<d", k), k)
    file = tmp_path / "bag" / "bag_0.mcap"
    data = bytearray(file.read_bytes())
    data[data.index(b"lz4") + 11] ^= 0xFF  # first byte of the compressed content
    file.write_bytes(data)
    play(tmp_path / "bag", "--delay", "0").assert_refused("damaged")
