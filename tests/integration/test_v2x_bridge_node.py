"""The bridge node: what it publishes, how it starts, and clocks that are not those of the trip."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from tests.integration.node_bench import NodeBench, S, node_bench

from iptm_core.routes import build_route
from iptm_core.state import LeaderPreview
from iptm_ros.codecs import (
    decode_leader,
    decode_leader_preview,
    decode_slope,
    stamp_of,
    time_from_s,
)
from iptm_ros.diagnostics import Level
from iptm_ros.topics import TOPICS, Topic
from iptm_v2x_bridge.node import BridgeNode

pytestmark = pytest.mark.usefixtures("ros_environment")
bridge_bench = partial(node_bench, BridgeNode)


def clock(time_ns: int) -> dict[Topic, Any]:
    message = Clock()
    message.clock.sec, message.clock.nanosec = divmod(time_ns, S)
    return {Topic.CLOCK: message}


def preview_of(bridge: NodeBench) -> LeaderPreview:
    """The newest preview."""
    return decode_leader_preview(bridge.received[Topic.LEADER_PREVIEW][-1])[1]


def test_answers_every_tick_with_leader_and_exact_preview() -> None:
    route = build_route("nycc", "large", initial_gap_m=15.0)
    with bridge_bench(cycle="nycc", slope="large", preview_length_s=20.0) as bridge:
        (slope,) = map(decode_slope, bridge.received[Topic.SLOPE])
        np.testing.assert_array_equal(slope.positions_m, route.slope.positions_m)
        np.testing.assert_array_equal(slope.slopes_rad, route.slope.slopes_rad)
        assert bridge.situation == (Level.WARN, "waiting for the clock")
        for tick in range(60):
            bridge.hear(clock(tick * S))
            leader, preview = decode_leader(bridge.received[Topic.LEADER][-1]), preview_of(bridge)
            assert leader == route.leader.state_at(float(tick))
            assert preview.generated_at_s == float(tick)
            assert preview.positions_m[0] == leader.position_m
            assert preview.speeds_m_s[0] == leader.speed_m_s
            np.testing.assert_array_equal(preview.times_s, tick + np.arange(21.0))
            np.testing.assert_array_equal(
                preview.positions_m, route.leader.positions_at(preview.times_s)
            )


def test_latency_shows_as_age_and_never_as_a_new_stamp() -> None:
    link = {"latency_s": 2.0, "preview_length_s": 10.0, "noise_std_m_s": 0.5, "seed": 3}
    with bridge_bench(**link) as bridge:
        ages = []
        for tick in range(6):
            bridge.hear(clock(tick * S))
            preview = preview_of(bridge)
            ages.append(tick - preview.generated_at_s if preview.times_s.size else None)
        assert ages == [None, None, 2.0, 2.0, 2.0, 2.0]


def test_a_leader_without_previews_is_answered_by_choice() -> None:
    with bridge_bench(preview_mode="none") as bridge:
        for tick in range(3):
            bridge.hear(clock(tick * S))
            assert preview_of(bridge).times_s.size == 0
        assert bridge.stamps(Topic.LEADER) == [0, 1, 2]
        assert bridge.situation == (Level.OK, "leader only, no preview by choice")


def test_diagnostics_count_dropouts_and_show_the_age() -> None:
    with bridge_bench(dropout_probability=1.0) as bridge:
        for tick in range(2):
            bridge.hear(clock(tick * S))
        bridge.spin_until(lambda: bridge.values["dropouts"] == "2")
        assert bridge.values["preview_age_s"] == "inf"
        assert bridge.situation == (Level.WARN, "no prediction received yet")


def test_a_clock_is_answered_again_alike_and_a_new_trip_is_followed() -> None:
    with bridge_bench(noise_std_m_s=0.5) as bridge:
        for tick in (7, 8, 8, 0, 1):
            bridge.hear(clock(tick * S))
        assert bridge.stamps(Topic.LEADER) == [7, 8, 8, 0, 1]
        assert bridge.received[Topic.LEADER_PREVIEW][1] == bridge.received[Topic.LEADER_PREVIEW][2]


@pytest.mark.parametrize("stray_s", [-7.0, 0.0, 20.0, 1e3, 2.0**31 - 1.0])
def test_stray_clocks_are_not_answered_and_change_no_preview(stray_s: float) -> None:
    """A stray 0 may be a new trip, and is answered, but the trip before it goes on where it was."""

    def previews(*, strays: int) -> list[Any]:
        with bridge_bench(latency_s=3.0, noise_std_m_s=0.5) as bridge:
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


def test_stamps_that_no_message_can_carry_are_survived() -> None:
    with bridge_bench() as bridge:
        message = Clock()
        message.clock.sec, message.clock.nanosec = 2**31 - 1, 2**32 - 1
        bridge.hear({Topic.CLOCK: message})
        bridge.hear(clock((2**31 - 1) * S + S - 1))
        bridge.hear(clock(0))
        assert bridge.stamps(Topic.LEADER) == [2**31 - 1, 0]


def test_a_namespace_moves_everything_and_the_slope_reaches_who_comes_late(
    launcher: Any, peer: Any
) -> None:
    launcher.start_node("iptm_v2x_bridge.node", "-r", "__ns:=/car_1")
    heard: dict[Topic, Any] = {}
    clock = peer.node.create_publisher(Clock, "/car_1/clock", 10)
    peer.wait_until(lambda: clock.get_subscription_count() == 1, what="a listener on the clock")
    for topic in (Topic.LEADER, Topic.LEADER_PREVIEW, Topic.SLOPE):
        spec = TOPICS[topic]
        take = partial(heard.__setitem__, topic)
        peer.node.create_subscription(spec.message_type, f"/car_1/{spec.name}", take, spec.qos)
    peer.wait_until(lambda: Topic.SLOPE in heard, what="the latched slope")

    def is_answered() -> bool:
        clock.publish(Clock(clock=time_from_s(1.0)))
        return len(heard) == 3

    peer.wait_until(is_answered, what="all three topics in the namespace")
    assert stamp_of(heard[Topic.LEADER]) == S
