"""The plant's part for tests of the bridge that knows the leader from messages."""

from __future__ import annotations

import socket
from typing import Any

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from iptm_core.road_ahead import RoadAhead
from iptm_core.state import LeaderPreview, LeaderState
from iptm_ros.codecs import (
    decode_leader,
    decode_leader_preview,
    decode_road_ahead,
    stamp_of,
    time_from_s,
)
from iptm_ros.diagnostics import status_values
from iptm_ros.topics import Topic

BRIDGE = "iptm_v2x_bridge.node"
SENDER = "iptm_its.node_sender"


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


class Ego:
    """The plant's part: the clock, the ego vehicle's position, and ears for the bridge."""

    def __init__(self, peer: Any) -> None:
        self.peer = peer
        self.leaders: dict[int, LeaderState] = {}
        self.previews: dict[int, LeaderPreview] = {}
        self.roads: dict[int, RoadAhead] = {}
        self.statuses = peer.statuses("/v2x_bridge")
        self.clock = peer.node.advertise(Topic.CLOCK)
        self.state = peer.node.advertise(Topic.PLANT_STATE)
        peer.node.listen(Topic.LEADER, self._on_leader)
        peer.node.listen(Topic.LEADER_PREVIEW, self._on_preview)
        peer.node.listen(Topic.ROAD_AHEAD, self._on_road)

    def _on_leader(self, message: Any) -> None:
        self.leaders[stamp_of(message)] = decode_leader(message)

    def _on_preview(self, message: Any) -> None:
        stamp_ns, preview = decode_leader_preview(message)
        self.previews[stamp_ns] = preview

    def _on_road(self, message: Any) -> None:
        stamp_ns, road = decode_road_ahead(message)
        self.roads[stamp_ns] = road

    def meet(self, *others: str) -> None:
        """Wait until the bridge and other nodes, and this one, hear each other."""
        self.peer.meet("v2x_bridge", *others)

    def move(self, time_s: float, position_m: float = 0.0) -> None:
        message = JointState(name=["position_m", "speed_m_s"], position=[position_m, 0.0])
        message.header.stamp = time_from_s(time_s)
        self.state.publish(message)
        self.clock.publish(Clock(clock=time_from_s(time_s)))

    def tick(self, time_s: float, position_m: float = 0.0) -> LeaderPreview:
        self.move(time_s, position_m)
        stamp_ns = round(time_s * 1e9)
        self.peer.wait_until(
            lambda: stamp_ns in self.previews and stamp_ns in self.roads,
            what=f"answer to {time_s} s",
        )
        return self.previews[stamp_ns]

    def settled_values(self) -> dict[str, str]:
        """Return the values of the bridge after two more reports."""
        count = len(self.statuses) + 2
        self.peer.wait_until(lambda: len(self.statuses) >= count, what="diagnostics of the bridge")
        return status_values(self.statuses[-1])
