"""Damaged messages for the three nodes, with ordinary ticks in between: none may end a node or deafen it.

Every message begins as one that a sound suite sends. Its stamp may become any other, numbers become
impossible, bytes are changed, cut off or made up. The long version (`scripts/test -m slow`) sends 300,000.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from typing import Any

import pytest
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from tests.integration.controller_ticks import ROAD, SMALL, tick_messages

from iptm_core.state import NS_PER_S, Command
from iptm_ros.codecs import encode_command, encode_slope
from iptm_ros.diagnostics import status_values
from iptm_ros.topics import Topic

PLANT = {"duration_s": 1e6, "on_lost_controller": "wait"}
NODES: dict[str, tuple[str, dict[str, object]]] = {
    "plant": ("iptm_plant_sim.node", PLANT),
    "controller": ("iptm_controller.node", {**SMALL, "input_timeout_s": 0.05}),
    "v2x_bridge": ("iptm_v2x_bridge.node", {}),
}
ORDINARY_TICKS = 3
BATCH = 1000
STAMP_AT, BODY_AT = 4, 12
"""Offsets behind the four bytes of the encoding."""
NUMBERS = (float("nan"), float("inf"), -float("inf"), -1.0, 0.0, 1e308, -1e308, 5e-324, 1e6)


def restamped(data: bytearray, rng: random.Random, now_s: int) -> bytes:
    stamps = (
        (now_s, 0),
        (0, 0),
        (max(0, now_s + rng.randrange(-40, 40)), 0),
        (now_s, rng.getrandbits(32)),
        (-rng.getrandbits(31) - 1, 0),
        (2**31 - 1, rng.getrandbits(32)),
        (rng.getrandbits(31), rng.getrandbits(30)),
    )
    if len(data) >= BODY_AT:
        struct.pack_into("<iI", data, STAMP_AT, *rng.choice(stamps))
    return bytes(data)


def impossible_number(data: bytearray, rng: random.Random, _: int) -> bytes:
    if len(data) >= BODY_AT + 8:
        # Numbers lie on multiples of eight behind the encoding.
        place = 4 + 8 * rng.randrange(1, (len(data) - 4) // 8)
        struct.pack_into("<d", data, place, rng.choice(NUMBERS))
    return bytes(data)


def changed_bytes(data: bytearray, rng: random.Random, _: int) -> bytes:
    for _ in range(rng.randrange(1, 9)):
        data[rng.randrange(len(data))] = rng.getrandbits(8)
    return bytes(data)


def cut(data: bytearray, rng: random.Random, _: int) -> bytes:
    return bytes(data[: rng.randrange(len(data))])


def wrong_size(data: bytearray, rng: random.Random, _: int) -> bytes:
    """Write a size that the message does not have, wherever one may be."""
    if len(data) >= BODY_AT + 4:
        size = rng.choice((2**31 - 1, 2**32 - 1, 2**20, 65536, 300, 1))
        struct.pack_into("<I", data, 4 * rng.randrange(1, len(data) // 4), size)
    return bytes(data)


def random_bytes(_: bytearray, rng: random.Random, __: int) -> bytes:
    return rng.randbytes(rng.choice((0, 1, 3, 4, 12, 40, 400)))


def too_long(data: bytearray, rng: random.Random, _: int) -> bytes:
    """Append bytes of no field; one in a hundred is larger than any node accepts."""
    return bytes(data) + bytes(2**17 if rng.random() < 0.01 else 200)


DAMAGES: tuple[Callable[[bytearray, random.Random, int], bytes], ...] = (
    restamped,
    restamped,
    impossible_number,
    changed_bytes,
    cut,
    wrong_size,
    random_bytes,
    too_long,
)


@pytest.mark.parametrize("count", [3000, pytest.param(300_000, marks=pytest.mark.slow)])
def test_no_damaged_message_ends_or_deafens_a_node(launcher: Any, peer: Any, count: int) -> None:
    processes = [
        launcher.start_node(module, "--log-level", "fatal", parameters=parameters)
        for module, parameters in NODES.values()
    ]
    values: dict[str, dict[str, str]] = {}

    def on_diagnostics(message: Any) -> None:
        values.update({status.name: status_values(status) for status in message.status})

    def tick() -> int:
        # The plant's own count: clocks are damaged, too.
        return int(values.get("/plant: vehicle", {}).get("tick", 0))

    def drive_on() -> None:
        first = tick()
        peer.wait_until(
            lambda: tick() >= first + ORDINARY_TICKS, 120.0, f"the trip to go on from tick {first}"
        )
        assert all(process.is_running for process in processes)

    peer.node.listen(Topic.DIAGNOSTICS, on_diagnostics)
    valid = {
        **tick_messages(0.0),
        Topic.SLOPE: encode_slope(ROAD),
        Topic.CLOCK: Clock(),
        Topic.COMMAND: encode_command(0, Command(0.1, 100.0)),
    }
    sound = {topic: bytes(serialize_message(message)) for topic, message in valid.items()}
    publishers = {topic: peer.node.advertise(topic) for topic in sound}
    drive_on()
    rng = random.Random(7)  # noqa: S311
    sent = 0
    for number in range(count):
        topic = rng.choice(list(sound))
        data = bytearray(sound[topic])
        if topic is not Topic.SLOPE and rng.random() < 0.5:
            struct.pack_into("<iI", data, STAMP_AT, *divmod(tick() * NS_PER_S, NS_PER_S))
        try:
            publishers[topic].publish(rng.choice(DAMAGES)(data, rng, tick()))
            sent += 1
        except rclpy_implementation.RCLError:
            pass  # DDS itself refuses some without a whole header
        if number % 20 == 0:
            peer.executor.spin_once(timeout_sec=0.01)
        if number % BATCH == BATCH - 1:
            drive_on()
    assert sent > 0.9 * count
    assert {value["caught_errors"] for value in values.values()} == {"0"}, [
        (name, value.get("last_caught_error")) for name, value in values.items()
    ]
