"""The recorder as a real process: nothing lost, killed and recovered, played and recorded again."""

from __future__ import annotations

import signal
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from iptm_interfaces.codecs import time_from_ns
from iptm_interfaces.diagnostics import status_values
from iptm_interfaces.topics import TOPICS, Topic
from iptm_recording.bag_reader import BagReader
from iptm_recording.compare_bags import compare_bags
from iptm_recording.recover import recover

S = 10**9
RECORDER = "iptm_recording.recorder_cli"
# In the order in which a tick publishes them: the state, the clock, the answers to it.
TICK = (
    *(topic for topic in TOPICS if topic.name.startswith("PLANT")),
    Topic.CLOCK,
    Topic.LEADER,
    Topic.LEADER_PREVIEW,
    Topic.PLAN,
    Topic.SOLVE,
    Topic.ACCELERATION_COMMAND,
    Topic.COMPRESSOR_POWER_COMMAND,
    Topic.COMMAND,
)


# A real trip goes at the pace of its solver. Publishing flat out would overrun the publishers' queues
# of ten messages on a busy machine, so the tests wait for the recorder every few ticks.
PACE_TICKS = 5
TAIL_BYTES = 200_000


class Suite:
    """Stands for plant, bridge and controller: publishes every topic of the table, tick by tick."""

    def __init__(self, peer: Any) -> None:
        self.peer = peer
        self.publishers: dict[Topic, Publisher] = {
            topic: peer.node.advertise(topic) for topic in TOPICS
        }
        self.next_tick = 0
        self.recorder = peer.statuses("/recorder")

    def start(self) -> None:
        expected = str(len(TOPICS))
        self.publishers[Topic.SLOPE].publish(TOPICS[Topic.SLOPE].message_type())
        # Both sides must know of each other: a busy machine may take a while between the two.
        self.peer.wait_until(
            lambda: (
                self.recorder
                and status_values(self.recorder[-1])["subscriptions_matched"] == expected
                and all(p.get_subscription_count() for p in self.publishers.values())
            ),
            60.0,
            "recorder to subscribe to everything",
        )

    def publish(self, ticks: int, file: Path | None = None) -> None:
        """Publish ticks; with the file of the recorder, at the pace at which they arrive there."""
        for tick in range(self.next_tick, self.next_tick + ticks):
            for topic in TICK:
                self.publishers[topic].publish(message_of(topic, tick))
            if file is not None and tick % PACE_TICKS == PACE_TICKS - 1:
                # Log and publication time of a message follow each other in the file. A tick is
                # written when the next one begins.
                times = struct.pack("<QQ", (tick - 1) * S, (tick - 1) * S)
                self.peer.wait_until(
                    lambda times=times: tail(file).count(times) >= len(TICK),
                    what=f"tick {tick - 1} in the bag",
                )
        self.next_tick += ticks

    def leave(self) -> None:
        """Stop publishing, so that only a replay is heard."""
        for publisher in self.publishers.values():
            self.peer.node.destroy_publisher(publisher)
        # The executor holds on to a publisher's events until it spins.
        names = [self.peer.node.resolve_topic_name(topic.value) for topic in self.publishers]
        self.peer.wait_until(
            lambda: not any(map(self.peer.node.count_publishers, names)), what="publishers to end"
        )

    @property
    def published_count(self) -> int:
        """Messages published so far, the slope included."""
        return self.next_tick * len(TICK) + 1


def tail(path: Path) -> bytes:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - TAIL_BYTES))
        return file.read()


def message_of(topic: Topic, tick: int) -> Any:
    spec = TOPICS[topic]
    message = spec.message_type()
    if isinstance(message, JointState):
        message.name = list(spec.fields)
        message.position = [tick + 0.1 * k for k in range(len(message.name))]
    elif isinstance(message, JointTrajectory):
        message.joint_names = list(spec.fields)
        numbers = [float(tick)] * len(message.joint_names)
        message.points = [JointTrajectoryPoint(positions=numbers, velocities=numbers)] * 16
    elif isinstance(message, Temperature):
        message.temperature = 20.0 + tick
    elif isinstance(message, Float64):
        message.data = float(tick)
    if isinstance(message, Clock):
        message.clock = time_from_ns(tick * S)
    elif hasattr(message, "header"):
        message.header.stamp = time_from_ns(tick * S)
    return message


@pytest.fixture
def suite(peer: Any) -> Suite:
    return Suite(peer)


@pytest.fixture
def record(launcher: Any, wait_until: Callable[..., None], tmp_path: Path) -> Callable[..., Any]:
    """Start a recorder and wait until it is ready."""

    def start(name: str, *arguments: str) -> Any:
        process = launcher.start_module(RECORDER, tmp_path / name, *arguments)
        wait_until(
            lambda: "recorder ready" in process.stdout or not process.is_running,
            what="recorder ready",
        )
        assert process.is_running, process.stderr
        return process

    return start


def counts_of(bag: Path) -> dict[str, int]:
    with BagReader(bag) as reader:
        return {topic.name: topic.message_count for topic in reader.topics.values()}


def absolute(topic: Topic) -> str:
    return "/" + topic.value.lstrip("/")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_nothing_is_lost_and_the_bag_is_in_simulated_time(
    suite: Suite, record: Callable[..., Any], tmp_path: Path, number: signal.Signals
) -> None:
    recorder = record("bag")
    suite.start()
    suite.publish(300, tmp_path / "bag" / "bag_0.mcap")
    assert recorder.stop(number) == 0
    counts = counts_of(tmp_path / "bag")
    assert counts.pop("/diagnostics") > 0
    assert counts.pop("/v2x/slope") == 1
    assert counts == {absolute(topic): 300 for topic in TICK}
    with BagReader(tmp_path / "bag") as reader:
        assert (reader.start_ns, reader.end_ns) == (0, 299 * S)
        for topic in TICK:
            name = absolute(topic)
            times = [m.log_time_ns for m in reader.raw_messages([name])]
            assert times == [tick * S for tick in range(300)], name
            assert reader.topics[name].type_name == TOPICS[topic].type_name
            assert reader.topics[name].offered_qos[0].depth == TOPICS[topic].qos.depth
        # Between topics the middleware promises no order, so only what is in the tick counts.
        first = [m.topic for m in reader.raw_messages(end_ns=S) if m.topic != "/diagnostics"]
        assert sorted(first) == sorted(["/v2x/slope", *(absolute(topic) for topic in TICK)])
        assert reader.run_information().versions["python"]


def test_killed_recorder_loses_at_most_a_handful(
    suite: Suite, record: Callable[..., Any], tmp_path: Path
) -> None:
    recorder = record("bag")
    suite.start()
    suite.publish(300, tmp_path / "bag" / "bag_0.mcap")
    suite.publish(3)
    recorder.send(signal.SIGKILL)
    recorder.wait()
    assert not (tmp_path / "bag" / "metadata.yaml").exists()
    report = recover(tmp_path / "bag")
    with BagReader(report.output) as reader:
        saved = sum(t.message_count for t in reader.topics.values() if t.name != "/diagnostics")
        # The last three ticks were published flat out until the moment of the kill: what is missing
        # was still on its way, but for one tick in memory.
        assert suite.published_count - saved <= 5 * len(TICK)
        for topic in TICK:
            stamps = [m.log_time_ns for m in reader.raw_messages([absolute(topic)])]
            assert stamps == [tick * S for tick in range(len(stamps))], "a gap before the end"


def test_recorder_is_counted_as_peer_only_when_it_hears_everybody(
    peer: Any, record: Callable[..., Any]
) -> None:
    """Else the plant could start a trip whose first commands are not recorded."""
    late = (Topic.COMMAND, Topic.PLAN, Topic.SOLVE)
    publishers = {topic: peer.node.advertise(topic) for topic in TOPICS if topic not in late}
    gate = publishers[Topic.CLOCK]
    record("bag")
    others = [p for t, p in publishers.items() if t not in (Topic.PLANT_ODOMETRY, Topic.CLOCK)]
    peer.wait_until(lambda: all(p.get_subscription_count() for p in others), what="subscriptions")
    assert gate.get_subscription_count() == 0
    publishers.update((topic, peer.node.advertise(topic)) for topic in late)
    peer.wait_until(gate.get_subscription_count, what="subscription to the clock")
    assert all(publishers[topic].get_subscription_count() == 1 for topic in TOPICS)


def test_namespace_and_diagnostics(peer: Any, record: Callable[..., Any], tmp_path: Path) -> None:
    texts: list[str] = []
    peer.node.listen(
        Topic.DIAGNOSTICS, lambda m: texts.extend(s.name + s.message for s in m.status)
    )
    recorder = record("bag", "--topics", "/car_1/*", "--ros-args", "-r", "__ns:=/car_1")
    publisher = peer.node.create_publisher(Float64, "/car_1/controller/acceleration_command", 10)
    clock = peer.node.create_publisher(Clock, "/car_1/clock", 10)
    foreign = peer.node.create_publisher(Float64, "/car_2/x", 10)
    peer.wait_until(publisher.get_subscription_count, what="subscription to the command")
    publisher.publish(Float64(data=1.0))  # tells the recorder that the trip is running
    peer.wait_until(clock.get_subscription_count, what="subscription to the clock")
    clock.publish(Clock())
    foreign.publish(Float64(data=1.0))
    expected = "/car_1/recorder: recordingrecording"
    peer.wait_until(lambda: expected in texts, what="diagnostics")
    assert recorder.stop() == 0
    # The clock is recorded although it was not asked for: the times come from it.
    command = "/car_1/controller/acceleration_command"
    assert counts_of(tmp_path / "bag") == {command: 1, "/car_1/clock": 1}


def test_everything_in_the_graph_with_its_own_quality_of_service(
    peer: Any, record: Callable[..., Any], tmp_path: Path
) -> None:
    recorder = record("bag", "--all", "--time", "wall")
    best_effort = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    sensor = peer.node.create_publisher(Float64, "/sensor", best_effort)
    peer.wait_until(sensor.get_subscription_count, what="best-effort subscription")
    before = time.time_ns()
    sensor.publish(Float64(data=2.5))
    peer.wait_until(
        lambda: b"\x04@" in (tmp_path / "bag" / "bag_0.mcap").read_bytes(),
        what="message in the bag",
    )
    assert recorder.stop() == 0
    with BagReader(tmp_path / "bag") as reader:
        message = next(reader.messages(["/sensor"]))
        assert message.message.data == 2.5
        assert message.log_time_ns >= before
        assert reader.topics["/sensor"].offered_qos[0].reliability.name == "BEST_EFFORT"
        assert "/rosout" in reader.topics


def test_existing_bag_and_missing_information_are_mistakes_of_the_user(
    launcher: Any, tmp_path: Path
) -> None:
    (tmp_path / "bag").mkdir()
    for arguments, message in (
        (("bag",), "record: "),
        (("new", "--run-information", "none.yaml"), "none.yaml: no such file"),
        (("new", "--exclude", "/clock"), "--time wall"),
    ):
        launcher.start_module(RECORDER, *arguments).assert_refused(message)


def test_recorded_run_played_and_recorded_again_is_the_same(
    suite: Suite, record: Callable[..., Any], launcher: Any, tmp_path: Path
) -> None:
    recorder = record("first")
    suite.start()
    suite.publish(100, tmp_path / "first" / "first_0.mcap")
    recorder.stop()
    suite.leave()
    recorder = record("second")
    wanted = str(len(counts_of(tmp_path / "first")))
    arguments = ("--rate", "50", "--wait-for-subscribers", wanted)
    player = launcher.start_module("iptm_recording.player_cli", tmp_path / "first", *arguments)
    assert player.wait(60.0) == 0, player.stderr
    assert "played" in player.stdout
    assert recorder.stop() == 0
    comparison = compare_bags(tmp_path / "first", tmp_path / "second")
    assert [entry.topic for entry in comparison if not entry.agrees] == []
    assert len(comparison) == len(TICK) + 1
    with BagReader(tmp_path / "first") as one, BagReader(tmp_path / "second") as two:
        times = [
            [(m.topic, m.log_time_ns) for m in reader.raw_messages() if m.topic != "/diagnostics"]
            for reader in (one, two)
        ]
    assert times[0] == times[1]
