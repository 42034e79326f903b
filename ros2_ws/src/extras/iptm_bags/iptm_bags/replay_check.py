"""The command `replay --check`: does a node reproduce the answers recorded in a bag?

A fresh process of the node gets the recorded inputs tick by tick, each when it has answered the one before.
Its answers are recorded and compared with the bag, field by field.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.experimental import EventsExecutor
from rclpy.publisher import Publisher

from iptm.runner.composition import node_command, parameter_file_text
from iptm.runner.supervisor import Supervisor, environment_of_run, process_environment
from iptm.trip_files import still_known
from iptm_bags.compare_bags import (
    NumberTolerance,
    TopicComparison,
    compare_bags,
)
from iptm_bags.replay_inputs import FINAL_ANSWER, OUTPUTS, read_recorded
from iptm_core.errors import ScenarioError
from iptm_ros.connections import StartSignal
from iptm_ros.discovery import reserve_domain
from iptm_ros.process import joined_node
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.recorded_topics import TopicSelection
from iptm_ros.recording.timeline import read_stamp_ns
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import PLANT, TOPICS, Topic, full_name

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


TOLERANCE = NumberTolerance(absolute=1e-6, relative=1e-6)
"""Of numbers, in their units: another processor or compiler rounds otherwise, and a solver ends elsewhere
within its tolerance."""
FINE_TOLERANCES: Mapping[Topic, tuple[tuple[str, ...], NumberTolerance]] = {
    Topic.PLANT_STATE: (("*_capacity_loss",), NumberTolerance(relative=1e-9)),
    Topic.SOLVE: (("*_1_k", "*_1_s"), NumberTolerance(relative=1e-4)),
}
"""Of fields whose numbers are small: an absolute tolerance would hide every difference."""
IGNORED_FIELDS = (
    "solve_time_s",
    "solve_wall_time_s",
    "iterations",
    "objective",
    "header.frame_id",
    "child_frame_id",
    "command_source",
)
"""Fields not compared: they depend on the machine, amplify rounding, are frame names, which changed, or are
not in earlier bags."""


def check_node(
    bag: Path,
    node: str,
    *,
    namespace: str | None = None,
    changes: Mapping[str, Any] | None = None,
    tolerance: NumberTolerance | None = None,
    on_tick: Callable[[int, int], None] = lambda done, all_steps: None,  # noqa: ARG005
) -> list[TopicComparison]:
    """Feed a node the inputs of a bag, and compare its answers.

    Args:
        bag: bag folder or file.
        node: one of `NODES`.
        namespace: of the vehicle; needed only if the bag holds several.
        changes: parameters of the node to change against the recorded ones.
        tolerance: of all numbers; None for `TOLERANCE` and `FINE_TOLERANCES`.
        on_tick: called with the number of completed ticks and the number of all ticks.

    Returns:
        The outcome for every topic that the node publishes.

    Raises:
        BagError: the bag cannot be read or repeated.
        ScenarioError: the node does not start with these parameters, or gives no answer.
    """
    recorded = read_recorded(bag, node, namespace)
    parameters = {**still_known(recorded.parameters), **(changes or {})}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        environment = environment_of_run(stack.enter_context(reserve_domain()), folder / "ros")
        stack.enter_context(process_environment(environment))
        supervisor = Supervisor(environment, lambda name: folder / f"{name}.log")
        stack.callback(supervisor.stop)
        file = folder / "parameters.yaml"
        file.write_text(parameter_file_text(node, parameters), encoding="utf-8")
        command = node_command(node, file, recorded.namespace)
        if Topic.CLOCK in recorded.names:  # which a bag of a namespace need not have there
            command += ["-r", f"{Topic.CLOCK.value}:={recorded.names[Topic.CLOCK]}"]
        supervisor.start(node, command)
        answers = folder / "answers"
        outputs = tuple(topic for topic in OUTPUTS[node] if topic in recorded.names)
        final_answer, alive = FINAL_ANSWER[node], _alive(supervisor)
        plant = full_name(recorded.namespace, PLANT) if node == PLANT else ""
        answer_steps(
            recorded.steps, outputs, final_answer, recorded.names, answers, alive, on_tick, plant
        )
        once = copy_without_repeats(bag, list(recorded.names.values()), folder / "recorded")
        return [
            outcome
            for topic in outputs
            for outcome in _compare(once, answers, topic, recorded.names[topic], tolerance)
        ]


def _compare(
    bag: Path, answers: Path, topic: Topic, name: str, tolerance: NumberTolerance | None
) -> list[TopicComparison]:
    """Compare one topic; its fields of small numbers apart from the others."""
    selection = TopicSelection(include=(name,))
    fine, fine_tolerance = FINE_TOLERANCES.get(topic, ((), TOLERANCE))
    usual = compare_bags(
        bag,
        answers,
        selection=selection,
        tolerance=tolerance or TOLERANCE,
        ignored_fields=(*IGNORED_FIELDS, *(() if tolerance else fine)),
    )
    if not fine or tolerance:
        return usual
    others = tuple(name for name in TOPICS[topic].fields if not _matches(name, fine))
    apart = compare_bags(
        bag,
        answers,
        selection=selection,
        tolerance=fine_tolerance,
        ignored_fields=(*IGNORED_FIELDS, *others),
    )
    return [*usual, *(replace(each, topic=f"{each.topic} ({', '.join(fine)})") for each in apart)]


def _matches(name: str, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def _alive(supervisor: Supervisor) -> Callable[[], None]:
    def check() -> None:
        for ending in supervisor.endings():
            if ending.code != 0:
                reason = ending.last_lines[-1] if ending.last_lines else "no reason given"
                raise ScenarioError(f"{ending.name} {ending.how}: {reason}")

    return check


def tolerances_text(tolerance: NumberTolerance | None) -> str:
    """Return the tolerances of a check in words; None for those that differ by topic."""
    if tolerance is not None:
        return _tolerance_text(tolerance)
    fine = (
        f"{', '.join(fields)} of {topic.value} {_tolerance_text(tolerance)}"
        for topic, (fields, tolerance) in FINE_TOLERANCES.items()
    )
    return "; ".join((_tolerance_text(TOLERANCE), *fine))


def _tolerance_text(tolerance: NumberTolerance) -> str:
    return f"{tolerance.absolute:g} + {tolerance.relative:g} of the value"
