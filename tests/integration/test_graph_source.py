"""The view beside a graph: a played bag gives the page the same content as the bag itself."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rclpy.node import Node

from iptm_interfaces.topics import Topic
from iptm_recording.bag_reader import BagReader
from iptm_recording.rclpy_types import message_class, to_profile
from iptm_recording.recorded_topics import offer_for
from iptm_recording.storage import RawMessage
from iptm_view.bag_source import BagSource
from iptm_view.graph_source import GraphSource
from iptm_view.page_feed import Cursor, PageFeed

BAG = Path(__file__).resolve().parents[2] / "bags" / "example_us06_120s"
TICKS = 25
REPEAT_S = 1.0
TIMEOUT_S = 120.0


def documents_of(feed: PageFeed) -> dict[str, Any]:
    _, events = feed.changes(Cursor(), timeout_s=0.0)
    return {event.kind: json.loads(event.text) for event in events}


class Player:
    """Publishes the bytes of a bag under a namespace, with the recorded quality of service."""

    def __init__(self, node: Node, reader: BagReader, namespace: str) -> None:
        records = [
            record for record in reader.topics.values() if record.name != Topic.DIAGNOSTICS.value
        ]
        self.publishers = {
            record.name: node.create_publisher(
                message_class(record.type_name),
                f"{namespace}{record.name}",
                to_profile(offer_for(record)),
            )
            for record in records
        }
        self.ticks: dict[int, list[RawMessage]] = {}
        for message in reader.raw_messages():
            if message.topic in self.publishers:
                self.ticks.setdefault(message.log_time_ns, []).append(message)

    def publish(self, tick: int) -> None:
        for message in list(self.ticks.values())[tick]:
            self.publishers[message.topic].publish(message.data)


@pytest.fixture
def reader() -> Iterator[BagReader]:
    with BagReader(BAG) as opened:
        yield opened


def test_every_vehicle_has_a_page_with_the_values_of_its_bag(peer: Any, reader: BagReader) -> None:
    """Two vehicles in one graph, the second some ticks ahead of the first."""
    feed = PageFeed()
    with BagSource(BAG) as bag_source:
        bag_source.load(feed, bag_source.facts)
    expected = documents_of(feed)

    ahead = {"/car_1": 0, "/car_2": 10}
    feeds = {namespace: PageFeed() for namespace in ahead}
    players = {namespace: Player(peer.node, reader, namespace) for namespace in ahead}
    nodes, sources = [], {}
    for namespace, own in feeds.items():
        node = Node("view", namespace=namespace, context=peer.node.context, enable_rosout=False)
        nodes.append(node)
        sources[namespace] = GraphSource(
            node, own, None, lambda facts: facts, reader.run_information()
        )
    deadline_s = time.monotonic() + TIMEOUT_S
    for tick in range(TICKS):
        published_s = -REPEAT_S
        while any(own.row_count <= tick for own in feeds.values()):
            assert time.monotonic() < deadline_s, f"tick {tick} is not shown"
            # Once may be too early: a view joins when it hears that a trip is under way.
            if time.monotonic() - published_s >= REPEAT_S:
                published_s = time.monotonic()
                for namespace, player in players.items():
                    player.publish(tick + ahead[namespace])
            for source in sources.values():
                source.look()
            time.sleep(0.01)
    for namespace, first in ahead.items():
        found = documents_of(feeds[namespace])
        assert found["rows"] == expected["rows"][first : first + TICKS]
        assert found["facts"]["limits"] == expected["facts"]["limits"]
        assert [plan["time_s"][0] for plan in found["plans"]] == [row[0] for row in found["rows"]]
    assert documents_of(feeds["/car_1"])["road"] == expected["road"]
    for node in nodes:
        node.destroy_node()
