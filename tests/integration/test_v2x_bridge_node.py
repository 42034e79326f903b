"""The bridge as a process of its own: what it publishes, how it starts, fails and stops."""

from __future__ import annotations

import signal
from functools import partial
from typing import Any

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock

from iptm_core.routes import build_route
from iptm_core.state import LeaderPreview, LeaderState
from iptm_interfaces.codecs import (
    decode_leader,
    decode_leader_preview,
    decode_leader_preview_bytes,
    decode_slope,
    ns_from_time,
    time_from_s,
)
from iptm_interfaces.diagnostics import status_values
from iptm_interfaces.topics import TOPICS, Topic

MODULE = "iptm_v2x_bridge.node"


class BridgeListener:
    """All messages of the bridge, and a publisher of the clock."""

    def __init__(self, peer: Any) -> None:
        self.peer = peer
        self.leaders: dict[int, LeaderState] = {}
        self.previews: dict[int, LeaderPreview] = {}
        self.slopes: list[Any] = []
        self.statuses = peer.statuses("/v2x_bridge")
        node = peer.node
        self.clock = node.advertise(Topic.CLOCK)
        node.listen(Topic.LEADER, self._on_leader)
        node.listen(Topic.LEADER_PREVIEW, self._on_preview, raw=True)
        node.listen(Topic.SLOPE, self.slopes.append)

    def _on_leader(self, message: Any) -> None:
        self.leaders[ns_from_time(message.header.stamp)] = decode_leader(message)

    def _on_preview(self, data: bytes) -> None:
        stamp_ns, preview = decode_leader_preview_bytes(data)
        self.previews[stamp_ns] = preview

    def wait_for_bridge(self) -> None:
        self.peer.wait_until(
            lambda: self.clock.get_subscription_count() == 1 and self.slopes,
            what="the bridge in the graph and its slope",
        )

    def reasons(self) -> set[str]:
        return {status.message for status in self.statuses}

    def tick(self, time_s: float) -> tuple[LeaderState, LeaderPreview]:
        stamp_ns = round(time_s * 1e9)
        self.clock.publish(Clock(clock=time_from_s(time_s)))
        self.peer.wait_until(
            lambda: stamp_ns in self.leaders and stamp_ns in self.previews,
            what=f"answer to the tick at {time_s} s",
        )
        return self.leaders[stamp_ns], self.previews[stamp_ns]


@pytest.fixture
def listener(peer: Any) -> BridgeListener:
    return BridgeListener(peer)


def start_bridge(launcher: Any, *arguments: str, **parameters: object) -> Any:
    """Start the bridge; it holds its first answer until the test listens to both streams."""
    return launcher.start_node(MODULE, *arguments, parameters={"expected_peers": 1, **parameters})


def test_answers_every_tick_with_leader_and_exact_preview(
    launcher: Any, listener: BridgeListener
) -> None:
    bridge = start_bridge(launcher, cycle="nycc", slope="large", preview_length_s=20.0)
    listener.wait_for_bridge()
    route = build_route("nycc", "large", initial_gap_m=15.0)
    for tick in range(60):
        leader, preview = listener.tick(float(tick))
        assert leader == route.leader.state_at(float(tick))
        assert preview.generated_at_s == float(tick)
        assert preview.positions_m[0] == leader.position_m
        assert preview.speeds_m_s[0] == leader.speed_m_s
        np.testing.assert_array_equal(preview.times_s, tick + np.arange(21.0))
        np.testing.assert_array_equal(
            preview.positions_m, route.leader.positions_at(preview.times_s)
        )
    # Who comes late gets the slope, too.
    late: list[Any] = []
    listener.peer.node.listen(Topic.SLOPE, late.append)
    listener.peer.wait_until(lambda: late, what="latched slope")
    slope = decode_slope(late[0])
    np.testing.assert_array_equal(slope.positions_m, route.slope.positions_m)
    np.testing.assert_array_equal(slope.slopes_rad, route.slope.slopes_rad)
    assert bridge.stop(signal.SIGINT) == 0


def test_preview_is_an_ordinary_message_for_other_tools(launcher: Any, peer: Any) -> None:
    messages: list[Any] = []
    clock = peer.node.advertise(Topic.CLOCK)
    peer.node.listen(Topic.LEADER, lambda _: None)
    peer.node.listen(Topic.LEADER_PREVIEW, messages.append)
    start_bridge(launcher, preview_length_s=5.0)
    peer.wait_until(lambda: clock.get_subscription_count() == 1, what="the bridge in the graph")
    clock.publish(Clock(clock=time_from_s(3.0)))
    peer.wait_until(lambda: messages, what="a preview")
    stamp_ns, preview = decode_leader_preview(messages[0])
    assert stamp_ns == 3_000_000_000
    assert preview.times_s.tolist() == [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]


def test_latency_shows_as_age_and_never_as_a_new_stamp(
    launcher: Any, listener: BridgeListener
) -> None:
    start_bridge(launcher, latency_s=2, preview_length_s=10, noise_std_m_s=0.5, seed=3)
    listener.wait_for_bridge()
    ages = []
    for tick in range(6):
        _, preview = listener.tick(float(tick))
        ages.append(tick - preview.generated_at_s if preview.times_s.size else None)
    assert ages == [None, None, 2.0, 2.0, 2.0, 2.0]
    # The same tick again gets the same answer, noise included.
    first = listener.previews.pop(5_000_000_000)
    _, again = listener.tick(5.0)
    np.testing.assert_array_equal(first.speeds_m_s, again.speeds_m_s)


def test_mode_none_still_answers_every_tick(launcher: Any, listener: BridgeListener) -> None:
    start_bridge(launcher, preview_mode="none")
    listener.wait_for_bridge()
    for tick in range(3):
        leader, preview = listener.tick(float(tick))
        assert leader.time_s == float(tick)
        assert preview.times_s.size == 0


def test_a_namespace_moves_everything(launcher: Any, peer: Any) -> None:
    start_bridge(launcher, "-r", "__ns:=/car_1")
    node = peer.node
    heard: dict[Topic, Any] = {}
    for topic in (Topic.LEADER, Topic.LEADER_PREVIEW, Topic.SLOPE):
        spec = TOPICS[topic]
        node.create_subscription(
            spec.message_type,
            f"/car_1/{spec.name}",
            partial(heard.__setitem__, topic),
            spec.qos,
        )
    clock = node.create_publisher(Clock, "/car_1/clock", 10)
    peer.wait_until(lambda: clock.get_subscription_count() == 1, what="a listener on the clock")
    clock.publish(Clock(clock=time_from_s(1.0)))
    peer.wait_until(lambda: len(heard) == 3, what="all three topics in the namespace")
    assert ns_from_time(heard[Topic.LEADER].header.stamp) == 1_000_000_000


def test_first_answer_waits_for_all_expected_peers(launcher: Any, listener: BridgeListener) -> None:
    start_bridge(launcher, expected_peers=2)
    listener.wait_for_bridge()
    listener.clock.publish(Clock(clock=time_from_s(0.0)))

    listener.peer.wait_until(
        lambda: "waiting for the expected peers" in listener.reasons(), what="the wait reported"
    )
    assert not listener.previews
    for topic in (Topic.LEADER, Topic.LEADER_PREVIEW):
        listener.peer.node.listen(topic, lambda _: None)
    listener.peer.wait_until(lambda: 0 in listener.previews, what="the answer held back")


def test_diagnostics_count_dropouts_and_show_the_age(
    launcher: Any, listener: BridgeListener
) -> None:
    bridge = start_bridge(launcher, dropout_probability=1.0)
    listener.wait_for_bridge()
    listener.tick(0.0)
    listener.tick(1.0)

    def values() -> dict[str, str]:
        return status_values(listener.statuses[-1]) if listener.statuses else {}

    listener.peer.wait_until(lambda: values().get("dropouts") == "2", what="two dropouts reported")
    assert values()["preview_age_s"] == "inf"
    assert "no prediction received yet" in listener.reasons()
    assert bridge.stop(signal.SIGTERM) == 0
