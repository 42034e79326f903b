"""The recorder as a real process: nothing lost, played and recorded again, choice of topics, control."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Temperature
from std_msgs.msg import Float64
from tests.integration.recorded_suite import LATCHED, RECORDER, TICK, RecordedSuite, S

from iptm_bags.compare_bags import compare_bags
from iptm_ros.diagnostics import status_values
from iptm_ros.recording.bag_reader import BagReader, read_model_parameters
from iptm_ros.services import Service
from iptm_ros.topics import TOPICS, Topic

CAR = ("-r", "__ns:=/car_9")
STATE, CLOCK = Topic.PLANT_CELL_1_TEMPERATURE, Topic.CLOCK


@pytest.fixture
def record(launcher: Any, wait_until: Callable[..., None], tmp_path: Path) -> Callable[..., Any]:
    """Start a recorder and wait until it is ready."""

    def start(name: str, *arguments: str | Path) -> Any:
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


def times_of(bag: Path) -> list[tuple[str, int]]:
    with BagReader(bag) as reader:
        return [
            (m.topic, m.log_time_ns) for m in reader.raw_messages() if m.topic != "/diagnostics"
        ]


def test_nothing_is_lost_and_a_replay_is_recorded_alike(
    peer: Any, record: Callable[..., Any], launcher: Any, tmp_path: Path
) -> None:
    """In the time of the trip; stopped by SIGINT and by SIGTERM."""
    ticks, first = 40, tmp_path / "first"
    suite = RecordedSuite(peer)
    recorder = record("first")
    suite.start()
    suite.drive(range(ticks), first / "first_0.mcap")
    assert recorder.stop(signal.SIGINT) == 0
    names = {topic: suite.name(topic) for topic in TICK}
    counts = counts_of(first)
    assert counts.pop("/diagnostics") > 0
    assert {counts.pop(suite.name(topic)) for topic in LATCHED} == {1}
    assert counts == dict.fromkeys(names.values(), ticks)
    with BagReader(first) as reader:
        assert (reader.start_ns, reader.end_ns) == (0, (ticks - 1) * S)
        for topic, name in names.items():
            times = [message.log_time_ns for message in reader.raw_messages([name])]
            assert times == [tick * S for tick in range(ticks)], name
            assert reader.topics[name].type_name == TOPICS[topic].type_name
            assert reader.topics[name].offered_qos[0].depth == TOPICS[topic].qos.depth
        assert reader.run_information().versions["python"]

    suite.leave()
    recorder = record("second")
    wanted = str(len(counts_of(first)))
    arguments = ("--rate", "50", "--wait-for-subscribers", wanted)
    player = launcher.start_module("iptm_bags.player_cli", first, *arguments)
    assert player.wait(120.0) == 0, player.stderr
    assert "played" in player.stdout
    assert recorder.stop(signal.SIGTERM) == 0
    comparison = compare_bags(first, tmp_path / "second")
    assert [entry.topic for entry in comparison if not entry.agrees] == []
    assert len(comparison) == len(TICK) + len(LATCHED)
    assert times_of(first) == times_of(tmp_path / "second")


def test_topics_of_a_namespace_are_chosen_and_the_clock_with_them(
    peer: Any, record: Callable[..., Any], tmp_path: Path
) -> None:
    statuses = peer.statuses("/car_1/recorder")
    recorder = record("bag", "--topics", "/car_1/*", "--ros-args", "-r", "__ns:=/car_1")
    publisher = peer.node.create_publisher(Float64, "/car_1/x", 10)
    clock = peer.node.create_publisher(Clock, "/car_1/clock", 10)
    foreign = peer.node.create_publisher(Float64, "/car_2/x", 10)
    peer.wait_until(publisher.get_subscription_count, what="subscription to the command")
    publisher.publish(Float64(data=1.0))  # the trip is running
    peer.wait_until(clock.get_subscription_count, what="subscription to the clock")
    clock.publish(Clock())
    foreign.publish(Float64(data=1.0))
    peer.wait_until(
        lambda: status_values(statuses[-1])["messages"] == "2", what="both messages at the recorder"
    )
    assert statuses[-1].message == "recording"
    assert recorder.stop() == 0
    command = "/car_1/x"
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


def test_a_run_started_by_hand_keeps_its_parameters(
    launcher: Any, peer: Any, record: Callable[..., Any], tmp_path: Path
) -> None:
    statuses = peer.statuses("/car_9/recorder")
    recorder = record("bag", "--ros-args", *CAR)
    trip = {"cycle": "nycc", "duration_s": 10.0, "overrides": "body.mass_kg=1777"}
    solver = {"horizon": "3x1", "max_iterations": 77}
    plant = launcher.start_node(
        "iptm_plant_sim.node", *CAR, parameters={**trip, "start_paused": True}
    )
    launcher.start_node("iptm_v2x_bridge.node", *CAR, parameters={"cycle": "nycc"})
    launcher.start_node("iptm_controller.node", *CAR, parameters=solver)
    peer.wait_until(
        lambda: status_values(statuses[-1])["parameters_of"] == "controller, plant, v2x_bridge",
        what="the parameters at the recorder",
    )
    launcher.start_module(
        "iptm_ros.call", "/car_9/plant", "resume", "--timeout-s", "120",
        "--connected", "plant,v2x_bridge,controller,recorder",
    )  # fmt: skip
    assert plant.wait(120.0) == 0, plant.stderr
    assert recorder.stop() == 0
    with BagReader(tmp_path / "bag") as reader:
        assert reader.duration_s == pytest.approx(10.0)
        assert reader.topics["/car_9/clock"].message_count == 11
        assert "horizon: 3x1" in reader.run_information().parameters
    parameters, is_stored = read_model_parameters(tmp_path / "bag")
    assert is_stored
    assert parameters.body.mass_kg == 1777.0


def test_messages_that_a_frozen_recorder_missed_are_counted(
    peer: Any, record: Callable[..., Any], tmp_path: Path
) -> None:
    """The nodes do not wait for a recorder; a publisher keeps a hundred messages for it."""
    reports = peer.statuses("/recorder")
    recorder = record("bag", "--topics", f"/{STATE.value}", "/clock")
    state, clock = peer.node.advertise(STATE), peer.node.advertise(CLOCK)
    peer.wait_until(state.get_subscription_count, what="subscription to the state")
    state.publish(Temperature())
    peer.wait_until(clock.get_subscription_count, what="subscription to the clock")
    clock.publish(Clock())
    sent = 1

    def accounted_for() -> bool:
        """Whether the recorder has received, or counts as lost, all that was sent."""
        values = status_values(reports[-1]) if reports else {}
        found = int(values.get("messages", 0)) + int(values.get("lost_messages", 0))
        return found == sent + 1  # with the clock

    peer.wait_until(accounted_for, what="the first messages")
    recorder.send(signal.SIGSTOP)
    for _ in range(6000):  # more than the sockets in between hold
        state.publish(Temperature())
        sent += 1
    recorder.send(signal.SIGCONT)
    deadline_s = time.monotonic() + 120.0
    while not accounted_for():
        assert time.monotonic() < deadline_s, (sent, reports[-1:])
        heard = len(reports)
        state.publish(Temperature())  # the following messages reveal the missing ones
        sent += 1
        peer.wait_until(lambda heard=heard: len(reports) > heard, what="a report of the recorder")
    assert recorder.stop() == 0
    reported = sum(int(number) for number in re.findall(r"(\d+) of /", recorder.stderr))
    with BagReader(tmp_path / "bag") as reader:
        assert reader.topics[f"/{STATE.value}"].message_count + reported == sent
        assert reported > 0
        assert "lost_messages" in reader.run_information().extra


def test_a_stopped_listener_holds_a_publisher_up_once(
    peer: Any, record: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is waited for again when it has followed."""
    recorder, clock = record("bag", "--topics", "/clock"), peer.node.advertise(CLOCK)
    waited: list[bool] = []
    wait_for_all_acked = clock.wait_for_all_acked

    def note(longest: Duration) -> bool:
        if longest.nanoseconds:
            waited.append(wait_for_all_acked(longest))
            return waited[-1]
        return bool(wait_for_all_acked(longest))

    monkeypatch.setattr(clock, "wait_for_all_acked", note)
    peer.wait_until(clock.get_subscription_count, what="subscription to the clock")

    def publish_half_a_queue() -> list[bool]:
        """Return which waits for the listener were long enough."""
        waited.clear()
        for _ in range(50):
            clock.publish(Clock())
            clock.let_listeners_follow()
        return waited[:]

    recorder.send(signal.SIGSTOP)
    stat = Path(f"/proc/{recorder.popen.pid}/stat")
    peer.wait_until(lambda: stat.read_text().rpartition(")")[2].split()[0] == "T", what="the stop")
    assert publish_half_a_queue() == [False]
    assert clock.is_left_behind
    assert publish_half_a_queue() == []
    recorder.send(signal.SIGCONT)

    def has_followed() -> bool:
        publish_half_a_queue()
        return not clock.is_left_behind

    peer.wait_until(has_followed, what="the listener")
    assert recorder.stop() == 0


def test_pause_resume_and_split_of_one_of_two_recorders(
    record: Callable[..., Any], peer: Any, tmp_path: Path
) -> None:
    """It starts paused; the quality of service of a topic is given to it."""
    suite = RecordedSuite(peer)
    qos = tmp_path / "qos.yaml"
    qos.write_text("/spare: {reliability: best_effort}\n/else: {depth: 3}\n")
    topics = [suite.name(topic) for topic in (STATE, CLOCK, Topic.SLOPE)]
    chosen = ("--topics", *topics, "/spare", "--qos-profile-overrides-path", qos)
    other = record("other", "--topics", *topics, "--ros-args", "-r", "__node:=other")
    recorder = record("bag", "--start-paused", *chosen)
    statuses = peer.statuses("/recorder")
    suite.publishers[Topic.SLOPE].publish(TOPICS[Topic.SLOPE].message_type())
    peer.wait_until(lambda: suite.publishers[STATE].get_subscription_count() == 2, what="state")
    suite.publish(0, (STATE,))  # the trip is running: the clock is subscribed to, too
    peer.wait_until(lambda: suite.publishers[CLOCK].get_subscription_count() == 2, what="clock")
    heard = 2

    def drive(*ticks: int) -> None:
        nonlocal heard
        for tick in ticks:
            suite.publish(tick, (STATE, CLOCK))
            heard += 2
            peer.wait_until(
                lambda count=str(heard): status_values(statuses[-1])["messages"] == count,
                what=f"tick {tick} at the recorder",
            )

    drive(1)
    assert peer.call(Service.RECORDER_RESUME.value).success
    drive(2, 3)
    assert peer.call(Service.RECORDER_SPLIT.value).message == "goes on in bag_1.mcap"
    assert not peer.call(Service.RECORDER_SPLIT.value).success  # nothing to split yet
    drive(4)
    assert peer.call(Service.RECORDER_PAUSE.value).success
    drive(5)
    assert statuses[-1].message == "paused: nothing is recorded"
    spare = peer.node.create_publisher(Temperature, "/spare", 10)  # reliable
    peer.wait_until(spare.get_subscription_count, what="subscription to the spare topic")
    (endpoint,) = peer.node.get_subscriptions_info_by_topic("/spare")
    assert endpoint.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert recorder.stop() == other.stop() == 0
    assert "quality of service of /else was not used" in recorder.stderr
    with BagReader(tmp_path / "bag") as reader:
        kept = [message.message.temperature for message in reader.messages([topics[0]])]
        assert kept == [22.0, 23.0, 24.0]
        assert [reader.topics[name].message_count for name in topics] == [3, 3, 1]
        pauses = yaml.safe_load(reader.run_information().extra["pauses"])
    assert [(pause["after_s"], pause["until_s"]) for pause in pauses] == [(None, 1.0), (4.0, None)]
    assert (tmp_path / "bag" / "bag_1.mcap").is_file()
    assert counts_of(tmp_path / "other")[topics[1]] == 5
