"""The player as a real process: order, pace, a part with a clock of its own, control, and how it ends."""

from __future__ import annotations

import math
import signal
import struct
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import ReliabilityPolicy, qos_profile_sensor_data
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.message_types import MessageDefinition
from iptm_ros.topics import Topic

S = 10**9
FLOAT = "std_msgs/msg/Float64"
PLAYER = "iptm_bags.player_cli"
Call = Callable[[str], Trigger.Response]
READY = ("--wait-for-subscribers", "1", "--delay", "0")


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Float64 messages 0 to 9, a quarter of a second apart, from 100 s on."""
    with BagWriter(tmp_path / "bag") as writer:
        topic = writer.add_topic("/number", FLOAT)
        for k in range(10):
            writer.write(topic, bytes([0, 1, 0, 0]) + struct.pack("<d", k), 100 * S + k * S // 4)
    return tmp_path / "bag"


@pytest.fixture
def play(launcher: Any) -> Callable[..., Any]:
    """Start a player."""

    def start(played: Path, *arguments: str) -> Any:
        return launcher.start_module(PLAYER, played, *arguments)

    return start


@pytest.fixture
def heard(peer: Any) -> list[float]:
    """The numbers that a listener of the topic hears."""
    numbers: list[float] = []
    peer.node.create_subscription(Float64, "/number", lambda m: numbers.append(m.data), 100)
    return numbers


@pytest.fixture
def call(peer: Any) -> Call:
    """Call a service of the player."""
    return lambda name: peer.call(f"/player/{name}")


@pytest.fixture
def set_parameter(peer: Any) -> Callable[[str, float], bool]:
    """Set a parameter of the player; return whether it was taken."""
    client = AsyncParameterClient(peer.node, "/player")

    def ask(name: str, value: float) -> bool:
        peer.wait_until(client.services_are_ready, what="parameter services")
        future = client.set_parameters([Parameter(name, value=value)])
        peer.wait_until(future.done, what=f"answer of {name}")
        return bool(future.result().results[0].successful)

    return ask


def test_replay_keeps_order_and_never_runs_ahead(
    peer: Any, play: Callable[..., Any], bag: Path
) -> None:
    arrivals: list[tuple[float, float]] = []
    peer.node.create_subscription(
        Float64, "/number", lambda m: arrivals.append((time.monotonic(), m.data)), 10
    )
    player = play(bag, "--rate", "1.25", "--wait-for-subscribers", "1", "--delay", "0.2")
    peer.wait_until(lambda: len(arrivals) == 10, what="ten messages")
    assert player.wait() == 0
    assert [value for _, value in arrivals] == [float(k) for k in range(10)]
    # Nine quarters of a second at 1.25 times the speed; a late first message must not fail the test.
    assert arrivals[-1][0] - arrivals[0][0] > 0.5 * 9 * 0.25 / 1.25


def test_part_with_a_clock_of_its_own(peer: Any, play: Callable[..., Any], bag: Path) -> None:
    clocks: list[float] = []
    values: list[tuple[float, float]] = []
    peer.node.listen(Topic.CLOCK, lambda m: clocks.append(m.clock.sec + 1e-9 * m.clock.nanosec))
    peer.node.create_subscription(
        Float64, "/number", lambda m: values.append((m.data, clocks[-1] if clocks else 0.0)), 10
    )
    part = ("--start", "1", "--duration", "1", "--clock", "100", "--wait-for-subscribers", "1")
    player = play(bag, *part)
    peer.wait_until(lambda: len(values) == 5, what="five messages")
    assert player.wait() == 0
    assert [value for value, _ in values] == [4.0, 5.0, 6.0, 7.0, 8.0]
    # Those before this node was found are missing.
    assert 101.0 <= clocks[0] < 102.0
    assert all(earlier <= later for earlier, later in pairwise(clocks))
    assert max(clocks) <= 102.0
    for value, clock in values[1:]:
        assert clock <= 100.0 + 0.25 * value + 1e-6, "the clock runs ahead of the messages"


def test_player_stops_on_request(
    peer: Any, play: Callable[..., Any], bag: Path, heard: list[float]
) -> None:
    player = play(bag, "--rate", "0.01", "--wait-for-subscribers", "1")
    peer.wait_until(lambda: heard, what="first message")
    assert player.stop(signal.SIGINT) == 0
    waiting = play(bag, "--wait-for-subscribers", "99")
    peer.wait_until(lambda: "waiting for 99" in waiting.stdout, what="player to wait")
    assert waiting.stop(signal.SIGTERM) == 0


def test_a_damaged_bag_ends_the_player_with_one_sentence(
    play: Callable[..., Any], tmp_path: Path
) -> None:
    with BagWriter(tmp_path / "packed", compression="lz4") as writer:
        topic = writer.add_topic("/number", FLOAT)
        for k in range(200):
            writer.write(topic, bytes([0, 1, 0, 0]) + struct.pack("<d", k), k)
    file = tmp_path / "packed" / "packed_0.mcap"
    data = bytearray(file.read_bytes())
    data[data.index(b"lz4") + 11] ^= 0xFF  # first byte of the compressed content
    file.write_bytes(data)
    player = play(tmp_path / "packed", "--delay", "0")
    assert player.wait() == 2
    (line,) = player.stderr.splitlines()
    assert "damaged" in line


def test_services_and_parameters_control_the_playback(
    peer: Any,
    play: Callable[..., Any],
    bag: Path,
    heard: list[float],
    call: Call,
    set_parameter: Callable[[str, float], bool],
) -> None:
    player = play(bag, *READY, "--start-paused")
    assert call("play_next").success
    assert call("play_next").success
    peer.wait_until(lambda: len(heard) >= 2, what="two messages")
    assert set_parameter("seek_s", 1.5)
    assert call("play_next").success
    peer.wait_until(lambda: len(heard) >= 3, what="a message from elsewhere")
    assert set_parameter("seek_s", 0.5)  # back again
    assert call("play_next").success
    peer.wait_until(lambda: len(heard) >= 4, what="a message from before")
    for name, value in (("rate", -1.0), ("rate", math.nan), ("seek_s", 99.0)):
        assert not set_parameter(name, value)
    assert set_parameter("rate", 0.0001)
    assert "playing at 0.5 s" in call("toggle_paused").message
    assert not call("play_next").success
    assert call("pause").message == "paused at 0.5 s of the bag"
    assert set_parameter("rate", 100.0)
    assert call("resume").success
    assert player.wait() == 0, player.stderr
    peer.wait_until(lambda: len(heard) >= 11, what="the rest")
    assert heard == [0.0, 1.0, 6.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]


def test_a_part_in_a_loop_under_another_name_with_other_quality_of_service(
    peer: Any, play: Callable[..., Any], bag: Path, tmp_path: Path
) -> None:
    (tmp_path / "qos.yaml").write_text("/number: {reliability: best_effort}\n/else: {depth: 3}\n")
    heard: list[float] = []
    peer.node.create_subscription(
        Float64, "/car_2/number", lambda m: heard.append(m.data), qos_profile_sensor_data
    )
    player = play(
        bag,
        *READY,
        *("--loop", "--rate", "10", "--start-offset", "0.5", "--playback-duration", "1"),
        *("--qos-profile-overrides-path", str(tmp_path / "qos.yaml")),
        *("--remap", "/number:=/car_2/number"),
    )
    peer.wait_until(lambda: heard.count(2.0) >= 3 and heard.count(6.0) >= 2, what="three rounds")
    assert set(heard) <= {2.0, 3.0, 4.0, 5.0, 6.0}
    (publisher,) = peer.node.get_publishers_info_by_topic("/car_2/number")
    assert publisher.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert player.stop() == 0
    assert "/else is not used" in player.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--remap", "/missing:=/x"), "has no topic '/missing'"),
        (("--remap", "/number:=/1x"), "1x"),
        (("--qos-profile-overrides-path", "none.yaml"), "no such file"),
        (("--ros-args", "-p", "seek_s:=99.0"), "out of range"),
    ],
)
def test_mistakes_are_one_line(
    arguments: tuple[str, ...], message: str, refused: Callable[..., str], bag: Path
) -> None:
    assert message in refused(PLAYER, bag, *READY, *arguments)


def test_types_that_are_defined_otherwise_here_are_not_played(
    play: Callable[..., Any], tmp_path: Path
) -> None:
    """Their bytes would be taken for something else."""
    other = MessageDefinition(FLOAT, "float32 data\n", f"RIHS01_{'0' * 64}")
    with BagWriter(tmp_path / "foreign") as writer:
        topic = writer.add_topic("/a", FLOAT, definition=other)
        writer.write(topic, bytes([0, 1, 0, 0]) + bytes(4), 1)
    player = play(tmp_path / "foreign")
    assert player.wait() == 2
    assert "Float64 is defined otherwise here" in player.stderr
