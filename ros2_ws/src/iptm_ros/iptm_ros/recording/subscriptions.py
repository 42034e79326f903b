"""Subscribes the recorder to what is published, when and how the publishers need it."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.subscription import Subscription
from rosbags.interfaces import Qos, QosHistory

from iptm_core.errors import BagError
from iptm_ros.recording.rclpy_types import from_profile, message_class, to_profile
from iptm_ros.recording.recorded_topics import (
    QosOverrides,
    TopicSelection,
    is_latched,
    overridden,
    request_for,
)
from iptm_ros.recording.session import RecordingSession
from iptm_ros.topics import PEER_TOPICS, TOPICS, Topic

# Time for the publishers to learn of the subscriptions made last.
SETTLE_S = 0.3
# Time in which the other topics of the suite begin to show up, if there are any, and the other topics of
# a node of which there is one: a node advertises all of them within a moment.
PATIENCE_ALONE_S = 2.0
# Time in which further nodes show up, if they do: they may start slowly.
PATIENCE_INCOMPLETE_S = 30.0


class PeerGate:
    """Decision when the recorder joins the topics by which the plant counts its peers.

    In lock-step the plant starts once enough peers subscribe to its state and its clock. The
    recorder is one of them, and must not be counted before it receives all topics: else the first
    messages of the controller, or of the plant itself, would be missing from the bag, or the recorder
    would be mistaken for the bridge. It therefore subscribes to these "gate" topics last, when it is
    subscribed to all other topics of the suite. Where no such start is to be expected (the trip is
    running already, or the rest of the suite is not there), it does not wait. A node of the user's need
    not publish every topic of the node whose place it takes.

    Args:
        gate_topics: topics held back.
        awaited: topics that must be subscribed first, and the node that publishes each.

    Attributes:
        is_running: set once a message of a trip has arrived.
    """

    def __init__(self, gate_topics: Collection[str], awaited: Mapping[str, str]) -> None:
        self._gate_topics = frozenset(gate_topics)
        self._awaited = {
            topic: node for topic, node in awaited.items() if topic not in self._gate_topics
        }
        self._seen: frozenset[str] = frozenset()
        self._last_change_s: float | None = None
        self.is_running = False

    def holds(self, topic: str) -> bool:
        """Return whether a topic belongs to the gate."""
        return topic in self._gate_topics

    def is_open(
        self, now_s: float, published: Collection[str], subscribed: Collection[str]
    ) -> bool:
        """Return whether the gate topics may be subscribed to."""
        if self.is_running:
            return True
        seen = frozenset((*published, *subscribed))
        if seen != self._seen:
            self._seen = seen
            self._last_change_s = now_s
        if self._last_change_s is None:
            return False
        unchanged_s = now_s - self._last_change_s
        if self._awaited.keys() <= set(subscribed):
            return unchanged_s >= SETTLE_S
        if self._awaited.keys().isdisjoint(seen):
            return not self._gate_topics.isdisjoint(seen) and unchanged_s >= PATIENCE_ALONE_S
        present = {node for topic, node in self._awaited.items() if topic in subscribed}
        is_every_node_there = present == set(self._awaited.values())
        return unchanged_s >= (PATIENCE_ALONE_S if is_every_node_there else PATIENCE_INCOMPLETE_S)


# Published before a trip starts, or whether one runs or not.
_NOT_OF_A_TRIP = (Topic.SLOPE, Topic.DIAGNOSTICS)
_NODE_TOPICS = ("/rosout", "/parameter_events")


@dataclass
class _Subscribed:
    type_name: str
    take: Callable[[bytes], None]
    request: Qos
    subscription: Subscription
    lost: int = 0
    lost_before: int = 0
    """Lost by subscriptions that were replaced."""


class TopicSubscriber:
    """Keeps the recorder subscribed to the wanted topics of the graph.

    A topic is subscribed to once its publisher is known: the reader then matches the writer
    at once, and every message sent after the match is received.
    """

    def __init__(
        self,
        node: Node,
        session: RecordingSession,
        selection: TopicSelection,
        *,
        discover: bool,
        depth: int,
        on_error: Callable[[BagError], None],
        qos: QosOverrides,
    ) -> None:
        self._node = node
        self._qos = qos
        self._session = session
        self._selection = selection
        self._discover = discover
        self._depth = depth
        self._on_error = on_error
        self._subscribed: dict[str, _Subscribed] = {}
        self._unrecordable: set[str] = set()
        names = {topic: node.resolve_topic_name(spec.name) for topic, spec in TOPICS.items()}
        self._specs = {name: TOPICS[topic] for topic, name in names.items()}
        self._suite = {
            name: TOPICS[topic].type_name for topic, name in names.items() if selection.takes(name)
        }
        self._outside_trip = {*(names[topic] for topic in _NOT_OF_A_TRIP), *_NODE_TOPICS}
        self._gate_names = [names[topic] for topic in PEER_TOPICS]
        self._gate = PeerGate(
            gate_topics=self._gate_names,
            awaited={
                name: self._specs[name].publisher
                for name in self._suite
                if name != names[Topic.DIAGNOSTICS] and not self._specs[name].on_request
            },
        )

    @property
    def has_data(self) -> bool:
        """Whether a message of a trip has arrived: neither static data nor logs nor diagnostics."""
        return self._gate.is_running

    @property
    def subscribed_count(self) -> int:
        """Topics subscribed to."""
        return len(self._subscribed)

    @property
    def lost_counts(self) -> dict[str, int]:
        """Messages that were published and never reached the recorder, by topic, as the middleware counts."""
        totals = {name: entry.lost_before + entry.lost for name, entry in self._subscribed.items()}
        return {name: total for name, total in totals.items() if total}

    @property
    def matched_count(self) -> int:
        """Topics of which messages are sure to be received by now."""
        return sum(map(self._is_matched, self._subscribed))

    @property
    def unused_overrides(self) -> list[str]:
        """Topics whose quality of service was named but that were not there."""
        return sorted(self._qos.keys() - self._subscribed.keys())

    @property
    def awaited_topics(self) -> list[str]:
        """Topics of the suite that have had no publisher so far."""
        return [
            name
            for name in self._suite
            if name not in self._subscribed and not self._specs[name].on_request
        ]

    def select(self, name: str, type_name: str) -> None:
        """Take one more topic, whatever was selected."""
        self._suite[name] = type_name
        if self._selection.include:
            self._selection = TopicSelection(
                (*self._selection.include, name), self._selection.exclude
            )

    def look(self) -> None:
        """Subscribe to topics that have got a publisher; call it a few times a second."""
        published = dict(self._published())
        for name, type_names in published.items():
            if not self._gate.holds(name):
                self._subscribe_to(name, type_names)
        if not any(self._gate.holds(name) for name in published):
            return
        known = [*published, *self._subscribed]
        matched = [name for name in self._subscribed if self._is_matched(name)]
        if self._gate.is_open(time.monotonic(), known, matched):
            self._pass_gate(published)

    def adapt(self) -> None:
        """Subscribe again where a new publisher offers less than was asked for; call it seldom."""
        for name, subscribed in self._subscribed.items():
            offered = self._offered_qos(name, subscribed.type_name)
            request = self._request(name, offered)
            if offered and request != subscribed.request:
                self._node.destroy_subscription(subscribed.subscription)
                subscribed.request = request
                subscribed.lost_before, subscribed.lost = (
                    subscribed.lost_before + subscribed.lost,
                    0,
                )
                subscribed.subscription = self._raw_subscription(
                    name, subscribed.type_name, subscribed.take, request
                )

    def _published(self) -> Iterator[tuple[str, list[str]]]:
        """Yield the wanted topics with a publisher, and their types, that are still to be taken."""
        found = (
            self._node.get_topic_names_and_types()
            if self._discover
            else [(name, [type_name]) for name, type_name in self._suite.items()]
        )
        for name, type_names in found:
            is_new = name not in self._subscribed and name not in self._unrecordable
            if is_new and self._selection.takes(name) and self._node.count_publishers(name):
                yield name, type_names

    def _pass_gate(self, published: dict[str, list[str]]) -> None:
        """Subscribe to the gate topics: one after the other, so that only the last one is a race.

        The middleware announces a subscription a moment before it can receive. The plant needs to
        see all gate topics subscribed; so each is sure to receive before the next is announced.
        """
        for name in self._gate_names:
            if name in published:
                self._subscribe_to(name, published[name])
            is_sure = name not in self._subscribed or self._is_matched(name)
            if not (is_sure or self._gate.is_running):
                return

    def _is_matched(self, name: str) -> bool:
        """Return whether the subscription to a topic has a publisher."""
        matched: int = self._subscribed[name].subscription.get_publisher_count()
        return matched > 0

    def _subscribe_to(self, name: str, type_names: list[str]) -> None:
        if len(type_names) > 1:
            self._give_up(name, f"it is published with several types: {', '.join(type_names)}")
            return
        try:
            self._subscribe(name, type_names[0])
        except BagError as error:
            self._give_up(name, str(error))

    def _give_up(self, name: str, reason: str) -> None:
        self._unrecordable.add(name)
        self._node.get_logger().warning(f"topic {name} is not recorded: {reason}")

    def _subscribe(self, name: str, type_name: str) -> None:
        write = self._session.channel(name, type_name, lambda: self._offered_qos(name, type_name))
        offered = self._offered_qos(name, type_name)
        is_of_trip = name not in self._outside_trip and not any(map(is_latched, offered))

        def take(data: bytes) -> None:
            try:
                write(data)
            except BagError as error:
                self._on_error(error)
            if is_of_trip:
                self._gate.is_running = True

        request = self._request(name, offered)
        subscription = self._raw_subscription(name, type_name, take, request)
        self._subscribed[name] = _Subscribed(type_name, take, request, subscription)

    def _raw_subscription(
        self, name: str, type_name: str, take: Callable[[bytes], None], request: Qos
    ) -> Subscription:
        kind = message_class(type_name)

        def count_lost(event: Any) -> None:
            if name in self._subscribed:
                self._subscribed[name].lost = event.total_count

        return self._node.create_subscription(
            kind,
            name,
            take,
            to_profile(request),
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(message_lost=count_lost),
        )

    def _request(self, name: str, offered: list[Qos]) -> Qos:
        """Return the quality of service to ask for."""
        return overridden(request_for(offered, self._depth), name, self._qos)

    def _offered_qos(self, name: str, type_name: str) -> list[Qos]:
        """Return what the publishers of a topic offer at present.

        The middleware does not announce how many messages a publisher keeps; for the suite's own
        topics, in any namespace, the topic table holds it.
        """
        spec = self._specs.get(name) or next(
            (
                spec
                for spec in TOPICS.values()
                if name.endswith(f"/{spec.name}") and spec.type_name == type_name
            ),
            None,
        )
        offered = []
        for endpoint in self._node.get_publishers_info_by_topic(name):
            qos = from_profile(endpoint.qos_profile)
            if spec is not None and qos.history is QosHistory.UNKNOWN:
                known = from_profile(spec.qos)
                qos = qos._replace(history=known.history, depth=known.depth)
            offered.append(qos)
        return offered
