"""Two suites in one graph, each moved by a namespace and nothing else, do not disturb one another."""

from __future__ import annotations

from typing import Any

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from iptm_core.state import NS_PER_S
from iptm_interfaces.codecs import ns_from_time
from iptm_interfaces.qos import RAW_QOS
from iptm_interfaces.topics import TOPICS, Topic

PREFIXES = {"car_1": "", "car_2": "taxi"}
DURATIONS_S = {"car_1": 12, "car_2": 20}
NODES = {
    "iptm_v2x_bridge.node": {"cycle": "nycc"},
    "iptm_controller.node": {"horizon": "3x1", "solver": "ipopt", "compile_code": False},
}


def test_a_namespace_moves_a_suite_with_its_clock(launcher: Any, peer: Any) -> None:
    clocks: dict[str, list[int]] = {car: [] for car in DURATIONS_S}
    commands: dict[str, list[int]] = {car: [] for car in DURATIONS_S}
    frames: dict[str, set[str]] = {car: set() for car in DURATIONS_S}
    plants = []
    for car, duration_s in DURATIONS_S.items():
        peer.node.create_subscription(
            Clock,
            f"/{car}/clock",
            lambda message, car=car: clocks[car].append(ns_from_time(message.clock)),
            RAW_QOS,
        )
        peer.node.create_subscription(
            JointState,
            f"/{car}/controller/command",
            lambda message, car=car: commands[car].append(ns_from_time(message.header.stamp)),
            RAW_QOS,
        )
        for topic in (Topic.PLANT_ODOMETRY, Topic.LEADER, Topic.LEADER_PREVIEW, Topic.PLAN):
            peer.node.create_subscription(
                TOPICS[topic].message_type,
                f"/{car}/{topic.value}",
                lambda message, car=car: frames[car].update(
                    (message.header.frame_id, getattr(message, "child_frame_id", ""))
                ),
                RAW_QOS,
            )
        place = ("-r", f"__ns:=/{car}")
        prefix = {"frame_prefix": PREFIXES[car]}
        trip = {"cycle": "nycc", "duration_s": float(duration_s), "expected_peers": 1, **prefix}
        plants.append(launcher.start_node("iptm_plant_sim.node", *place, parameters=trip))
        for module, parameters in NODES.items():
            launcher.start_node(module, *place, parameters=parameters | prefix)
    peer.wait_until(
        lambda: not any(plant.is_running for plant in plants), 120.0, "the end of both trips"
    )
    assert [plant.popen.returncode for plant in plants] == [0, 0], plants[0].stderr
    # Each answers its own ticks and no other; a state may be repeated for late subscribers.
    for car, duration_s in DURATIONS_S.items():
        ticks = {tick * NS_PER_S for tick in range(duration_s + 1)}
        assert set(clocks[car]) == ticks
        vehicle = PREFIXES[car] or car
        assert frames[car] == {f"{vehicle}/{name}" for name in ("odom", "base_link", "leader")} | {
            ""
        }
        assert ticks - {max(ticks)} <= set(commands[car]) <= ticks
    assert not peer.node.get_publishers_info_by_topic("/clock")
