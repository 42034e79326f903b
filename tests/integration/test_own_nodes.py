"""The examples of an own controller and an own plant drive a trip with the rest of the suite."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_typestore

from iptm_core.state import Command
from iptm_interfaces.codecs import encode_command
from iptm_interfaces.topics import Topic

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "how-to" / "own-nodes.md").read_text(encoding="utf-8")
MODULES = {
    "scripts/plant": "iptm_plant_sim.node",
    "scripts/v2x_bridge": "iptm_v2x_bridge.node",
    "scripts/controller": "iptm_controller.node",
}


def start_terminals(launcher: Any, heading: str, *further: str) -> list[Any]:
    """Start the commands of the terminals below a heading of the page, in their order."""
    (section,) = re.findall(rf"^## {heading}\n(.*?)^## ", PAGE, re.DOTALL | re.MULTILINE)
    commands = re.findall(r"```bash\n(.*?)\n```", section, re.DOTALL)
    assert len(commands) == 3
    processes = []
    for command in commands:
        program, *arguments = shlex.split(command)
        if program == "python":
            example, *arguments = arguments
            name, start = Path(example).stem, (sys.executable, ROOT / example)
        else:
            name, start = program, (sys.executable, "-m", MODULES[program])
        own = further if program == "scripts/controller" else ()
        processes.append(launcher.start(name.replace("/", "_"), *start, *arguments, *own))
    return processes


def heard(peer: Any) -> dict[Topic, dict[int, float]]:
    """Note position by stamp (s) of host and leader."""
    positions: dict[Topic, dict[int, float]] = {Topic.PLANT_ODOMETRY: {}, Topic.LEADER: {}}

    def take(topic: Topic, message: Any) -> None:
        positions[topic][message.header.stamp.sec] = message.pose.pose.position.x

    for topic in positions:
        peer.node.listen(topic, lambda message, topic=topic: take(topic, message))
    return positions


def check_trip(positions: dict[Topic, dict[int, float]], duration_s: int) -> None:
    """The trip is complete, goes somewhere, and keeps its distance."""
    host, leader = positions[Topic.PLANT_ODOMETRY], positions[Topic.LEADER]
    assert sorted(host) == list(range(duration_s + 1))
    assert host[duration_s] > 100.0
    assert all(leader[second] > host[second] for second in host if second in leader)


def test_own_controller(launcher: Any, peer: Any) -> None:
    positions = heard(peer)
    bridge, controller, plant = start_terminals(launcher, "Connect your own controller")
    peer.wait_until(lambda: not plant.is_running, 120.0, "the end of the trip")
    assert plant.popen.returncode == 0
    assert controller.stop() == bridge.stop() == 0
    check_trip(positions, 120)


def test_own_plant(launcher: Any, peer: Any) -> None:
    positions = heard(peer)
    fast = ("--ros-args", "-p", "compile_code:=false", "-p", "horizon:=3x1+2x5")
    bridge, controller, plant = start_terminals(launcher, "Connect your own plant", *fast)
    peer.wait_until(lambda: not plant.is_running, 120.0, "the end of the trip")
    assert plant.popen.returncode == 0
    assert controller.stop() == bridge.stop() == 0
    check_trip(positions, 60)


def test_documented_bytes_are_the_message() -> None:
    """The table of bytes in the topic reference, read by a library that is not ours."""
    page = (ROOT / "docs" / "reference" / "topics.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) to (\d+) \| (.*) \| `([0-9a-f ]+)` \|$", page, re.MULTILINE)
    data = bytes.fromhex("".join(text for *_, text in rows))
    sent = encode_command.data("", 12_500_000_000, Command(0.5, 1200.0))
    assert len(data) == len(sent)
    for first, last, content, text in rows:
        if content != "padding":  # any bytes
            assert sent[int(first) : int(last) + 1] == bytes.fromhex(text), content
    store = get_typestore(Stores.ROS2_JAZZY)
    message: Any = store.deserialize_cdr(data, "sensor_msgs/msg/JointState")
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 500_000_000)
    assert message.name == ["acceleration_m_s2", "compressor_power_w"]
    assert message.position.tolist() == [0.5, 1200.0]
    assert message.velocity.size == message.effort.size == 0
