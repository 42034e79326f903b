"""What the recorder asks of the graph: messages of publishers, as they offer them, and parameters of nodes.

With the parameters, every recording holds the settings of its run.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from rclpy.event_handler import QoSSubscriptionEventType
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.subscription import Subscription
from rclpy.task import Future
from rosbags.interfaces import Qos, QosHistory

from iptm_core.declaration import Scalar, parameter_specs
from iptm_core.errors import BagError, IptmError
from iptm_core.parameters import to_flat_dict
from iptm_core.settings import ModelSettings
from iptm_ros.codecs import REPEATED, repeated_messages
from iptm_ros.recording.rclpy_types import from_profile, message_class, to_profile
from iptm_ros.recording.recorded_topics import (
    QosOverrides,
    TopicSelection,
    is_latched,
    overridden,
    request_for,
)
from iptm_ros.recording.run_information import MODEL_KEY
from iptm_ros.recording.session import RecordingSession
from iptm_ros.topics import TOPICS, Topic

# Published before a trip starts, or whether one runs or not.
_NOT_OF_A_TRIP = (Topic.SLOPE, Topic.DIAGNOSTICS)
_NODE_TOPICS = ("/rosout", "/parameter_events")


@dataclass
class _Subscribed:
    type_name: str
    take: Callable[[bytes], None]
    request: Qos
    subscription: Subscription
    losses: rclpy_implementation.EventHandle
    lost: int = 0
    lost_before: int = 0
    """Lost by subscriptions that were replaced."""


class TopicSubscriber:
    """Keeps the recorder subscribed to the wanted topics of the graph.

    Topics of the suite are subscribed to at once, others once they have a publisher.

    Attributes:
        has_data: whether a message of a trip has arrived: neither static data nor logs nor diagnostics.
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
        repeats: bool = False,
        also: Mapping[str, str] = MappingProxyType({}),
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
        self.has_data = False
        self._repeats: dict[Topic, dict[Topic, Callable[[bytes], None]]] = {}
        for topic, source in REPEATED.items() if repeats else ():
            type_name = self._suite.pop(names[topic], None)
            if type_name is not None:
                offer = (from_profile(TOPICS[topic].offered_qos),)
                write = session.channel(names[topic], type_name, partial(tuple, offer))
                self._repeats.setdefault(source, {})[topic] = write
        added = {node.resolve_topic_name(name): kind for name, kind in also.items()}
        for name, type_name in {**self._suite, **added}.items():
            self._subscribe_to(name, [type_name])

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
        """Topics of the suite that have no publisher."""
        return [
            name
            for name in self._suite
            if not (self._is_matched(name) or self._specs[name].on_request)
        ]

    def look(self) -> None:
        """Subscribe to topics that have got a publisher; call it a few times a second."""
        for name, type_names in list(self._published()):
            self._subscribe_to(name, type_names)

    def count_lost(self) -> None:
        """Update `lost_counts`; call it seldom.

        An event callback would be simpler, but deadlocks: each loss would read the status under the
        lock of the event, which Fast DDS takes the other way round while it receives. A status that
        is reported as changed is read without the lock of the receiver.
        """
        entries = list(self._subscribed.values())
        if not entries:  # a wait set must not be empty
            return
        with self._node.context.handle:
            handle = self._node.context.handle
            changes = rclpy_implementation.WaitSet(0, 0, 0, 0, 0, len(entries), handle)
            indices = [changes.add_event(entry.losses) for entry in entries]
            changes.wait(0)
            for entry, index in zip(entries, indices, strict=True):
                if changes.is_ready("event", index):
                    entry.lost = entry.losses.take_event().total_count

    def adapt(self) -> None:
        """Subscribe again where a new publisher offers less than was asked for; call it seldom."""
        for name, subscribed in self._subscribed.items():
            offered = self._offered_qos(name, subscribed.type_name)
            request = self._request(name, offered)
            if offered and request != subscribed.request:
                subscribed.losses.destroy_when_not_in_use()
                self._node.destroy_subscription(subscribed.subscription)
                subscribed.request = request
                subscribed.lost_before += subscribed.lost
                subscribed.lost = 0
                subscribed.subscription, subscribed.losses = self._raw_subscription(
                    name, subscribed.type_name, subscribed.take, request
                )

    def close(self) -> None:
        """Give up the statuses of losses, which keep the node in the graph after it was destroyed."""
        for entry in self._subscribed.values():
            entry.losses.destroy_when_not_in_use()

    def _published(self) -> Iterator[tuple[str, list[str]]]:
        """Yield the wanted topics with a publisher, and their types, that are still to be taken."""
        if not self._discover:
            return
        for name, type_names in self._node.get_topic_names_and_types():
            is_new = name not in self._subscribed and name not in self._unrecordable
            is_new = is_new and "/_" not in name  # hidden, as `ros2 bag` leaves out by default
            if is_new and self._selection.takes(name) and self._node.count_publishers(name):
                yield name, type_names

    def _is_matched(self, name: str) -> bool:
        """Return whether the subscription to a topic has a publisher."""
        known = self._subscribed.get(name)
        return known is not None and int(known.subscription.get_publisher_count()) > 0

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
        spec = self._specs.get(name)
        offered = self._offered_qos(name, type_name)
        if not offered and spec is not None:
            offered = [from_profile(spec.offered_qos)]
        is_of_trip = name not in self._outside_trip and not any(map(is_latched, offered))
        repeats = {} if spec is None else self._repeats.get(spec.topic, {})

        def take(data: bytes) -> None:
            try:
                if repeats and spec is not None:
                    for topic, repeated in repeated_messages(spec.topic, data).items():
                        if topic in repeats:
                            repeats[topic](repeated)
                write(data)
            except BagError as error:
                self._on_error(error)
            if is_of_trip:
                self.has_data = True

        request = self._request(name, offered)
        self._subscribed[name] = _Subscribed(
            type_name, take, request, *self._raw_subscription(name, type_name, take, request)
        )

    def _raw_subscription(
        self, name: str, type_name: str, take: Callable[[bytes], None], request: Qos
    ) -> tuple[Subscription, rclpy_implementation.EventHandle]:
        """Return a subscription to raw bytes and the status of its losses."""
        subscription = self._node.create_subscription(
            message_class(type_name), name, take, to_profile(request), raw=True
        )
        kind = QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST
        with subscription.handle:
            return subscription, rclpy_implementation.EventHandle(subscription.handle, kind)

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


# One topic of each node of the loop; the one that simulates the vehicle comes first.
_KNOWN_BY = (Topic.PLANT_STATE, Topic.LEADER, Topic.COMMAND)
_OF_EVERY_NODE = ("use_sim_time", "qos_overrides.", "start_type_description_service")
ASK_AGAIN_S = 2.0
"""Wall time after which a node that has not answered is asked again: an answer can be lost between nodes that
find each other just then.
"""


class ParameterCollector:
    """Collects the parameters of the nodes that publish the suite's topics, under whatever names.

    Args:
        node: node that asks.
        on_found: called with all parameters so far, by node of the suite, whenever a node has answered.
    """

    def __init__(
        self, node: Node, on_found: Callable[[Mapping[str, Mapping[str, Scalar]]], None]
    ) -> None:
        self._node = node
        self._on_found = on_found
        self._clients: dict[Topic, AsyncParameterClient] = {}
        self._asked_s: dict[Topic, float] = {}
        self._found: dict[str, dict[str, Scalar]] = {}

    @property
    def nodes(self) -> tuple[str, ...]:
        """Nodes whose parameters are known."""
        return tuple(sorted(self._found))

    def look(self) -> None:
        """Ask the nodes that have come up; call it a few times a second."""
        now_s = time.monotonic()
        for topic in _KNOWN_BY:
            if TOPICS[topic].publisher in self._found:
                continue
            if topic not in self._clients:
                self._find(topic)
            elif (
                now_s - self._asked_s.get(topic, -math.inf) > ASK_AGAIN_S
                and self._clients[topic].services_are_ready()
            ):
                self._asked_s[topic] = now_s
                future = self._clients[topic].list_parameters()
                future.add_done_callback(self._listed(topic))

    def _find(self, topic: Topic) -> None:
        spec = TOPICS[topic]
        for endpoint in self._node.get_publishers_info_by_topic(
            self._node.resolve_topic_name(spec.name)
        ):
            if endpoint.node_name.startswith("_"):  # found a moment ago, not known by name yet
                continue
            full_name = f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
            self._clients[topic] = AsyncParameterClient(self._node, full_name)
            return

    def _listed(self, topic: Topic) -> Callable[[Future], None]:
        def ask(future: Future) -> None:
            response = future.result()
            names = [] if response is None else response.result.names
            own = [name for name in names if not name.startswith(_OF_EVERY_NODE)]
            if own:
                answer = self._clients[topic].get_parameters(own)
                answer.add_done_callback(lambda values: self._take(topic, own, values))

        return ask

    def _take(self, topic: Topic, names: list[str], future: Future) -> None:
        response = future.result()
        if response is None or len(response.values) != len(names):
            return
        values = (parameter_value_to_python(value) for value in response.values)
        self._found[TOPICS[topic].publisher] = dict(zip(names, values, strict=True))
        self._on_found(self._found)


def with_model(by_node: Mapping[str, Mapping[str, Scalar]]) -> dict[str, Any]:
    """Return parameters of nodes together with the model's, as bags store them.

    The model belongs to the plant. Where its set cannot be read here (it is a file of another machine),
    the bag names the set and lacks its values.
    """
    plant = by_node.get(TOPICS[_KNOWN_BY[0]].publisher, {})
    names = [spec.name for spec in parameter_specs(ModelSettings)]
    stored: dict[str, Any] = {node: dict(given) for node, given in by_node.items()}
    if not all(name in plant for name in names):
        return stored
    try:
        model = ModelSettings(**{name: str(plant[name]) for name in names}).model()
    except IptmError:
        return stored
    return {MODEL_KEY: to_flat_dict(model.values), **stored}
