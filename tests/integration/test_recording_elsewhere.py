"""Recording a vehicle in a namespace with a clock of its own."""

from __future__ import annotations

import re
import signal
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Temperature
from std_msgs.msg import Float64MultiArray

from iptm_interfaces.codecs import time_from_ns
from iptm_interfaces.qos import LATCHED_QOS
from iptm_recording.bag_reader import BagReader, read_model_parameters
from iptm_recording.recover import recover

S = 10**9
PLACE = ("-r", "__ns:=/car_9")
PLACES = {
    "namespace": ("--ros-args", *PLACE),
    "names as of the launch file": (
        "--ros-args",
        *PLACE,
        "-r",
        "clock:=clock",
        "-r",
        "/clock:=clock",
    ),
    "a clock elsewhere": ("--ros-args", *PLACE, "-r", "clock:=/clock_of_9"),
    "everything from outside": ("--all",),
    "without a namespace": (
        "--ros-args",
        "-r",
        "/plant/cell_1_temperature:=/car_9/plant/cell_1_temperature",
        "-r",
        "/v2x/slope:=/car_9/v2x/slope",
        "-r",
        "/clock:=/car_9/clock",
    ),
}
STATE, CLOCK, SLOPE = "/car_9/plant/cell_1_temperature", "/car_9/clock", "/car_9/v2x/slope"


@pytest.fixture
def recorder(
    launcher: Any, wait_until: Callable[..., None], tmp_path: Path, request: pytest.FixtureRequest
) -> Any:
    place = PLACES[getattr(request, "param", "namespace")]
    process = launcher.start_module("iptm_recording.recorder_cli", tmp_path / "bag", *place)
    wait_until(lambda: "recorder ready" in process.stdout, what="recorder ready")
    return process


@pytest.mark.parametrize("recorder", PLACES, indirect=True)
def test_a_kill_loses_at_most_one_tick_wherever_the_clock_is(
    peer: Any, recorder: Any, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    state = peer.node.create_publisher(Temperature, STATE, 10)
    is_elsewhere = "elsewhere" in request.node.name
    clock = peer.node.create_publisher(Clock, "/clock_of_9" if is_elsewhere else CLOCK, 10)
    slope = peer.node.create_publisher(Float64MultiArray, SLOPE, LATCHED_QOS)
    slope.publish(Float64MultiArray(data=[1.0]))
    peer.wait_until(state.get_subscription_count, 60.0, "subscription to the state")
    state.publish(Temperature())  # the trip is running: the clock is subscribed to, too
    if "outside" in request.node.name:
        peer.wait_until(lambda: f"the bag follows {CLOCK}" in recorder.stderr, what="the choice")
    peer.wait_until(clock.get_subscription_count, 60.0, "subscription to the clock")
    file, ticks = tmp_path / "bag" / "bag_0.mcap", 60
    for tick in range(1, ticks):
        message = Temperature(temperature=tick + 0.125)
        message.header.stamp = time_from_ns(tick * S)
        state.publish(message)
        clock.publish(Clock(clock=time_from_ns(tick * S)))
        if tick % 5 == 0:  # a tick is written when the next one begins
            mark = struct.pack("<d", tick - 1 + 0.125)
            peer.wait_until(lambda mark=mark: mark in file.read_bytes(), what=f"tick {tick - 1}")
    recorder.send(signal.SIGKILL)
    recorder.wait()
    with BagReader(recover(tmp_path / "bag").output) as reader:
        counts = {name: topic.message_count for name, topic in reader.topics.items()}
        # The last four were published flat out until the moment of the kill.
        assert counts[STATE] >= ticks - 5
        assert reader.topics[SLOPE].is_latched
        assert (ticks - 6) * S <= reader.end_ns < ticks * S  # in the time of the trip


def test_a_kill_without_a_clock_loses_nothing(launcher: Any, peer: Any, tmp_path: Path) -> None:
    """Two vehicles: none of their clocks is that of the recorder, which warns and writes at once."""
    cars = ("/car_8", "/car_9")
    states = [peer.node.create_publisher(Temperature, f"{car}/state", 10) for car in cars]
    clocks = [peer.node.create_publisher(Clock, f"{car}/clock", 10) for car in cars]
    recorder = launcher.start_module("iptm_recording.recorder_cli", tmp_path / "bag", "--all")
    peer.wait_until(
        lambda: all(each.get_subscription_count() for each in (*states, *clocks)),
        60.0,
        "subscriptions",
    )
    file, ticks = tmp_path / "bag" / "bag_0.mcap", 40
    for tick in range(ticks):
        size = file.stat().st_size
        for publisher in (*states, *clocks):
            stamp = time_from_ns(tick * S)
            is_clock = publisher in clocks
            message = Clock(clock=stamp) if is_clock else Temperature(temperature=float(tick))
            publisher.publish(message)
        peer.wait_until(lambda size=size: file.stat().st_size > size, what="growth of the bag")
    warning = "2 clocks on the graph (/car_8/clock, /car_9/clock)"
    peer.wait_until(lambda: warning in recorder.stderr, what="the warning")
    recorder.send(signal.SIGKILL)
    recorder.wait()
    with BagReader(recover(tmp_path / "bag").output) as reader:
        for car in cars:
            assert reader.topics[f"{car}/state"].message_count >= ticks - 1


def test_a_run_started_by_hand_tells_its_parameters(
    launcher: Any, recorder: Any, tmp_path: Path
) -> None:
    trip = {"cycle": "nycc", "duration_s": 10.0, "parameter_overrides": "body.mass_kg=1777"}
    plant = launcher.start_node(
        "iptm_plant_sim.node", *PLACE, parameters={**trip, "expected_peers": 2}
    )
    launcher.start_node(
        "iptm_v2x_bridge.node", *PLACE, parameters={"cycle": "nycc", "expected_peers": 2}
    )
    launcher.start_node(
        "iptm_controller.node",
        *PLACE,
        parameters={"horizon": "3x1", "solver": "ipopt", "compile_code": False},
    )
    assert plant.wait(120.0) == 0, plant.stderr
    assert recorder.stop() == 0
    with BagReader(tmp_path / "bag") as reader:
        assert reader.duration_s == pytest.approx(10.0)
        assert reader.topics[CLOCK].message_count == 11
        assert "horizon: 3x1" in reader.run_information().parameters
    parameters, is_stored = read_model_parameters(tmp_path / "bag")
    assert is_stored
    assert parameters.body.mass_kg == 1777.0


def test_what_a_frozen_recorder_missed_is_counted(peer: Any, recorder: Any, tmp_path: Path) -> None:
    """The nodes do not wait for a recorder; a publisher keeps ten messages for it."""
    state = peer.node.create_publisher(Temperature, STATE, 10)
    clock = peer.node.create_publisher(Clock, CLOCK, 10)
    peer.wait_until(state.get_subscription_count, 60.0, "subscription to the state")
    state.publish(Temperature())
    peer.wait_until(clock.get_subscription_count, 60.0, "subscription to the clock")
    clock.publish(Clock())
    file = tmp_path / "bag" / "bag_0.mcap"
    recorder.send(signal.SIGSTOP)
    sent = 6000  # more than the sockets in between hold
    for _ in range(sent):
        state.publish(Temperature())
    recorder.send(signal.SIGCONT)

    for _ in range(5):  # the following messages reveal the missing ones
        size = file.stat().st_size
        state.publish(Temperature())
        peer.wait_until(lambda size=size: file.stat().st_size > size, what="growth of the bag")
    assert recorder.stop() == 0
    reported = sum(int(number) for number in re.findall(r"(\d+) of /", recorder.stderr))
    with BagReader(tmp_path / "bag") as reader:
        assert reader.topics[STATE].message_count + reported == sent + 6
        assert reported > 0
        assert "lost_messages" in reader.run_information().extra
