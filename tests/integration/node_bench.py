"""Nodes in the process of the test: messages handed to their callbacks, what they publish kept in lists.

No discovery, no waiting: what a node answers stands in the list when the callback returns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.serialization import deserialize_message, serialize_message
from std_srvs.srv import Trigger
from tests.waiting import PATIENCE_S, wait_until

from iptm_ros.codecs import stamp_of
from iptm_ros.diagnostics import Level, status_values
from iptm_ros.publishers import PatientPublisher
from iptm_ros.services import Service
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import TOPICS, Topic

S = 1_000_000_000


class NodeBench:
    """One node, and all messages received from it."""

    def __init__(self, factory: Callable[[], SuiteNode]) -> None:
        self.received: dict[Topic, list[Any]] = {}
        advertise = SuiteNode.advertise

        def advertise_and_keep(node: SuiteNode, topic: Topic) -> Any:
            publisher = advertise(node, topic)
            publisher.publish = self._keeper(topic)  # type: ignore[method-assign]
            return publisher

        # As if each topic had a subscription; without, some are not published.
        self._patch = mock.patch.object(PatientPublisher, "is_heard", new=True)
        self._patch.start()
        with mock.patch.object(SuiteNode, "advertise", advertise_and_keep):
            self.node = factory()
        names = {"/" + TOPICS[topic].name.lstrip("/"): topic for topic in TOPICS}
        self._takers = {
            names[subscription.topic_name]: subscription
            for subscription in self.node.subscriptions
            if subscription.topic_name in names
        }
        self._executor = EventsExecutor()
        self._executor.add_node(self.node)

    def _keeper(self, topic: Topic) -> Callable[[Any], None]:
        heard = self.received.setdefault(topic, [])

        def keep(message: Any) -> None:
            kind = TOPICS[topic].message_type
            heard.append(
                deserialize_message(message, kind) if isinstance(message, bytes) else message
            )

        return keep

    def hear(self, messages: dict[Topic, Any], *topics: Topic) -> None:
        """Hand messages to the callbacks, all of them or those of some topics."""
        for topic in topics or messages:
            message = messages[topic]
            taker = self._takers[topic]
            data = message if isinstance(message, bytes) else bytes(serialize_message(message))
            if taker.raw:
                taker.callback(data)
            else:
                taker.callback(deserialize_message(data, TOPICS[topic].message_type))

    def stamps(self, topic: Topic) -> list[int]:
        """Stamps of the messages of a topic, in s."""
        return [stamp_of(message) // S for message in self.received[topic]]

    @property
    def situation(self) -> tuple[Level, str]:
        """Newest level and reason."""
        status = self.received[Topic.DIAGNOSTICS][-1].status[0]
        return Level(status.level), status.message

    @property
    def values(self) -> dict[str, str]:
        """Newest key values."""
        return status_values(self.received[Topic.DIAGNOSTICS][-1].status[0])

    def call(self, service: Service) -> Trigger.Response:
        """Call a service of the node and return its answer."""
        name = f"/{service.value}"
        (server,) = [each for each in self.node.services if each.service_name == name]
        answer: Trigger.Response = server.callback(Trigger.Request(), Trigger.Response())
        return answer

    def reasons(self) -> list[str]:
        """Reasons of all reports so far."""
        return [array.status[0].message for array in self.received[Topic.DIAGNOSTICS]]

    def spin_until(self, condition: Callable[[], object], timeout_s: float = PATIENCE_S) -> None:
        """Let timers run until a condition is true; fail if that takes too long."""
        wait_until(
            condition,
            timeout_s,
            pause=lambda longest_s: self._executor.spin_once(timeout_sec=longest_s),
            found=lambda: str(self.received[Topic.DIAGNOSTICS][-1:]),
        )

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self._patch.stop()


@contextmanager
def node_bench(factory: Callable[[], SuiteNode], **parameters: object) -> Iterator[NodeBench]:
    """Run a node with parameters in the default context; the environment names the domain."""
    overrides = [part for name, value in parameters.items() for part in ("-p", f"{name}:={value}")]
    rclpy.init(args=["bench", "--ros-args", *overrides])
    try:
        bench = NodeBench(factory)
        try:
            yield bench
        finally:
            bench.close()
    finally:
        rclpy.try_shutdown()
