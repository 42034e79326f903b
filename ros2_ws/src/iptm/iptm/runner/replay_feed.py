"""Feeds a node with recorded inputs step by step and records its answers."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path

from rclpy.experimental import EventsExecutor
from rclpy.publisher import Publisher

from iptm_core.errors import ScenarioError
from iptm_ros.connections import StartSignal
from iptm_ros.process import joined_node
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.timeline import read_stamp_ns
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import TOPICS, Topic

NAME = "replay_check"
START_TIMEOUT_S = 180.0
"""Enough for a slow machine to compile the controller's problem for the first time."""
ANSWER_TIMEOUT_S = 60.0
SETTLE_S = 0.2
"""Time for unstamped messages of the last step to arrive."""
_SPIN_S = 0.02


def answer_steps(
    steps: Mapping[int, Mapping[Topic, bytes]],
    outputs: Collection[Topic],
    final_answer: Topic,
    names: Mapping[Topic, str],
    answers: Path,
    check_alive: Callable[[], None],
    on_tick: Callable[[int, int], None],
    plant: str = "",
) -> None:
    """Feed a node that is starting, and record its answers in a bag.

    Args:
        steps: inputs of each tick by topic, by the stamp (ns) of the final answer, in order.
        outputs: topics that it publishes.
        final_answer: the topic of them that ends a tick.
        names: full names of the topics.
        answers: bag folder to create.
        check_alive: raises when the node has ended.
        on_tick: called with the number of completed steps and the number of all steps.
        plant: full name of the node if it is a plant, which waits to be resumed.

    Raises:
        ScenarioError: the node does not come up, ends, or gives no answer to a step.
    """
    with (
        joined_node(lambda context: SuiteNode(NAME, context=context)) as (node, executor),
        BagWriter(answers) as writer,
    ):
        feed = _Feed(node, executor, outputs, names, writer, check_alive)
        feed.wait_for_peers({topic for inputs in steps.values() for topic in inputs})
        if plant:
            feed.resume(plant)
        for number, (stamp_ns, inputs) in enumerate(steps.items(), start=1):
            feed.take(stamp_ns, inputs, final_answer)
            on_tick(number, len(steps))
        feed.settle()


def copy_without_repeats(bag: Path, names: Sequence[str], copy: Path) -> Path:
    """Write some topics of a bag into another one, each message once; return the folder of the copy.

    A state that is not answered in time, or that a paused plant keeps up, is published and answered again, at
    the same time of the trip and with the same bytes.

    Raises:
        BagError: the bag cannot be read.
    """
    now_ns = dict.fromkeys(names, -1)
    published: dict[str, set[bytes]] = {name: set() for name in names}
    with BagReader(bag) as reader, BagWriter(copy) as writer:
        keys = {name: writer.add_topic(name, reader.topics[name].type_name) for name in names}
        for raw in reader.raw_messages(list(names)):
            if raw.log_time_ns != now_ns[raw.topic]:
                now_ns[raw.topic], published[raw.topic] = raw.log_time_ns, set()
            if raw.data not in published[raw.topic]:
                published[raw.topic].add(raw.data)
                writer.write(keys[raw.topic], raw.data, raw.log_time_ns)
    return copy


class _Feed:
    def __init__(
        self,
        node: SuiteNode,
        executor: EventsExecutor,
        outputs: Collection[Topic],
        names: Mapping[Topic, str],
        writer: BagWriter,
        check_alive: Callable[[], None],
    ) -> None:
        self._node, self._executor, self._names = node, executor, names
        self._writer, self._check_alive = writer, check_alive
        self._newest = dict.fromkeys(outputs, -1)
        self._now_ns = 0
        self._publishers: dict[Topic, Publisher] = {}
        self._keys = {
            topic: writer.add_topic(names[topic], TOPICS[topic].type_name) for topic in outputs
        }
        self._subscriptions = {
            topic: node.create_subscription(
                TOPICS[topic].message_type,
                names[topic],
                partial(self._hear, topic),
                TOPICS[topic].qos,
                raw=True,
            )
            for topic in outputs
        }

    def wait_for_peers(self, inputs: Collection[Topic]) -> None:
        """Advertise the inputs, and wait until both sides are connected."""
        self._publishers = {
            topic: self._node.create_publisher(
                TOPICS[topic].message_type, self._names[topic], TOPICS[topic].offered_qos
            )
            for topic in inputs
        }
        self._spin_until(
            lambda: (
                all(p.get_subscription_count() for p in self._publishers.values())
                and all(s.get_publisher_count() for s in self._subscriptions.values())
            ),
            START_TIMEOUT_S,
            "the node does not come up",
        )

    def resume(self, plant: str) -> None:
        """Have a plant begin."""
        signal = StartSignal(self._node, (), plant)
        self._spin_until(signal.give, ANSWER_TIMEOUT_S, "the plant does not begin")

    def take(self, stamp_ns: int, inputs: Mapping[Topic, bytes], final_answer: Topic) -> None:
        """Publish the inputs of a tick, and wait for the final answer."""
        self._now_ns = stamp_ns
        for topic, data in inputs.items():
            self._publishers[topic].publish(data)
        self._spin_until(
            lambda: self._newest[final_answer] >= stamp_ns,
            ANSWER_TIMEOUT_S,
            f"no {final_answer.value} for {stamp_ns * 1e-9:g} s of the trip",
        )

    def settle(self) -> None:
        """Receive pending messages; a node that has finished its trip may end now."""
        until_s = time.monotonic() + SETTLE_S
        while time.monotonic() < until_s:
            self._executor.spin_once(timeout_sec=_SPIN_S)

    def _hear(self, topic: Topic, data: bytes) -> None:
        stamp_ns = read_stamp_ns(data)
        self._writer.write(self._keys[topic], data, self._now_ns)
        if stamp_ns is not None:
            self._newest[topic] = max(self._newest[topic], stamp_ns)

    def _spin_until(self, condition: Callable[[], object], timeout_s: float, what: str) -> None:
        deadline_s = time.monotonic() + timeout_s
        while not condition():
            self._check_alive()
            if time.monotonic() > deadline_s:
                raise ScenarioError(f"{what} within {timeout_s:g} s")
            self._executor.spin_once(timeout_sec=_SPIN_S)
