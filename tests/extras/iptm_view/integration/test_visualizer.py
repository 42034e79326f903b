"""The visualizer as a real process beside a bag that is played."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import String

from iptm_core.settings import VEHICLE_LENGTH_M
from iptm_ros.codecs import ns_from_time
from iptm_ros.publishers import LATCHED_QOS
from iptm_ros.recording.trajectory_reader import read_trajectory
from iptm_ros.topics import Topic
from iptm_view.visual_topics import VISUAL_TOPICS

BAG = Path(__file__).resolve().parents[4] / "bags" / "example_us06_120s"


def test_a_replay_is_drawn_as_the_bag_says(launcher: Any, peer: Any) -> None:
    heard: dict[str, list[Any]] = {}

    def listen(name: str, kind: Any, qos: Any) -> list[Any]:
        peer.node.create_subscription(kind, name, heard.setdefault(name, []).append, qos)
        return heard[name]

    of = {
        topic: listen(spec.name, spec.message_type, spec.qos)
        for topic, spec in VISUAL_TOPICS.items()
    }
    described = listen("robot_description", String, LATCHED_QOS)
    visualizer = launcher.start_node(
        "iptm_view.visualizer_node", parameters={"frame_prefix": "ego"}
    )
    statuses = peer.statuses("/visualizer")
    peer.wait_until(lambda: described and statuses, what="the visualizer")
    assert "ego/battery_pack" in described[0].data
    assert statuses[-1].message == "waiting for a trip"
    player = launcher.start_module(
        "iptm_bags.player_cli", BAG, "--rate", "40", "--wait-for-subscribers", "2"
    )
    peer.wait_until(
        lambda: (
            of[Topic.VISUAL_SCENE]
            and ns_from_time(of[Topic.VISUAL_SCENE][-1].markers[0].header.stamp) >= 119 * 10**9
        ),
        what="the end of the trip",
    )
    assert player.wait() == 0
    driven = read_trajectory(BAG)
    by_time = dict(zip(driven.time_s.tolist(), range(len(driven)), strict=True))
    assert len(of[Topic.VISUAL_SCENE]) > 5
    for scene in of[Topic.VISUAL_SCENE]:
        markers = {marker.ns: marker for marker in scene.markers}
        k = by_time[ns_from_time(markers["ego"].header.stamp) / 1e9]
        assert markers["ego"].pose.position.x + 0.5 * VEHICLE_LENGTH_M == pytest.approx(
            driven.position_m[k]
        )
        assert markers["leader"].pose.position.x - 0.5 * VEHICLE_LENGTH_M == pytest.approx(
            driven.leader_position_m[k]
        )
    for plan in of[Topic.VISUAL_PLAN]:
        k = by_time[ns_from_time(plan.header.stamp) / 1e9]
        first = plan.poses[0]
        assert ns_from_time(first.header.stamp) == ns_from_time(plan.header.stamp)
        assert first.pose.position.x == pytest.approx(driven.position_m[k])
        assert first.pose.position.x <= plan.poses[-1].pose.position.x
    assert of[Topic.VISUAL_PLAN]
    assert of[Topic.VISUAL_LEADER_PREVIEW]
    assert len(of[Topic.VISUAL_ROAD]) == 1
    assert {status.level for status in statuses} <= {b"\x00", b"\x01"}
    # Markers expire, so the last scene is published again for as long as the visualizer is there.
    scenes = len(of[Topic.VISUAL_SCENE])
    peer.wait_until(lambda: len(of[Topic.VISUAL_SCENE]) > scenes + 1, what="the last scene again")
    assert visualizer.stop(signal.SIGINT) == 0


def test_mistakes_are_one_line(refused: Callable[..., str]) -> None:
    assert "none.gpx" in refused("iptm_view.visualizer_node", parameters={"road": "none.gpx"})
