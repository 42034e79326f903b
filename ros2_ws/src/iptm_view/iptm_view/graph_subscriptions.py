"""Listens to the suite's topics without being taken for one of its nodes.

Plant and bridge count who listens to their main topics and start when everybody is there. A viewer joins
those only while a trip is running, and leaves what nobody publishes any more.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import partial

from rclpy.node import Node
from rclpy.subscription import Subscription

from iptm_interfaces.topics import TOPICS, Topic, TopicSpec
from iptm_recording.rclpy_types import from_profile, to_profile
from iptm_recording.recorded_topics import request_for

COUNTED_TOPICS = (Topic.PLANT_ODOMETRY, Topic.CLOCK, Topic.LEADER, Topic.LEADER_PREVIEW)
"""Topics by whose listeners plant and bridge count their peers."""

OF_A_TRIP = frozenset(TOPICS) - {Topic.DIAGNOSTICS, Topic.SLOPE}
"""Topics of which a message says that a trip is under way."""


class GraphSubscriptions:
    """Raw subscriptions of a viewer.

    Attributes:
        names: full name of every topic.
        is_running: whether a trip is under way: something of one has been heard, and the plant is there.
    """

    def __init__(
        self,
        node: Node,
        take: Callable[[Topic, bytes], None],
        depth: int,
        specs: Mapping[Topic, TopicSpec] = TOPICS,
    ) -> None:
        """Set up; topics are joined by `look`.

        Args:
            node: listens, in the namespace of the vehicle.
            take: given every message as its CDR bytes.
            depth: messages to queue per topic.
            specs: topics that may be listened to.
        """
        self.names = {topic: node.resolve_topic_name(spec.name) for topic, spec in specs.items()}
        self.is_running = False
        self._node = node
        self._take_message = take
        self._depth = depth
        self._specs = specs
        self._subscribed: dict[Topic, Subscription] = {}

    @property
    def joined(self) -> Collection[Topic]:
        """Topics that are listened to."""
        return self._subscribed.keys()

    def look(self, needed: Collection[Topic]) -> frozenset[Topic]:
        """Join and leave as the graph says; return the topics that are published.

        Args:
            needed: topics that are of use at present.
        """
        published = frozenset(
            topic for topic, name in self.names.items() if self._node.count_publishers(name)
        )
        if Topic.PLANT_ODOMETRY not in published:
            self.is_running = False
        for topic in self._specs:
            is_open = self.is_running or topic not in COUNTED_TOPICS
            if topic in published and topic in needed and is_open:
                self._join(topic)
            elif topic in self._subscribed:
                self._node.destroy_subscription(self._subscribed.pop(topic))
        return published

    def _join(self, topic: Topic) -> None:
        if topic in self._subscribed:
            return
        name = self.names[topic]
        infos = self._node.get_publishers_info_by_topic(name)
        offered = [from_profile(info.qos_profile) for info in infos]
        self._subscribed[topic] = self._node.create_subscription(
            self._specs[topic].message_type,
            name,
            partial(self._take, topic),
            to_profile(request_for(offered, self._depth)),
            raw=True,
        )

    def _take(self, topic: Topic, data: bytes) -> None:
        if topic in OF_A_TRIP:
            self.is_running = True
        self._take_message(topic, data)
