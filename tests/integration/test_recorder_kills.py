"""A recorder killed at a random moment: at most one tick may be missing from what it leaves.

The peer stands in for plant, bridge and controller: it publishes every topic of the suite tick by tick, at a
pace that the recorder follows; every other time in a namespace with its clock elsewhere. The kill comes in
the middle of a tick. The long version (`scripts/test -m slow`) kills 100 recorders.
"""

from __future__ import annotations

import random
import signal
import struct
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rosgraph_msgs.msg import Clock
from tests.integration.conftest import Peer

from iptm_core.state import NS_PER_S
from iptm_interfaces.codecs import time_from_ns
from iptm_interfaces.diagnostics import status_values
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import TOPICS, Topic
from iptm_recording.bag_reader import BagReader
from iptm_recording.recover import recover

TICK = tuple(topic for topic in TOPICS if topic not in (Topic.SLOPE, Topic.DIAGNOSTICS))
STAMPED = tuple(
    topic
    for topic in TICK
    if topic is Topic.CLOCK or "header" in TOPICS[topic].message_type.get_fields_and_field_types()
)
CLOCK_ELSEWHERE = "/clock_of_9"
ELSEWHERE = ("-r", "__ns:=/car_9", "-r", f"clock:={CLOCK_ELSEWHERE}")
MOST_TICKS = 60
TIMEOUT_S = 120.0


def stamped(topic: Topic, tick: int) -> Any:
    """Return an empty message of a topic with the stamp of a tick."""
    message = TOPICS[topic].message_type()
    if isinstance(message, Clock):
        message.clock = time_from_ns(tick * NS_PER_S)
    elif hasattr(message, "header"):
        message.header.stamp = time_from_ns(tick * NS_PER_S)
    return message


def beginning(tick: int) -> bytes:
    """Return how a stamped message of a tick begins in the file: publication time, CDR, stamp."""
    return struct.pack("<Q4siI", tick * NS_PER_S, b"\0\1\0\0", tick, 0)


def record_and_kill(
    launcher: Any, peer: Peer, bag: Path, arguments: Sequence[str], seed: int
) -> int:
    """Return the last tick, in the middle of which the recorder was killed."""
    rng = random.Random(seed)  # noqa: S311
    last = rng.randrange(2, MOST_TICKS)
    publishers = {topic: peer.node.advertise(topic) for topic in TOPICS}
    statuses = peer.statuses(f"{peer.node.get_namespace().rstrip('/')}/recorder")
    publishers[Topic.SLOPE].publish(stamped(Topic.SLOPE, 0))
    recorder = launcher.start_module(
        "iptm_recording.recorder_cli", str(bag), "--ros-args", *arguments
    )
    peer.wait_until(
        lambda: (
            statuses
            and status_values(statuses[-1])["subscriptions_matched"] == str(len(TOPICS))
            and all(one.get_subscription_count() for one in publishers.values())
        ),
        TIMEOUT_S,
        "the recorder to subscribe",
    )
    file = bag / f"{bag.name}_0.mcap"

    def is_written(tick: int) -> bool:
        return file.read_bytes().count(beginning(tick)) >= len(STAMPED)

    for tick in range(last):
        for topic in TICK:
            publishers[topic].publish(stamped(topic, tick))
        if tick:  # a tick is written when the next one begins
            peer.wait_until(lambda tick=tick: is_written(tick - 1), TIMEOUT_S, f"tick {tick - 1}")  # type: ignore[misc]
    for topic in TICK[: rng.randrange(len(TICK))]:
        publishers[topic].publish(stamped(topic, last))
    time.sleep(rng.random() * 0.02)  # somewhere inside of the tick
    recorder.send(signal.SIGKILL)
    recorder.wait()
    return last


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 100))]
)
def test_a_killed_recorder_loses_at_most_one_tick(
    seed: int, launcher: Any, ros_environment: dict[str, str], tmp_path: Path
) -> None:
    elsewhere = bool(seed % 2)
    arguments = ELSEWHERE if elsewhere else ()
    context = Context()
    rclpy.init(context=context, domain_id=int(ros_environment["ROS_DOMAIN_ID"]))
    node = SuiteNode("stand_in", context=context, cli_args=["--ros-args", *arguments])
    executor = EventsExecutor(context=context)
    executor.add_node(node)
    try:
        last = record_and_kill(launcher, Peer(node, executor), tmp_path / "bag", arguments, seed)
    finally:
        executor.remove_node(node)
        node.destroy_node()
        executor.shutdown()
        context.try_shutdown()
    with BagReader(recover(tmp_path / "bag").output) as reader:
        for topic in TICK:
            name = f"{'/car_9' if elsewhere else ''}/{topic.value.lstrip('/')}"
            if elsewhere and topic is Topic.CLOCK:
                name = CLOCK_ELSEWHERE
            # Between topics the middleware promises no order, so a log time may be that of the next tick.
            ticks = [message.publish_time_ns // NS_PER_S for message in reader.raw_messages([name])]
            assert ticks == list(range(len(ticks))), f"{name} has a gap or lacks its first tick"
            assert len(ticks) >= last - 1, f"{name}: {last - len(ticks)} ticks lost"
