"""Kills the recorder at random moments and looks into what it leaves: at most one tick may be missing.

A stand-in for plant, bridge and controller publishes every topic of the suite, tick by tick, at a pace that
the recorder follows; every other time in a namespace with its clock elsewhere. The kill comes in the middle
of a random tick, at a random message. The recovered bag must begin with the first tick and reach to the last
but one that was published as a whole, without a gap.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rosgraph_msgs.msg import Clock

from iptm_bringup.environment import environment_of_run, process_environment
from iptm_core.errors import BagError, ScenarioError
from iptm_core.trip_time import NS_PER_S
from iptm_interfaces.codecs import time_from_ns
from iptm_interfaces.diagnostics import find_status, status_values
from iptm_interfaces.discovery import reserve_domain
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import TOPICS, Topic
from iptm_recording.bag_reader import BagReader
from iptm_recording.recover import recover

TICK = tuple(topic for topic in TOPICS if topic not in (Topic.SLOPE, Topic.DIAGNOSTICS))
STAMPED = tuple(
    topic
    for topic in TICK
    if topic is Topic.CLOCK or "header" in TOPICS[topic].message_type.get_fields_and_field_types()
)
CLOCK_ELSEWHERE = "/clock_of_9"
ELSEWHERE = ("-r", "__ns:=/car_9", "-r", f"clock:={CLOCK_ELSEWHERE}")
MOST_TICKS = 60
TIMEOUT_S = 120.0
_POLL_S = 0.002
_TELL_EVERY = 10


@dataclass
class Kills:
    """Outcome of the campaign.

    Attributes:
        kills: recorders killed.
        lost_ticks: whole ticks lost, one entry for each kill.
        dropped_bytes: of the recovered files, one entry for each kill.
        failures: what must not happen, each with its case.
    """

    kills: int = 0
    lost_ticks: list[int] = field(default_factory=list)
    dropped_bytes: list[int] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


class _StandIn:
    """Publishes every topic of the suite."""

    def __init__(self, node: SuiteNode, executor: Executor) -> None:
        self._executor = executor
        self._publishers = {topic: node.advertise(topic) for topic in TOPICS}
        self._heard: dict[str, str] = {}
        name = f"{node.get_namespace().rstrip('/')}/recorder"

        def hear(message: Any) -> None:
            status = find_status(message, name)
            if status is not None:
                self._heard = dict(status_values(status))

        node.listen(Topic.DIAGNOSTICS, hear)
        self._publishers[Topic.SLOPE].publish(TOPICS[Topic.SLOPE].message_type())

    def wait_until(self, condition: Callable[[], object], what: str) -> None:
        """Spin until a condition is true.

        Raises:
            ScenarioError: that takes too long.
        """
        deadline_s = time.monotonic() + TIMEOUT_S
        while not condition():
            if time.monotonic() > deadline_s:
                raise ScenarioError(f"timed out after {TIMEOUT_S:g} s waiting for {what}")
            self._executor.spin_once(timeout_sec=_POLL_S)

    def wait_for_recorder(self) -> None:
        """Wait until the recorder and the publishers know of each other."""
        self.wait_until(
            lambda: (
                self._heard.get("subscriptions_matched") == str(len(TOPICS))
                and all(p.get_subscription_count() for p in self._publishers.values())
            ),
            "the recorder to subscribe",
        )

    def publish(self, tick: int, topics: Sequence[Topic] = TICK) -> None:
        """Publish the messages of a tick."""
        for topic in topics:
            message = TOPICS[topic].message_type()
            if isinstance(message, Clock):
                message.clock = time_from_ns(tick * NS_PER_S)
            elif hasattr(message, "header"):
                message.header.stamp = time_from_ns(tick * NS_PER_S)
            self._publishers[topic].publish(message)


@contextmanager
def _stand_in(domain: int, place: Sequence[str]) -> Iterator[_StandIn]:
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node = SuiteNode("stand_in", context=context, cli_args=["--ros-args", *place])
    executor = EventsExecutor(context=context)
    executor.add_node(node)
    try:
        yield _StandIn(node, executor)
    finally:
        executor.remove_node(node)
        node.destroy_node()
        executor.shutdown()
        context.try_shutdown()


def kill_once(folder: Path, rng: random.Random, place: Sequence[str]) -> tuple[int, int]:
    """Record, kill, recover.

    Args:
        folder: where to record.
        rng: chooses the moment.
        place: ROS arguments of all nodes.

    Returns:
        Whole ticks lost and bytes dropped.

    Raises:
        BagError: the bag lacks its first tick or has a gap.
        ScenarioError: the recorder does not start or does not follow.
    """
    last = rng.randrange(2, MOST_TICKS)
    bag = folder / "bag"
    file = bag / "bag_0.mcap"
    with reserve_domain() as domain:
        environment = environment_of_run(domain, folder / "ros")
        command = [sys.executable, "-m", "iptm_recording.recorder_cli", str(bag)]
        with process_environment(environment), _stand_in(domain, place) as suite:
            process = subprocess.Popen(  # noqa: S603
                [*command, "--ros-args", *place],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            try:
                suite.wait_for_recorder()
                for tick in range(last):
                    suite.publish(tick)
                    if tick:  # a tick is written when the next one begins
                        mark = _mark(tick - 1)
                        suite.wait_until(
                            lambda mark=mark: file.read_bytes().count(mark) >= len(STAMPED),  # type: ignore[misc]
                            f"tick {tick - 1} in the bag",
                        )
                suite.publish(last, TICK[: rng.randrange(len(TICK))])
                time.sleep(rng.random() * 0.02)
            finally:
                process.send_signal(signal.SIGKILL)
                process.wait()
    report = recover(bag)
    with BagReader(report.output) as reader:
        names = {topic: f"{'/car_9' if place else ''}/{topic.value.lstrip('/')}" for topic in TICK}
        if place:
            names[Topic.CLOCK] = CLOCK_ELSEWHERE
        # Between topics the middleware promises no order, so a log time may be that of the next tick.
        stamps = {
            topic: [
                message.publish_time_ns // NS_PER_S
                for message in reader.raw_messages([names[topic]])
            ]
            for topic in TICK
        }
    whole = min(map(len, stamps.values()))
    for topic, ticks in stamps.items():
        if topic in STAMPED and ticks[:whole] != list(range(whole)):
            raise BagError(f"{topic.value} has a gap or lacks its first tick: {ticks[:5]} ...")
    return max(0, last - whole), report.dropped_bytes


def _mark(tick: int) -> bytes:
    """Return how a stamped message of a tick begins in the file: publication time, CDR, stamp."""
    return struct.pack("<Q4siI", tick * NS_PER_S, b"\0\1\0\0", tick, 0)


def run(kills: int, seed: int, say: Callable[[str], None] | None = None) -> Kills:
    """Kill recorders.

    Args:
        kills: how many.
        seed: of everything random.
        say: told about every failure, and now and then how far it is.
    """
    outcome = Kills()
    for number in range(kills):
        rng = random.Random(f"{seed} {number}")  # noqa: S311  no secret
        place = ELSEWHERE if number % 2 else ()
        failure = ""
        with tempfile.TemporaryDirectory() as folder:
            try:
                lost, dropped = kill_once(Path(folder), rng, place)
            except (BagError, ScenarioError) as error:
                failure = str(error)
            else:
                outcome.lost_ticks.append(lost)
                outcome.dropped_bytes.append(dropped)
                failure = f"{lost} ticks lost" if lost > 1 else ""
        outcome.kills += 1
        if failure:
            outcome.failures.append(f"kill {number}{' elsewhere' if place else ''}: {failure}")
            if say is not None:
                say(outcome.failures[-1])
        if say is not None and outcome.kills % _TELL_EVERY == 0:
            say(f"{outcome.kills} kills, {len(outcome.failures)} failures so far")
    return outcome


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign; returns 1 if anything happened that must not."""
    parser = argparse.ArgumentParser(prog="recorder_kills", description=__doc__)
    parser.add_argument("--kills", type=int, default=100, help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=1, help="default: %(default)s")
    parser.add_argument("--json", type=Path, help="file for the outcome")
    given = parser.parse_args(arguments)
    outcome = run(given.kills, given.seed, lambda text: print(text, file=sys.stderr, flush=True))
    whole, one = outcome.lost_ticks.count(0), outcome.lost_ticks.count(1)
    print(
        f"{outcome.kills} kills: no tick lost in {whole}, one in {one},"
        f" failures {len(outcome.failures)};"
        f" bytes dropped at most {max(outcome.dropped_bytes, default=0)}"
    )
    if given.json is not None:
        given.json.write_text(json.dumps(vars(outcome), indent=2), encoding="utf-8")
    return 1 if outcome.failures else 0


if __name__ == "__main__":
    sys.exit(main())
