"""Faults that reach a node by message: it continues, receives the present tick, and reports the fault."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from tests.integration.controller_ticks import LINK, ROAD, SMALL, tick_messages
from tests.integration.node_bench import NodeBench, S, node_bench

from iptm_controller.controller import Controller
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.node import ControllerNode
from iptm_core.state import Command
from iptm_interfaces.codecs import encode_command, encode_slope
from iptm_interfaces.diagnostics import Level
from iptm_interfaces.stamp_matcher import StampMatcher
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import STATE_TOPICS, Topic
from iptm_plant_sim.node import PlantNode
from iptm_v2x_bridge.node import BridgeNode

pytestmark = pytest.mark.usefixtures("ros_environment")
FUTURE_S = (3, 1000, 2**31 - 100)
IMPOSSIBLE_S = (-1, -(2**31))


@pytest.fixture
def controller() -> Iterator[NodeBench]:
    with node_bench(ControllerNode, **SMALL) as bench:
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        for tick in range(500, 503):
            bench.hear(tick_messages(float(tick)))
            await_answer(bench, tick)
        assert bench.stamps(Topic.COMMAND) == [500, 501, 502]
        yield bench


def restamped(messages: dict[Topic, Any], seconds: int, nanoseconds: int = 0) -> dict[Topic, Any]:
    """Give every message another stamp, also one that no clock has."""
    for message in messages.values():
        message.header.stamp.sec = seconds
        message.header.stamp.nanosec = nanoseconds
    return messages


def matcher_of(controller: NodeBench) -> StampMatcher[Topic]:
    matcher: StampMatcher[Topic] = controller.node._matcher  # type: ignore[attr-defined]
    return matcher


def await_answer(controller: NodeBench, tick: int) -> None:
    """Wait for a command; after a slow decision the controller looks for newer ticks before it answers."""
    controller.spin_until(lambda: controller.stamps(Topic.COMMAND)[-1:] == [tick])


def assert_hears(controller: NodeBench, *ticks: int) -> None:
    """Check that ticks are answered."""
    for tick in ticks:
        controller.hear(tick_messages(float(tick)))
        await_answer(controller, tick)
    assert controller.situation == (Level.OK, "optimal plans")


@pytest.mark.parametrize("ahead_s", FUTURE_S)
@pytest.mark.parametrize(
    "topics", [LINK, LINK[:1], LINK[1:], STATE_TOPICS[:1], (*STATE_TOPICS, *LINK)]
)
def test_stray_stamps_from_the_future_do_not_deafen_the_controller(
    controller: NodeBench, topics: tuple[Topic, ...], ahead_s: int
) -> None:
    """What the bridge answers to stray clocks, single messages, and a whole tick, twenty of each."""
    present = tick_messages(503.0)
    controller.hear(present, *STATE_TOPICS)
    seconds = min(503 + ahead_s, 2**31 - 1)
    # All within a moment, also where the machine takes longer: after a second of silence they are believed.
    now_s = time.monotonic()
    with mock.patch.object(matcher_of(controller).gate, "_steady_time_s", return_value=now_s):
        for stray in range(20):
            controller.hear(restamped(tick_messages(1.0), seconds, stray), *topics)
    if ahead_s > 10:
        controller.hear(present, *LINK)
        await_answer(controller, 503)
    # Just ahead, a whole tick may be taken for the next one; a plant that repeats itself is heard again.
    controller.spin_until(lambda: hears_repeated(controller, 503))
    assert_hears(controller, 504, 505, 506, 507)


def hears_repeated(controller: NodeBench, tick: int) -> bool:
    if controller.stamps(Topic.COMMAND)[-1] != tick:
        controller.hear(tick_messages(float(tick)))
    return controller.stamps(Topic.COMMAND)[-1] == tick


@pytest.mark.parametrize("seconds", IMPOSSIBLE_S)
def test_a_tick_with_an_impossible_stamp_is_counted_and_forgotten(
    controller: NodeBench, seconds: int
) -> None:
    controller.hear(restamped(tick_messages(503.0), seconds, 5))
    controller.hear(restamped(tick_messages(503.0), 2**31 - 1, 2**32 - 1))
    assert_hears(controller, 503, 504)
    assert matcher_of(controller).counts.stray == 16


def test_the_last_state_sent_again_gets_the_same_answer(controller: NodeBench) -> None:
    controller.hear(tick_messages(502.0))
    assert controller.stamps(Topic.COMMAND) == [500, 501, 502, 502]
    first, again = controller.received[Topic.COMMAND][-2:]
    assert first == again
    assert_hears(controller, 503)


def test_a_defect_in_a_callback_is_told_and_survived(
    controller: NodeBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(controller.node._controller, "decide", lambda _: 1 / 0)  # type: ignore[attr-defined]
        controller.hear(tick_messages(503.0))
        controller.spin_until(lambda: controller.situation[0] is Level.ERROR)
    assert controller.situation[1] == "an internal error was caught, see the log"
    assert controller.values["caught_errors"] == "1"
    assert "ZeroDivisionError" in controller.values["last_caught_error"]
    controller.hear(tick_messages(504.0))
    await_answer(controller, 504)
    controller.spin_until(lambda: controller.situation == (Level.OK, "optimal plans"))


def test_messages_of_absurd_size_are_refused_unread(controller: NodeBench) -> None:
    present = tick_messages(503.0)
    huge = JointState(name=["a"] * 100_000, position=[1.0] * 100_000)
    controller.hear({Topic.PLANT_POWERS: huge})
    road = encode_slope(ROAD)
    road.data = [0.0] * 1_000_000
    controller.hear({Topic.SLOPE: road})
    controller.hear({Topic.PLANT_ODOMETRY: b"\x00\x01\x00\x00 no odometry"})
    controller.hear(present)
    await_answer(controller, 503)
    assert controller.situation == (Level.WARN, "messages were refused")
    assert controller.values["refused_messages"] == "3"


def test_a_dead_plant_and_a_deaf_controller_are_told() -> None:
    with node_bench(ControllerNode, horizon=SMALL["horizon"], input_timeout_s=0.3) as bench:
        assert bench.situation[0] is Level.WARN
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        bench.hear(tick_messages(0.0))
        assert bench.situation == (Level.OK, "optimal plans")
        bench.spin_until(lambda: bench.situation[0] is Level.STALE)
        assert "the plant has stopped" in bench.situation[1]
        assert_hears(bench, 1)

        def told_as_deaf() -> bool:
            """States arrive, but with stamps that lead nowhere."""
            strange_s = 10**8 + 7 * round(1e3 * time.monotonic())
            bench.hear(restamped(tick_messages(2.0), strange_s), Topic.PLANT_ODOMETRY)
            return bench.situation == (Level.ERROR, "states arrive, but none that can be answered")

        bench.spin_until(told_as_deaf)
        assert_hears(bench, 2, 3)


def test_inputs_are_waited_for_in_trip_time_too() -> None:
    """At ten times real time a bridge that is gone must not cost the plant its controller."""
    with node_bench(ControllerNode, horizon=SMALL["horizon"], input_timeout_s=6.0) as bench:
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        bench.hear(tick_messages(0.0))
        for tick in range(3, 30, 3):
            bench.hear(tick_messages(float(tick)), *STATE_TOPICS)
            pause_s = time.monotonic() + 0.03
            bench.spin_until(lambda pause_s=pause_s: time.monotonic() > pause_s)
        assert bench.stamps(Topic.COMMAND) == [0, 9, 18, 27]


def test_a_controller_that_is_too_slow_answers_the_newest_tick(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    decide = Controller.decide

    def slow(controller: Controller, measured: Measurements) -> Decision:
        time.sleep(0.3)
        return decide(controller, measured)

    with node_bench(ControllerNode, horizon=SMALL["horizon"]) as bench:
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        monkeypatch.setattr(Controller, "decide", slow)
        for tick in range(6):
            bench.hear(tick_messages(float(tick)))
        bench.spin_until(lambda: bench.stamps(Topic.COMMAND)[-1] == 5)
        assert bench.stamps(Topic.COMMAND) == [0, 5]
        bench.spin_until(lambda: bench.values["skipped_ticks"] == "4")
        assert bench.situation[0] is Level.WARN
        monkeypatch.undo()
        bench.hear(tick_messages(6.0))
        bench.spin_until(lambda: bench.stamps(Topic.COMMAND)[-1] == 6)


def clock(time_ns: int) -> dict[Topic, Any]:
    message = Clock()
    message.clock.sec, message.clock.nanosec = divmod(time_ns, S)
    return {Topic.CLOCK: message}


@pytest.mark.parametrize("stray_s", [-7.0, 0.0, 20.0, 1e3, 2.0**31 - 1.0])
def test_stray_clocks_are_not_answered_and_change_no_preview(stray_s: float) -> None:
    """A stray 0 may be a new trip, and is answered, but the trip before it goes on where it was."""

    def previews(*, strays: int) -> list[Any]:
        with node_bench(BridgeNode, latency_s=3.0, noise_std_m_s=0.5) as bridge:
            for tick in range(500, 506):
                bridge.hear(clock(tick * S))
            for stray in range(strays):
                bridge.hear(clock(round(stray_s * S) + (0 if stray_s == 0.0 else stray)))
            for tick in range(506, 512):
                bridge.hear(clock(tick * S))
            assert bridge.values["caught_errors"] == "0"
            sent_previews = bridge.received[Topic.LEADER_PREVIEW]
            return [message for message in sent_previews if message.header.stamp.sec >= 500]

    assert previews(strays=20) == previews(strays=0)


def test_the_bridge_answers_a_clock_again_and_follows_a_new_trip() -> None:
    with node_bench(BridgeNode) as bridge:
        assert bridge.situation[0] is Level.WARN
        for tick in (7, 8, 8, 0, 1):
            bridge.hear(clock(tick * S))
        assert bridge.stamps(Topic.LEADER) == [7, 8, 8, 0, 1]
        assert bridge.received[Topic.LEADER_PREVIEW][1] == bridge.received[Topic.LEADER_PREVIEW][2]


def test_the_bridge_outlives_stamps_that_no_message_can_carry() -> None:
    with node_bench(BridgeNode) as bridge:
        message = Clock()
        message.clock.sec, message.clock.nanosec = 2**31 - 1, 2**32 - 1
        bridge.hear({Topic.CLOCK: message})
        bridge.hear(clock((2**31 - 1) * S + S - 1))
        bridge.hear(clock(0))
        assert bridge.stamps(Topic.LEADER) == [2**31 - 1, 0]


@contextmanager
def running_plant(**parameters: object) -> Iterator[NodeBench]:
    """A plant that waits for the answer to its first state; without a range sensor."""
    with node_bench(PlantNode, safety_monitor=False, **parameters) as bench:
        peers = SuiteNode("peers")
        peers.advertise(Topic.COMMAND)
        for topic in (*STATE_TOPICS, Topic.CLOCK):
            peers.listen(topic, lambda _: None)
        bench.spin_until(lambda: bench.received[Topic.CLOCK])
        yield bench
        peers.destroy_node()


@pytest.fixture
def plant() -> Iterator[NodeBench]:
    with running_plant(command_timeout_wall_s=0.5, on_lost_controller="wait") as bench:
        yield bench


def answer(plant: NodeBench, tick: int, acceleration_m_s2: float = 0.3) -> None:
    plant.hear({Topic.COMMAND: encode_command(tick * S, Command(acceleration_m_s2, 0.0))})


def test_the_plant_says_that_commands_arrive_but_do_not_fit(plant: NodeBench) -> None:
    plant.spin_until(lambda: plant.situation == (Level.STALE, "no commands arrive: waiting"))
    answer(plant, 17)
    plant.spin_until(lambda: plant.situation[1] != "no commands arrive: waiting")
    level, reason = plant.situation
    assert level is Level.STALE
    assert "their stamps answer no state" in reason
    answer(plant, 0)
    assert plant.situation == (Level.OK, "running")


def test_a_second_controller_is_told_when_both_speak(plant: NodeBench) -> None:
    second = SuiteNode("second")
    second.advertise(Topic.COMMAND)
    plant.spin_until(lambda: plant.node.count_publishers(Topic.COMMAND.value) == 2)

    def is_reported() -> bool:
        tick = plant.stamps(Topic.PLANT_ODOMETRY)[-1]
        for _ in range(2):
            answer(plant, tick)
        return plant.situation == (Level.ERROR, "more than one controller on this graph")

    plant.spin_until(is_reported)
    second.destroy_node()
    plant.spin_until(lambda: plant.situation[0] is not Level.ERROR)


def test_the_plant_repeats_its_state_until_it_is_answered(plant: NodeBench) -> None:
    for tick in (0, 1):
        plant.spin_until(lambda tick=tick: plant.stamps(Topic.PLANT_ODOMETRY).count(tick) >= 3)
        repeated = [m for m in plant.received[Topic.PLANT_ODOMETRY] if m.header.stamp.sec == tick]
        assert repeated == repeated[:1] * len(repeated)
        assert len(plant.received[Topic.CLOCK]) == len(plant.received[Topic.PLANT_POWERS])
        answer(plant, tick)
    assert plant.stamps(Topic.PLANT_ODOMETRY)[-1] == 2


def test_a_controller_that_is_back_before_standstill_drives_on() -> None:
    with running_plant(command_timeout_wall_s=0.5) as plant:
        for tick in range(12):
            answer(plant, tick, 1.0)
        plant.spin_until(lambda: plant.situation[0] is Level.ERROR)
        answer(plant, plant.stamps(Topic.PLANT_ODOMETRY)[-1], 0.5)
        assert plant.situation == (Level.OK, "running")
        assert plant.values["controller_losses"] == "1"
        driven = plant.stamps(Topic.PLANT_ODOMETRY)[-1]
        answer(plant, driven, 0.5)
        assert plant.stamps(Topic.PLANT_ODOMETRY)[-1] == driven + 1


def test_a_frozen_plant_reads_what_waits_before_it_judges() -> None:
    """A stopped process receives nothing; that does not count as silence of the others."""
    with running_plant(command_timeout_wall_s=2.0) as plant:
        answer(plant, 0)
        time.sleep(5.0)
        for _ in range(20):
            plant._executor.spin_once(timeout_sec=0.0)
        answer(plant, 1)
        assert plant.situation == (Level.OK, "running")
        assert plant.stamps(Topic.PLANT_ODOMETRY)[-1] == 2


def test_a_model_that_fails_ends_the_trip_as_a_defect(
    plant: NodeBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    step = plant.node._trip.step  # type: ignore[attr-defined]
    monkeypatch.setattr(
        plant.node._trip,  # type: ignore[attr-defined]
        "step",
        step.__class__(**{**vars(step), "state": replaced(step.state, math.nan)}),
    )
    answer(plant, 0)
    assert plant.situation == (Level.ERROR, "the vehicle model failed")
    plant.spin_until(lambda: plant.node.finished)
    assert plant.node.exit_code == 1


def replaced(state: Any, cell_k: float) -> Any:
    return state.__class__(**{**vars(state), "cell_1_temperature_k": cell_k})
