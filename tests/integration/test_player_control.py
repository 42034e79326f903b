"""Control of the player; loops, other names and other quality of service."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import ReliabilityPolicy, qos_profile_sensor_data
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from iptm_recording.bag_writer import BagWriter
from iptm_recording.message_types import MessageDefinition

S = 10**9


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Float64 messages 0 to 9, a quarter of a second apart, from 100 s on."""
    with BagWriter(tmp_path / "bag") as writer:
        topic = writer.add_topic("/number", "std_msgs/msg/Float64")
        for k in range(10):
            writer.write(topic, bytes([0, 1, 0, 0]) + struct.pack("<d", k), 100 * S + k * S // 4)
    return tmp_path / "bag"


@pytest.fixture
def play(launcher: Any, bag: Path) -> Callable[..., Any]:
    """Start a player of the bag, which waits for one subscription."""

    def start(*arguments: str) -> Any:
        ready = ("--wait-for-subscribers", "1", "--delay", "0")
        return launcher.start_module("iptm_recording.player_cli", bag, *ready, *arguments)

    return start


@pytest.fixture
def call(peer: Any) -> Callable[[str], Trigger.Response]:
    """Call a service of the player."""

    def ask(name: str) -> Trigger.Response:
        client = peer.node.create_client(Trigger, f"/player/{name}")
        peer.wait_until(client.service_is_ready, what=name)
        future = client.call_async(Trigger.Request())
        peer.wait_until(future.done, what=f"answer of {name}")
        return future.result()

    return ask


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


def test_services_and_parameters_control_the_playback(
    peer: Any,
    play: Callable[..., Any],
    call: Callable[[str], Trigger.Response],
    set_parameter: Callable[[str, float], bool],
) -> None:
    heard: list[float] = []
    peer.node.create_subscription(Float64, "/number", lambda m: heard.append(m.data), 100)
    player = play("--start-paused")
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
    peer: Any, play: Callable[..., Any], tmp_path: Path
) -> None:
    (tmp_path / "qos.yaml").write_text("/number: {reliability: best_effort}\n/else: {depth: 3}\n")
    heard: list[float] = []
    peer.node.create_subscription(
        Float64, "/car_2/number", lambda m: heard.append(m.data), qos_profile_sensor_data
    )
    player = play(
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
    arguments: tuple[str, ...], message: str, play: Callable[..., Any]
) -> None:
    play(*arguments).assert_refused(message)


def test_types_that_are_defined_otherwise_here_are_not_played(
    launcher: Any, tmp_path: Path
) -> None:
    """Their bytes would be taken for something else."""
    name = "std_msgs/msg/Float64"
    other = MessageDefinition(name, "float32 data\n", f"RIHS01_{'0' * 64}")
    with BagWriter(tmp_path / "foreign") as writer:
        topic = writer.add_topic("/a", name, definition=other)
        writer.write(topic, bytes([0, 1, 0, 0]) + bytes(4), 1)
    player = launcher.start_module("iptm_recording.player_cli", tmp_path / "foreign")
    assert player.wait() == 2
    assert "Float64 is defined otherwise here" in player.stderr
