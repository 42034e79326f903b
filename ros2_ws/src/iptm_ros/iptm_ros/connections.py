"""Which nodes hear each other, by name: what a trip waits for before it begins.

A message reaches a node for sure once publisher and subscription have found each other, each on its side.
Every node of the suite reports its side on the latched topic `~/_connections`, and who starts a trip compares
the reports of the nodes that it names, see `StartSignal`.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import permutations
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.task import Future
from std_srvs.srv import Trigger

from iptm_ros.publishers import LATCHED_QOS
from iptm_ros.services import Service
from iptm_ros.topics import Topic, full_name

LOOK_PERIOD_S = 0.05
_NAME = "_connections"
"""Hidden, as ROS calls a name that begins with an underscore: tools list it on request."""
_PUBLISHES, _HEARS = "publishes", "hears"
_OF_EVERY_NODE = ("/rosout", "/parameter_events", Topic.DIAGNOSTICS.value)
_UNNAMED = "_NODE_NAME_UNKNOWN_"
"""Name of an endpoint whose node the middleware has not announced yet."""

ByTopic = Mapping[str, frozenset[str]]
"""Full names of nodes by full name of a topic."""


@dataclass(frozen=True)
class Connections:
    """Nodes at the other ends of the topics of a node.

    Attributes:
        publishes: nodes that are known to receive what the node publishes.
        hears: nodes whose messages the node is known to receive.
    """

    publishes: ByTopic = field(default_factory=dict)
    hears: ByTopic = field(default_factory=dict)


class ConnectionsReport:
    """Publishes the connections of a node whenever they have changed.

    Attributes:
        present: the last report.
    """

    def __init__(self, node: Node) -> None:
        self.present = Connections()
        self._node = node
        self._publishes: dict[str, _Found] = {}
        self._hears: dict[str, _Found] = {}
        self._has_reported = False
        self._publisher = node.create_publisher(DiagnosticStatus, f"~/{_NAME}", LATCHED_QOS)

    def look(self) -> None:
        """Report changes; call it every `LOOK_PERIOD_S`."""
        listeners = self._node.get_subscriptions_info_by_topic
        speakers = self._node.get_publishers_info_by_topic
        has_changed = not self._has_reported
        for publisher in self._node.publishers:
            count, topic = publisher.get_subscription_count(), publisher.topic_name
            if self._is_new(self._publishes, topic, count):
                names = _names(listeners(topic), count, offered=publisher.qos_profile)
                has_changed |= _note(self._publishes, topic, count, names)
        for subscription in self._node.subscriptions:
            count, topic = subscription.get_publisher_count(), subscription.topic_name
            if self._is_new(self._hears, topic, count):
                names = _names(speakers(topic), count, requested=subscription.qos_profile)
                has_changed |= _note(self._hears, topic, count, names)
        if has_changed:
            self._has_reported = True
            self.present = Connections(
                {topic: found.names for topic, found in self._publishes.items()},
                {topic: found.names for topic, found in self._hears.items()},
            )
            name = self._node.get_fully_qualified_name()
            self._publisher.publish(_encode(name, self.present))

    def _is_new(self, known: Mapping[str, _Found], topic: str, count: int) -> bool:
        found = known.get(topic)
        return (found is None or found.number != count) and not self._is_left_out(topic)

    def _is_left_out(self, topic: str) -> bool:
        """Return whether a topic is not reported: those of every node, where there are several vehicles."""
        is_of_one = topic == Topic.DIAGNOSTICS.value and self._node.get_namespace() == "/"
        return (topic in _OF_EVERY_NODE and not is_of_one) or topic.rpartition("/")[2].startswith(
            "_"
        )


class _Found(NamedTuple):
    """Nodes at the other ends of a topic; their number is negative while not all are known by name."""

    number: int
    names: frozenset[str]


def _note(known: dict[str, _Found], topic: str, count: int, names: frozenset[str] | None) -> bool:
    """Note what was found of a topic; return whether it is to be reported."""
    before = known.get(topic)
    # A node may have been found whose name is still on its way: looked for again, and unknown until then.
    known[topic] = _Found(-1, frozenset()) if names is None else _Found(count, names)
    return before is None or before.names != known[topic].names


def _names(
    infos: Iterable[Any],
    matched: int,
    offered: QoSProfile | None = None,
    requested: QoSProfile | None = None,
) -> frozenset[str] | None:
    """Return the full names of the matched endpoints, None while they are not known."""
    names = []
    for info in infos:
        pair = (offered or info.qos_profile, requested or info.qos_profile)
        if qos_check_compatible(*pair)[0] is not QoSCompatibility.ERROR:
            names.append(full_name(info.node_namespace, info.node_name))
    is_known = len(names) == matched and not any(name.endswith(_UNNAMED) for name in names)
    return frozenset(names) if is_known else None


def _encode(name: str, present: Connections) -> DiagnosticStatus:
    values = [
        KeyValue(key=f"{kind} {topic}", value=" ".join(sorted(names)))
        for kind, by_topic in ((_PUBLISHES, present.publishes), (_HEARS, present.hears))
        for topic, names in by_topic.items()
    ]
    return DiagnosticStatus(level=DiagnosticStatus.OK, name=name, values=values)


def _decode(message: DiagnosticStatus) -> Connections:
    found: dict[str, dict[str, frozenset[str]]] = {_PUBLISHES: {}, _HEARS: {}}
    for entry in message.values:
        kind, _, topic = entry.key.partition(" ")
        if kind in found:
            found[kind][topic] = frozenset(entry.value.split())
    return Connections(found[_PUBLISHES], found[_HEARS])


class Meeting:
    """Finds out whether nodes hear each other.

    Args:
        node: subscribes to the reports; it may be one of the nodes.
        names: full names of the nodes.
    """

    def __init__(self, node: Node, names: Iterable[str]) -> None:
        self.names = tuple(dict.fromkeys(names))
        self._reports: dict[str, Connections] = {}
        self._missing: tuple[str, ...] | None = None
        for name in self.names:
            topic = full_name(name, _NAME)
            node.create_subscription(
                DiagnosticStatus, topic, partial(self._take, name), LATCHED_QOS
            )

    def _take(self, name: str, message: DiagnosticStatus) -> None:
        self._reports[name] = _decode(message)
        self._missing = None

    def forget(self, name: str) -> None:
        """Wait for another report of a node, which was started again."""
        self._reports.pop(name, None)
        self._missing = None

    @property
    def absent(self) -> tuple[str, ...]:
        """Nodes that have not reported yet."""
        return tuple(name for name in self.names if name not in self._reports)

    @property
    def missing(self) -> tuple[str, ...]:
        """Connections that are not there on both sides yet, as `/plant -> /recorder: /clock`."""
        if self._missing is None:
            self._missing = tuple(self._found_missing())
        return self._missing

    def _found_missing(self) -> Iterator[str]:
        return (
            f"{one} -> {other}: {topic}"
            for one, other in permutations(self._reports, 2)
            for topic, listeners in self._reports[one].publishes.items()
            if topic in self._reports[other].hears
            if other not in listeners or one not in self._reports[other].hears[topic]
        )

    def deaf_to(self, topics: Collection[str]) -> tuple[str, ...]:
        """Return which nodes subscribe to topics, given by full names, and receive from no node yet."""
        return tuple(
            name
            for name, report in self._reports.items()
            if any(topic in topics and not speakers for topic, speakers in report.hears.items())
        )

    @property
    def is_complete(self) -> bool:
        """Whether all nodes are there and hear each other."""
        return not (self.absent or self.missing)


class StartSignal:
    """Resumes a plant as soon as the nodes of its trip hear each other.

    Attributes:
        meeting: the nodes.
        called_s: steady time of the last call, None before the first.
    """

    REPEAT_S = 1.0
    """Wall time after which an unanswered call is repeated."""

    def __init__(self, node: Node, names: Iterable[str], plant: str) -> None:
        self.meeting = Meeting(node, names)
        self._plant, self._process = plant, ""
        self._client = node.create_client(Trigger, full_name(plant, Service.RESUME.base_name))
        self._answer: Future | None = None
        self.called_s: float | None = None

    def give(self, process: str = "") -> bool:
        """Call the plant when it is time to; return whether it has answered. Call this repeatedly.

        Args:
            process: what runs the plant; another one than before, which was started again, is called as well.
        """
        if self._process not in {"", process}:
            self.meeting.forget(self._plant)
            self._answer = self.called_s = None
        self._process = process
        now_s = time.monotonic()
        if self._answer is not None and self._answer.done():
            return True
        is_due = self.called_s is None or now_s - self.called_s >= self.REPEAT_S
        if is_due and self.meeting.is_complete and self._client.service_is_ready():
            self.called_s = now_s
            self._answer = self._client.call_async(Trigger.Request())
        return False
