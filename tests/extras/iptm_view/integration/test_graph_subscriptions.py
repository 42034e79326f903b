"""What a viewer takes from the graph: the newest messages of a fast run, all of what is wanted whole."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import Temperature

from iptm_ros.recording.timeline import read_stamp_ns
from iptm_ros.topics import TOPICS, Topic
from iptm_view.graph_subscriptions import GraphSubscriptions

DEPTH = 8
MESSAGES = 100
WATCHED = (Topic.PLANT_CELL_1_TEMPERATURE, Topic.PLANT_CELL_N_TEMPERATURE)


class Published:
    """Publishes the two topics in turn, and has a viewer listen to them."""

    def __init__(self, peer: Any, listener: GraphSubscriptions) -> None:
        self.peer, self.listener = peer, listener
        self.publishers = [
            peer.node.create_publisher(Temperature, TOPICS[topic].name, 2 * MESSAGES)
            for topic in WATCHED
        ]

    def listen(self, *whole: Topic) -> None:
        def is_there() -> bool:
            self.listener.look(WATCHED, whole)
            return all(publisher.get_subscription_count() == 1 for publisher in self.publishers)

        self.peer.wait_until(is_there, what="the viewer's subscriptions")

    def heard(self) -> list[tuple[Topic, int]]:
        """Publish the stamps 0 to MESSAGES - 1; return topics and stamps as the viewer takes them."""
        for stamp_ns in range(MESSAGES):
            message = Temperature()
            message.header.stamp.nanosec = stamp_ns
            for publisher in self.publishers:
                publisher.publish(message)
        taken: list[tuple[Topic, int]] = []
        last = {(topic, MESSAGES - 1) for topic in WATCHED}

        def has_last() -> bool:
            found = [(topic, read_stamp_ns(data)) for topic, data in self.listener.take()]
            taken.extend((topic, stamp) for topic, stamp in found if stamp is not None)
            return last <= set(taken)

        self.peer.wait_until(has_last, what="the last messages")
        return taken


@pytest.fixture
def published(peer: Any) -> Iterator[Published]:
    node = Node("viewer", context=peer.node.context, enable_rosout=False)
    yield Published(peer, GraphSubscriptions(node, DEPTH))
    node.destroy_node()


def test_messages_come_in_the_order_in_which_they_were_published(published: Published) -> None:
    published.listen()
    taken = published.heard()
    assert taken == sorted(taken, key=lambda entry: (entry[1], WATCHED.index(entry[0])))
    assert published.listener.is_running


def test_of_a_whole_topic_nothing_is_missed_and_nothing_is_acknowledged_for_the_others(
    published: Published,
) -> None:
    whole, newest = WATCHED
    published.listen(whole)
    taken = published.heard()
    assert [stamp for topic, stamp in taken if topic is whole] == list(range(MESSAGES))
    reliability = {
        topic: published.peer.node.get_subscriptions_info_by_topic(f"/{TOPICS[topic].name}")[
            0
        ].qos_profile.reliability
        for topic in WATCHED
    }
    assert reliability == {whole: ReliabilityPolicy.RELIABLE, newest: ReliabilityPolicy.BEST_EFFORT}


def test_a_viewer_that_looks_seldom_takes_no_more_than_the_newest(published: Published) -> None:
    published.listen()
    name = TOPICS[WATCHED[0]].name
    heard: list[Temperature] = []
    published.peer.node.create_subscription(Temperature, name, heard.append, 2 * MESSAGES)
    publisher = published.publishers[0]
    published.peer.wait_until(lambda: publisher.get_subscription_count() == 2, what="a listener")
    for _ in range(MESSAGES):
        publisher.publish(Temperature())
    # The same thread of the middleware delivers to both.
    published.peer.wait_until(lambda: len(heard) == MESSAGES, what="all messages")
    assert 0 < len(published.listener.take()) <= DEPTH + 1


def test_what_has_arrived_of_a_topic_that_ends_is_not_lost(published: Published) -> None:
    published.listen(*WATCHED)
    for publisher in published.publishers:
        publisher.publish(Temperature())
        assert publisher.wait_for_all_acked(Duration(seconds=10.0))
    published.listener.look(())
    assert not published.listener.joined
    assert [topic for topic, _ in published.listener.take()] == list(WATCHED)
