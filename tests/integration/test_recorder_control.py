"""Control of the recorder: it starts paused, resumes, pauses and splits its bag."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from rclpy.qos import ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Temperature
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from iptm_interfaces.codecs import time_from_ns
from iptm_interfaces.diagnostics import status_values
from iptm_interfaces.qos import LATCHED_QOS
from iptm_interfaces.services import Service
from iptm_recording.bag_reader import BagReader

S = 10**9
STATE, CLOCK, SLOPE = "/plant/cell_1_temperature", "/clock", "/v2x/slope"
SPARE = "/spare"


class Trip:
    """Publishes a state, the clock and one latched message, and waits until the recorder has them."""

    def __init__(self, peer: Any) -> None:
        self._peer = peer
        self._state = peer.node.create_publisher(Temperature, STATE, 10)
        self._clock = peer.node.create_publisher(Clock, CLOCK, 10)
        self._slope = peer.node.create_publisher(Float64MultiArray, SLOPE, LATCHED_QOS)
        self._statuses = peer.statuses("/recorder")
        self._sent = 0

    def begin(self) -> None:
        self._slope.publish(Float64MultiArray(data=[1.0]))
        self._peer.wait_until(self._state.get_subscription_count, 60.0, "subscription to the state")
        self._state.publish(Temperature())  # the trip is running: the clock is subscribed to, too
        self._peer.wait_until(self._clock.get_subscription_count, 60.0, "subscription to the clock")
        self._sent = 2

    def drive(self, ticks: range) -> None:
        for tick in ticks:
            message = Temperature(temperature=float(tick))
            message.header.stamp = time_from_ns(tick * S)
            self._state.publish(message)
            self._clock.publish(Clock(clock=time_from_ns(tick * S)))
            self._sent += 2
            self._peer.wait_until(
                lambda: self._statuses and self._values()["messages"] == str(self._sent),
                60.0,
                f"tick {tick} at the recorder",
            )

    def call(self, service: Service) -> Any:
        client = self._peer.node.create_client(Trigger, service.value)
        self._peer.wait_until(client.service_is_ready, 60.0, service.value)
        future = client.call_async(Trigger.Request())
        self._peer.wait_until(future.done, 60.0, f"answer of {service.value}")
        return future.result()

    def _values(self) -> dict[str, str]:
        return dict(status_values(self._statuses[-1]))


@pytest.fixture
def trip(peer: Any) -> Trip:
    return Trip(peer)


def test_two_recorders_of_one_namespace_are_controlled_apart(
    launcher: Any, peer: Any, tmp_path: Path
) -> None:
    for name in ("recorder", "second"):
        arguments = (tmp_path / name, "--ros-args", "-r", f"__node:={name}")
        launcher.start_module("iptm_recording.recorder_cli", *arguments)
    statuses = {name: peer.statuses(f"/{name}") for name in ("recorder", "second")}
    client = peer.node.create_client(Trigger, "/second/pause")
    peer.wait_until(client.service_is_ready, 60.0, "the service of the second recorder")
    future = client.call_async(Trigger.Request())
    peer.wait_until(future.done, 60.0, "its answer")
    assert future.result().success
    paused = "paused: nothing is recorded"
    peer.wait_until(
        lambda: statuses["second"] and statuses["second"][-1].message == paused, 60.0, "the pause"
    )
    peer.wait_until(lambda: statuses["recorder"], 60.0, "the first recorder")
    assert not any(status.message == paused for status in statuses["recorder"])


def test_pause_resume_and_split(launcher: Any, peer: Any, trip: Trip, tmp_path: Path) -> None:
    (tmp_path / "qos.yaml").write_text("/spare: {reliability: best_effort}\n/else: {depth: 3}\n")
    recorder = launcher.start_module(
        "iptm_recording.recorder_cli",
        *(tmp_path / "bag", "--start-paused", "--topics", STATE, CLOCK, SLOPE, SPARE),
        *("--qos-profile-overrides-path", tmp_path / "qos.yaml"),
    )
    trip.begin()
    trip.drive(range(1, 4))
    assert trip.call(Service.RECORDER_RESUME).success
    trip.drive(range(4, 7))
    assert trip.call(Service.RECORDER_SPLIT).message == "goes on in bag_1.mcap"
    assert not trip.call(Service.RECORDER_SPLIT).success  # nothing to split yet
    trip.drive(range(7, 9))
    assert trip.call(Service.RECORDER_PAUSE).success
    trip.drive(range(9, 11))
    spare = peer.node.create_publisher(Temperature, SPARE, 10)  # reliable
    peer.wait_until(spare.get_subscription_count, 60.0, "subscription to the spare topic")
    (endpoint,) = peer.node.get_subscriptions_info_by_topic(SPARE)
    assert endpoint.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert recorder.stop() == 0
    assert "quality of service of /else was not used" in recorder.stderr
    with BagReader(tmp_path / "bag") as reader:
        temperatures = [m.message.temperature for m in reader.messages([STATE])]
        assert temperatures == [4.0, 5.0, 6.0, 7.0, 8.0]
        assert reader.topics[CLOCK].message_count == 5
        assert reader.topics[SLOPE].message_count == 1
        pauses = yaml.safe_load(reader.run_information().extra["pauses"])
    assert [(pause["after_s"], pause["until_s"]) for pause in pauses] == [(None, 3.0), (8.0, None)]
    assert (tmp_path / "bag" / "bag_1.mcap").is_file()
