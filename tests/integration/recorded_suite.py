"""Stands for plant, bridge and controller in tests of the recorder: publishes every topic, tick by tick."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2, Temperature
from std_msgs.msg import Float64, UInt8MultiArray
from tests.table_messages import encode_table

from iptm_core.lead_track import RangeTrack
from iptm_ros.codecs import time_from_ns
from iptm_ros.codecs.vehicle import encode_tracks
from iptm_ros.diagnostics import status_values
from iptm_ros.topics import TOPICS, Topic

S = 10**9
RECORDER = "iptm_ros.recording.recorder_cli"
TIMEOUT_S = 120.0
_STATE = tuple(topic for topic in TOPICS if topic.name.startswith("PLANT"))
_FIRST = (*_STATE, Topic.CLOCK)
LATCHED = tuple(topic for topic in TOPICS if TOPICS[topic].latched)
"""What is published once, at the start."""
_APART = (*_FIRST, *LATCHED, Topic.DIAGNOSTICS)
TICK = (*_FIRST, *(topic for topic in TOPICS if topic not in _APART))
"""What a tick publishes: the state, the clock, the answers to it."""
STAMPED = tuple(
    topic
    for topic in TICK
    if topic is Topic.CLOCK or "header" in TOPICS[topic].message_type.get_fields_and_field_types()
)


def message_of(topic: Topic, tick: int) -> Any:
    """Return a message whose numbers and stamp are those of a tick."""
    spec = TOPICS[topic]
    message = spec.message_type()
    if isinstance(message, JointState):
        message.name = list(spec.fields)
        message.position = [tick + 0.1 * k for k in range(len(message.name))]
    elif topic is Topic.RANGE_TRACKS:
        message = encode_tracks((RangeTrack(tick + 1.0, 0.0, 0.0),), tick * S)
    elif isinstance(message, PointCloud2):
        numbers = np.arange(16.0) + tick
        message = encode_table(tick * S, dict.fromkeys(spec.fields, numbers))
    elif isinstance(message, Temperature):
        message.temperature = 20.0 + tick
    elif isinstance(message, Float64):
        message.data = float(tick)
    elif isinstance(message, UInt8MultiArray):
        message.data = bytes([tick % 256])
    if isinstance(message, Clock):
        message.clock = time_from_ns(tick * S)
    elif hasattr(message, "header"):
        message.header.stamp = time_from_ns(tick * S)
    return message


class RecordedSuite:
    """All topics of the suite, in the namespace of a node of the test."""

    def __init__(self, peer: Any) -> None:
        self.peer = peer
        self.publishers: dict[Topic, Publisher] = {
            topic: peer.node.advertise(topic) for topic in TOPICS
        }

    def name(self, topic: Topic) -> str:
        """Name of a topic in the graph, remappings included."""
        return str(self.publishers[topic].topic_name)

    def start(self, recorder: str = "/recorder") -> None:
        """Publish the latched messages, and wait until the recorder hears everything."""
        statuses = self.peer.statuses(recorder)
        for topic in LATCHED:
            self.publishers[topic].publish(TOPICS[topic].message_type())
        # Both sides must know of each other: a busy machine may take a while between the two.
        self.peer.wait_until(
            lambda: (
                statuses
                and int(status_values(statuses[-1])["subscriptions_matched"]) >= len(TOPICS)
                and all(p.get_subscription_count() for p in self.publishers.values())
            ),
            TIMEOUT_S,
            "the recorder to subscribe to everything",
        )

    def drive(self, ticks: range, file: Path) -> None:
        """Publish ticks at the pace at which they arrive in a file: one is written when the next begins.

        Publishing flat out would overrun the queues of ten messages of the publishers on a busy machine.
        """
        for tick in ticks:
            self.publish(tick, TICK)
            if tick > 0:
                # Publication time, CDR and stamp of a message follow each other in the file.
                start = struct.pack("<Q4siI", (tick - 1) * S, b"\0\1\0\0", tick - 1, 0)
                self.peer.wait_until(
                    lambda start=start: file.read_bytes().count(start) >= len(STAMPED),
                    TIMEOUT_S,
                    f"tick {tick - 1} in the bag",
                )

    def publish(self, tick: int, topics: tuple[Topic, ...]) -> None:
        for topic in topics:
            self.publishers[topic].publish(message_of(topic, tick))

    def leave(self) -> None:
        """Stop publishing, so that only a replay is heard."""
        names = [self.name(topic) for topic in TOPICS]
        for publisher in self.publishers.values():
            self.peer.node.destroy_publisher(publisher)
        # The executor holds on to a publisher's events until it spins.
        self.peer.wait_until(
            lambda: not any(map(self.peer.node.count_publishers, names)), what="publishers to end"
        )
