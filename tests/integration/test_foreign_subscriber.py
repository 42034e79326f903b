"""Any ROS 2 program can listen: a plain one, which knows nothing of this project, hears every topic."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Names and standard types as promised to the outside, written down once more on purpose.
TOPICS = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/plant/odometry": "nav_msgs/msg/Odometry",
    "/plant/acceleration": "geometry_msgs/msg/AccelStamped",
    "/plant/battery": "sensor_msgs/msg/BatteryState",
    "/plant/cell_1_temperature": "sensor_msgs/msg/Temperature",
    "/plant/cell_n_temperature": "sensor_msgs/msg/Temperature",
    "/plant/coolant_inlet_temperature": "sensor_msgs/msg/Temperature",
    "/plant/coolant_outlet_temperature": "sensor_msgs/msg/Temperature",
    "/plant/powers": "sensor_msgs/msg/JointState",
    "/plant/capacity_loss": "sensor_msgs/msg/JointState",
    "/v2x/leader": "nav_msgs/msg/Odometry",
    "/v2x/leader_preview": "trajectory_msgs/msg/JointTrajectory",
    "/v2x/slope": "std_msgs/msg/Float64MultiArray",
    "/controller/command": "sensor_msgs/msg/JointState",
    "/controller/acceleration_command": "std_msgs/msg/Float64",
    "/controller/compressor_power_command": "std_msgs/msg/Float64",
    "/controller/plan": "trajectory_msgs/msg/JointTrajectory",
    "/controller/solve": "sensor_msgs/msg/JointState",
}
LATCHED = "/v2x/slope"
ROOT = Path(__file__).resolve().parents[2]
TIMEOUT_S = 120.0
WELL_UNDER_WAY_BYTES = 500_000

# Runs with `-I`-like isolation from the project: it refuses to have any of its modules loaded.
PROGRAM = """
import importlib, json, sys, time
import rclpy
from tests.foreign_readers import content_of
from rclpy.qos import DurabilityPolicy, QoSProfile

topics, latched = json.loads(sys.argv[1]), sys.argv[2]
rclpy.init()
node = rclpy.create_node("stranger")
counts = dict.fromkeys(topics, 0)
for name, type_name in topics.items():
    package, _, cls = type_name.split("/")
    kind = getattr(importlib.import_module(package + ".msg"), cls)
    qos = QoSProfile(depth=10)
    if name == latched:
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    def heard(data, name=name, type_name=type_name):
        content_of(type_name, data)
        counts[name] += 1
    node.create_subscription(kind, name, heard, qos, raw=True)
deadline = time.monotonic() + 100.0
while not all(counts.values()) and time.monotonic() < deadline:
    rclpy.spin_once(node, timeout_sec=0.1)
seen = {name: types for name, types in node.get_topic_names_and_types() if name in topics}
assert not [name for name in sys.modules if name.startswith("iptm")]
print(json.dumps({"counts": counts, "seen": seen}), flush=True)
"""


def test_a_stranger_hears_every_topic(
    launcher: Any, wait_until: Callable[..., None], tmp_path: Path
) -> None:
    """It joins late; constant data are still received."""
    output = tmp_path / "run"
    arguments = ("comprehensive", "--output", output)
    runner = launcher.start_module("iptm_bringup.run_closed_loop", *arguments)
    wait_until(
        lambda: (
            sum(path.stat().st_size for path in output.glob("*.mcap")) > WELL_UNDER_WAY_BYTES
            or not runner.is_running
        ),
        TIMEOUT_S,
        "the trip to begin",
    )
    stranger = launcher.start(
        "stranger",
        sys.executable,
        "-c",
        PROGRAM,
        json.dumps(TOPICS),
        LATCHED,
        PYTHONPATH=os.pathsep.join((os.environ.get("PYTHONPATH", ""), str(ROOT))),
    )
    assert stranger.wait(TIMEOUT_S) == 0, stranger.stderr
    report = json.loads(stranger.stdout)
    silent = [name for name, count in report["counts"].items() if not count]
    assert silent == []
    assert report["seen"] == {name: [type_name] for name, type_name in TOPICS.items()}

    assert runner.stop(signal.SIGINT) == 130
    assert "stopped by SIGINT" in runner.stderr
