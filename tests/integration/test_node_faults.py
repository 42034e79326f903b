"""Faults that reach the controller by message: it reports them and answers the present tick."""

from __future__ import annotations

import time
from typing import Any
from unittest import mock

import pytest
from sensor_msgs.msg import JointState
from tests.integration.controller_ticks import (
    LINK,
    ROAD,
    SMALL,
    WELL,
    assert_hears,
    await_answer,
    tick_messages,
)
from tests.integration.node_bench import NodeBench, node_bench

from iptm_controller.controller import MpcController
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.node import ControllerNode
from iptm_ros.codecs import encode_slope
from iptm_ros.diagnostics import Level
from iptm_ros.topics import Topic

pytestmark = pytest.mark.usefixtures("ros_environment")


def restamped(messages: dict[Topic, Any], seconds: int, nanoseconds: int = 0) -> dict[Topic, Any]:
    """Give every message another stamp, also one that no clock has."""
    for message in messages.values():
        message.header.stamp.sec = seconds
        message.header.stamp.nanosec = nanoseconds
    return messages


def test_the_last_state_sent_again_gets_the_same_answer(driving: NodeBench) -> None:
    driving.hear(tick_messages(502.0))
    assert driving.stamps(Topic.COMMAND) == [500, 501, 502, 502]
    first, again = driving.received[Topic.COMMAND][-2:]
    assert first == again
    assert_hears(driving, 503)


@pytest.mark.parametrize("ahead_s", [3, 2**31 - 100])
@pytest.mark.parametrize("topics", [LINK, (Topic.PLANT_STATE,), (Topic.PLANT_STATE, *LINK)])
def test_stray_stamps_from_the_future_do_not_deafen_the_controller(
    driving: NodeBench, topics: tuple[Topic, ...], ahead_s: int
) -> None:
    """What the bridge answers to stray clocks, single messages, and a whole tick, twenty of each."""
    present = tick_messages(503.0)
    driving.hear(present, Topic.PLANT_STATE)
    seconds = min(503 + ahead_s, 2**31 - 1)
    # All within a moment, also where the machine takes longer: after a second of silence they are believed.
    gate = driving.node._matcher.gate  # type: ignore[attr-defined]
    with mock.patch.object(gate, "_steady_time_s", return_value=time.monotonic()):
        for stray in range(20):
            driving.hear(restamped(tick_messages(1.0), seconds, stray), *topics)
    if ahead_s > 10:
        driving.hear(present, *LINK)
        await_answer(driving, 503)

    def hears_repeated() -> bool:
        if driving.stamps(Topic.COMMAND)[-1] != 503:
            driving.hear(tick_messages(503.0))
        return driving.stamps(Topic.COMMAND)[-1] == 503

    # Just ahead, a whole tick may be taken for the next one; a plant that repeats itself is heard again.
    driving.spin_until(hears_repeated)
    assert_hears(driving, 504, 505, 506, 507)


@pytest.mark.parametrize("seconds", [-1, -(2**31)])
def test_a_tick_with_an_impossible_stamp_is_counted_and_forgotten(
    driving: NodeBench, seconds: int
) -> None:
    driving.hear(restamped(tick_messages(503.0), seconds, 5))
    driving.hear(restamped(tick_messages(503.0), 2**31 - 1, 2**32 - 1))
    assert_hears(driving, 503, 504)
    driving.spin_until(lambda: driving.values["stray_stamps"] == "5")


def test_a_defect_in_a_callback_is_reported_and_survived(driving: NodeBench) -> None:
    with mock.patch.object(MpcController, "decide", side_effect=ZeroDivisionError):
        driving.hear(tick_messages(503.0))
        driving.spin_until(lambda: driving.situation[0] is Level.ERROR)
    assert driving.situation[1] == "an internal error was caught, see the log"
    assert driving.values["caught_errors"] == "1"
    assert "ZeroDivisionError" in driving.values["last_caught_error"]
    driving.hear(tick_messages(504.0))
    await_answer(driving, 504)
    driving.spin_until(lambda: driving.situation == WELL)


def test_messages_of_absurd_size_are_refused_unread(driving: NodeBench) -> None:
    huge = JointState(name=["a"] * 100_000, position=[1.0] * 100_000)
    road = encode_slope(ROAD)
    road.data = [0.0] * 1_000_000
    driving.hear({Topic.PLANT_STATE: huge, Topic.SLOPE: road})
    driving.hear({Topic.PLANT_STATE: b"\x00\x01\x00\x00 no state"})
    driving.hear(tick_messages(503.0))
    await_answer(driving, 503)
    assert driving.situation == (Level.WARN, "messages were refused")
    assert driving.values["refused_messages"] == "3"


def test_a_dead_plant_and_a_deaf_controller_are_reported() -> None:
    with node_bench(ControllerNode, **{**SMALL, "input_timeout_s": 0.3}) as bench:
        assert bench.situation[0] is Level.WARN
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        assert_hears(bench, 0)
        bench.spin_until(lambda: bench.situation[0] is Level.STALE)
        assert "the plant has stopped" in bench.situation[1]
        assert_hears(bench, 1)

        def is_reported_as_deaf() -> bool:
            """States arrive, but with stamps that lead nowhere."""
            strange_s = 10**8 + 7 * round(1e3 * time.monotonic())
            bench.hear(restamped(tick_messages(2.0), strange_s), Topic.PLANT_STATE)
            return bench.situation == (Level.ERROR, "states arrive, but none that can be answered")

        bench.spin_until(is_reported_as_deaf)
        assert_hears(bench, 2, 3)


def test_a_controller_that_is_too_slow_answers_the_newest_tick(controller: NodeBench) -> None:
    decide = MpcController.decide

    def slow(pure: MpcController, measured: Measurements) -> Decision:
        time.sleep(0.3)  # the decision takes as long
        return decide(pure, measured)

    with mock.patch.object(MpcController, "decide", slow):
        for tick in range(6):
            controller.hear(tick_messages(float(tick)))
        await_answer(controller, 5)
        assert controller.stamps(Topic.COMMAND) == [0, 5]
        controller.spin_until(lambda: controller.values["skipped_ticks"] == "4")
        assert controller.situation[0] is Level.WARN
    controller.hear(tick_messages(6.0))
    await_answer(controller, 6)
