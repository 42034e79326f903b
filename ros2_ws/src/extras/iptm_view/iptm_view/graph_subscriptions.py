"""Subscribes to the suite's topics while they are published, at a bounded cost.

Messages are taken when the viewer asks for them. For a topic of which only the newest are needed, the
middleware drops older ones of a fast run; they are not acknowledged to the nodes.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from rclpy.node import Node
from rclpy.subscription import Subscription
from rosbags.interfaces import QosReliability

from iptm_ros.recording.rclpy_types import from_profile, to_profile
from iptm_ros.recording.recorded_topics import request_for
from iptm_ros.topics import TOPICS, Topic, TopicSpec

OF_A_TRIP = frozenset(TOPICS) - {Topic.DIAGNOSTICS, Topic.SLOPE}
"""Topics whose messages show that a trip is under way."""

WHOLE_DEPTH = 1000
"""Messages to queue of a topic that is wanted whole: several seconds of the fastest run."""


@dataclass(frozen=True)
class _Joined:
    subscription: Subscription
    is_whole: bool


def listening_node(name: str, namespace: str) -> Node:
    """Return a node for `GraphSubscriptions`: no executor serves it."""
    return Node(name, namespace=namespace, enable_rosout=False, start_parameter_services=False)


class GraphSubscriptions:
    """Raw subscriptions of a viewer.

    Attributes:
        names: full name of every topic.
        is_running: whether a trip is under way: something of one has been heard, and the plant is there.
    """

    def __init__(self, node: Node, depth: int, specs: Mapping[Topic, TopicSpec] = TOPICS) -> None:
        self.names = {topic: node.resolve_topic_name(spec.name) for topic, spec in specs.items()}
        self.is_running = False
        self._node = node
        self._depth = depth
        self._specs = specs
        self._joined: dict[Topic, _Joined] = {}
        self._received: list[tuple[int, Topic, bytes]] = []

    @property
    def joined(self) -> Collection[Topic]:
        """Topics that are listened to."""
        return self._joined.keys()

    def look(self, needed: Collection[Topic], whole: Collection[Topic] = ()) -> frozenset[Topic]:
        """Subscribe and unsubscribe to match the graph; return the published topics.

        Args:
            needed: topics that are of use at present.
            whole: the ones of which no message may be missed. Latched ones and diagnostics always
                are among these.
        """
        published = frozenset(
            topic for topic, name in self.names.items() if self._node.count_publishers(name)
        )
        if Topic.PLANT_STATE not in published:
            self.is_running = False
        for topic, spec in self._specs.items():
            if topic in published and topic in needed:
                is_whole = spec.latched or topic is Topic.DIAGNOSTICS or topic in whole
                self._join(topic, is_whole=is_whole)
            else:
                self._leave(topic)
        return published

    def take(self) -> list[tuple[Topic, bytes]]:
        """Return what has arrived since, in the order in which it was published, as CDR bytes."""
        for topic, joined in self._joined.items():
            self._receive(topic, joined.subscription)
        taken, self._received = self._received, []
        if any(topic in OF_A_TRIP for _, topic, _ in taken):
            self.is_running = True
        taken.sort(key=lambda entry: entry[0])
        return [(topic, data) for _, topic, data in taken]

    def _receive(self, topic: Topic, subscription: Subscription) -> None:
        """Take what the middleware has of a topic."""
        with subscription.handle:
            while True:
                found = subscription.handle.take_message(subscription.msg_type, subscription.raw)
                if found is None:
                    return
                data, about = found
                self._received.append((about["source_timestamp"], topic, data))

    def _join(self, topic: Topic, *, is_whole: bool) -> None:
        joined = self._joined.get(topic)
        if joined is not None and joined.is_whole == is_whole:
            return
        self._leave(topic)
        name = self.names[topic]
        infos = self._node.get_publishers_info_by_topic(name)
        offered = [from_profile(info.qos_profile) for info in infos]
        request = request_for(offered, WHOLE_DEPTH if is_whole else self._depth)
        if not is_whole:
            request = request._replace(reliability=QosReliability.BEST_EFFORT)
        subscription = self._node.create_subscription(
            self._specs[topic].message_type, name, _never_called, to_profile(request), raw=True
        )
        self._joined[topic] = _Joined(subscription, is_whole)

    def _leave(self, topic: Topic) -> None:
        joined = self._joined.pop(topic, None)
        if joined is not None:
            self._receive(topic, joined.subscription)  # the last ones of a node that has ended
            self._node.destroy_subscription(joined.subscription)


def _never_called(data: bytes) -> None:
    """Stand for the callback of a subscription that no executor serves."""
