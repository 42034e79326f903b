"""Damaged messages by the hundred thousand for the three nodes, with ordinary ticks in between.

Every message begins as one that a healthy suite sends; its stamp may become any other, numbers become
impossible, bytes are changed, cut off or made up. The messages are handed to the callbacks of the nodes'
subscriptions in this process, or (--over-dds 1) published to nodes that are processes of their own. After
every batch the trip must go on: a node that does not answer any more is deaf.
"""

from __future__ import annotations

import contextlib
import gc
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TextIO
from unittest import mock

import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation

from benchmarks.fuzz_damage import Damage
from benchmarks.harness import resident_memory_mib, run_benchmark
from iptm_bringup.environment import environment_of_run
from iptm_controller.node import ControllerNode
from iptm_core.errors import ScenarioError
from iptm_core.trip_time import NS_PER_S
from iptm_interfaces import stamp_gate
from iptm_interfaces.codecs import ns_from_time
from iptm_interfaces.diagnostics import status_values
from iptm_interfaces.discovery import reserve_domain
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import TOPICS, Topic
from iptm_plant_sim import node_trip
from iptm_plant_sim.node import PlantNode
from iptm_v2x_bridge.node import BridgeNode

RCLError = rclpy_implementation.RCLError
ORDINARY_TICKS = 3
DEAF_AFTER_S = 120.0
WARM_SHARE = 0.2
"""Share of the messages after which memory is measured for the first time: caches are full by then."""
PARAMETERS: dict[str, dict[str, object]] = {
    "plant": {"duration_s": 1e6, "on_lost_controller": "wait", "expected_peers": 1},
    "controller": {"horizon": "2x1+2x5", "input_timeout_s": 0.05},
    "v2x_bridge": {"expected_peers": 1},
}
MODULES = {
    "plant": "iptm_plant_sim.node",
    "controller": "iptm_controller.node",
    "v2x_bridge": "iptm_v2x_bridge.node",
}


class Suite:
    """The nodes under test, and the time of their trip."""

    messages_per_batch: int

    def __init__(self) -> None:
        self.now_ns = 0
        self.unsent = 0
        self.ticks = 0

    def take(self, topic: Topic, data: bytes) -> None:
        """Hand a message to whoever listens to its topic."""
        raise NotImplementedError

    def close(self) -> None:
        """End the nodes."""
        raise NotImplementedError

    def run(self) -> None:
        """Let the nodes work for a moment; end with an error if one of them has ended."""
        raise NotImplementedError

    def memory_mib(self) -> float:
        """Resident memory of all nodes."""
        raise NotImplementedError

    def caught(self) -> tuple[int, str]:
        """Return how many exceptions the nodes caught, and the last one."""
        raise NotImplementedError

    def drive_on(self) -> float:
        """Let the trip go on for some ticks and return the wall time that it took.

        Raises:
            ScenarioError: it does not go on.
        """
        begin_s, wanted = time.monotonic(), self.ticks + ORDINARY_TICKS
        while self.ticks < wanted:
            if time.monotonic() - begin_s > DEAF_AFTER_S:
                raise ScenarioError(
                    f"the trip stands at {self.now_ns} ns for {DEAF_AFTER_S:g} s: a node is deaf"
                )
            self.run()
        return time.monotonic() - begin_s

    def on_clock(self, time_ns: int) -> None:
        """Note a tick of the plant."""
        if time_ns != self.now_ns:
            self.ticks += max(1, (time_ns - self.now_ns) // NS_PER_S)
            self.now_ns = time_ns


class NodesHere(Suite):
    """All nodes in this process; their waits are shortened, so that many recoveries fit into a run."""

    messages_per_batch = 5000

    def __init__(self) -> None:
        super().__init__()
        arguments = [
            part
            for node, parameters in PARAMETERS.items()
            for name, value in parameters.items()
            for part in ("-p", f"{node}:{name}:={value}")
        ]
        rclpy.init(args=["fuzz", "--ros-args", "--log-level", "fatal", *arguments])
        self._waits = contextlib.ExitStack()
        self._waits.enter_context(mock.patch.object(stamp_gate, "LEAST_QUIET_S", 0.05))
        self._waits.enter_context(mock.patch.object(node_trip, "REPEAT_S", 0.1))
        self._nodes: tuple[SuiteNode, ...] = (PlantNode(), ControllerNode(), BridgeNode())
        self._listener = SuiteNode("listener")
        self._listener.listen(
            Topic.CLOCK, lambda message: self.on_clock(ns_from_time(message.clock))
        )
        self._callbacks: dict[str, list[Callable[[bytes], None]]] = {}
        self._executor = EventsExecutor()
        self._executor.add_node(self._listener)
        for node in self._nodes:
            self._executor.add_node(node)
            for subscription in node.subscriptions:
                self._callbacks.setdefault(subscription.topic_name, []).append(
                    subscription.callback
                )

    def take(self, topic: Topic, data: bytes) -> None:
        """Call back whoever listens to the topic."""
        for callback in self._callbacks.get("/" + TOPICS[topic].name.lstrip("/"), ()):
            callback(data)

    def run(self) -> None:
        """Let timers and the nodes' own messages run."""
        self._executor.spin_once(timeout_sec=0.002)

    def memory_mib(self) -> float:
        """Memory of this process."""
        gc.collect()
        return resident_memory_mib(os.getpid())

    def caught(self) -> tuple[int, str]:
        """Exceptions by the nodes' own count."""
        defects = [node.health.defects for node in self._nodes]
        last = max(defects, key=lambda defect: defect.last_s)
        return sum(defect.count for defect in defects), last.what

    def close(self) -> None:
        """Destroy the nodes."""
        for node in (self._listener, *self._nodes):
            self._executor.remove_node(node)
            node.destroy_node()
        self._executor.shutdown()
        rclpy.try_shutdown()
        self._waits.close()


class NodesOverDds(Suite):
    """All nodes as processes of their own, as users run them."""

    messages_per_batch = 10_000

    def __init__(self, environment: dict[str, str]) -> None:
        super().__init__()
        self._values: dict[str, dict[str, str]] = {}
        context = Context()
        rclpy.init(context=context)
        self._context = context
        self._node = SuiteNode("fuzz", context=context)
        self._executor = EventsExecutor(context=context)
        self._executor.add_node(self._node)
        self._publishers: dict[Topic, Any] = {}
        self._processes = {
            name: subprocess.Popen(  # noqa: S603  the nodes of the suite
                [sys.executable, "-m", module, "--ros-args", "--log-level", "fatal",
                 *(part for key, value in PARAMETERS[name].items()
                   for part in ("-p", f"{key}:={value}"))],
                env=environment,
                stdin=subprocess.DEVNULL,
            )
            for name, module in MODULES.items()
        }  # fmt: skip
        self._node.listen(Topic.DIAGNOSTICS, self._on_diagnostics)

    def _on_diagnostics(self, message: Any) -> None:
        """Follow the trip by the plant's own count: clocks are damaged, too, and queues overflow."""
        for status in message.status:
            values = self._values[status.name] = status_values(status)
            if "tick" in values:
                self.on_clock(int(values["tick"]) * NS_PER_S)

    def take(self, topic: Topic, data: bytes) -> None:
        """Publish the bytes, as far as DDS takes them; it refuses some that have no full head."""
        if topic not in self._publishers:
            self._publishers[topic] = self._node.advertise(topic)
        try:
            self._publishers[topic].publish(data)
        except RCLError:
            self.unsent += 1

    def run(self) -> None:
        """Listen for a moment."""
        self._executor.spin_once(timeout_sec=0.01)
        for name, process in self._processes.items():
            if process.poll() is not None:
                raise ScenarioError(f"{name} ended with code {process.returncode}")

    def memory_mib(self) -> float:
        """Memory of the nodes' processes."""
        return sum(resident_memory_mib(process.pid) for process in self._processes.values())

    def caught(self) -> tuple[int, str]:
        """Exceptions by the nodes' diagnostics."""
        values = self._values.values()
        last = [value["last_caught_error"] for value in values if value["caught_errors"] != "0"]
        return sum(int(value["caught_errors"]) for value in values), (last or ["none"])[0]

    def close(self) -> None:
        """End the processes."""
        for process in self._processes.values():
            process.terminate()
        for process in self._processes.values():
            process.wait(timeout=30)
        self._executor.remove_node(self._node)
        self._node.destroy_node()
        self._executor.shutdown()
        self._context.try_shutdown()


@contextlib.contextmanager
def _without_remarks_of_dds() -> Iterator[TextIO]:
    """Keep the lines away that the decoder of DDS writes past Python, one per message it cannot read.

    Yields:
        What stderr was, for the progress.
    """
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        with os.fdopen(os.dup(kept), "w") as stream:
            yield stream
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


@contextlib.contextmanager
def _suite(*, over_dds: bool) -> Iterator[tuple[Suite, TextIO]]:
    with (
        reserve_domain() as domain,
        tempfile.TemporaryDirectory() as folder,
        _without_remarks_of_dds() as progress,
    ):
        environment = environment_of_run(domain, Path(folder))
        given = dict(os.environ)
        os.environ.update(environment)
        suite = NodesOverDds(environment) if over_dds else NodesHere()
        try:
            yield suite, progress
        finally:
            suite.close()
            os.environ.clear()
            os.environ.update(given)


def measure(messages: int = 1_000_000, seed: int = 1, over_dds: int = 0) -> dict[str, Any]:
    """Send damaged messages and drive on in between.

    Args:
        messages: number of damaged messages.
        seed: of the damage.
        over_dds: 1 publishes them to processes instead of handing them over in this one.

    Raises:
        ScenarioError: a node has ended or become deaf.
    """
    damage, chance = Damage(seed), random.Random(seed)  # noqa: S311
    with _suite(over_dds=bool(over_dds)) as (suite, progress):
        suite.drive_on()
        warm_mib, slowest_s, begin_s = suite.memory_mib(), 0.0, time.monotonic()
        for sent in range(1, messages + 1):
            topic = chance.choice(damage.topics)
            suite.take(topic, damage.message(topic, suite.now_ns))
            if sent % 100 == 0:
                suite.run()
            if sent == int(WARM_SHARE * messages):
                warm_mib = suite.memory_mib()
            if sent % suite.messages_per_batch == 0 or sent == messages:
                slowest_s = max(slowest_s, suite.drive_on())
                growth_mib, (caught, last) = suite.memory_mib() - warm_mib, suite.caught()
                print(
                    f"{sent} messages, {caught} exceptions, {suite.ticks} ticks, "
                    f"{growth_mib:+.1f} MiB, recovered within {slowest_s:.1f} s",
                    file=progress,
                    flush=True,
                )
        return {
            "messages": messages,
            "unsent": suite.unsent,
            "kinds": dict(damage.kinds),
            "exceptions": caught,
            "last_exception": last,
            "trip_ticks": suite.ticks,
            "slowest_recovery_s": slowest_s,
            "memory_growth_mib": growth_mib,
            "wall_time_s": time.monotonic() - begin_s,
        }


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
