"""The live meter: odometry of any node in, the battery of the car out."""

from __future__ import annotations

import signal
import time
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import BatteryState

from iptm_ros.codecs import time_from_ns
from iptm_ros.discovery import reserve_domain
from iptm_ros.process import joined_node

SPEED_M_S = 20.0
PATIENCE_S = 120.0


def test_a_simulated_minute_of_odometry_becomes_a_battery(launcher: Any) -> None:
    """Stamps of a simulation that runs faster than the wall; the publisher is best effort or reliable."""
    with reserve_domain() as domain:
        meter = launcher.start_module(
            "iptm",
            "meter",
            "--topic",
            "/odom",
            "--parameter-set",
            "bmw_i3",
            ROS_DOMAIN_ID=f"{domain}",
        )
        received: list[BatteryState] = []
        with joined_node(lambda context: Node("simulator", context=context), domain) as (
            node,
            executor,
        ):
            publisher = node.create_publisher(Odometry, "/odom", 10)
            node.create_subscription(BatteryState, "battery", received.append, 10)
            until_s, step = time.monotonic() + PATIENCE_S, 0
            while len(received) < 20 and time.monotonic() < until_s:
                if publisher.get_subscription_count():
                    message = Odometry()
                    message.header.stamp = time_from_ns(step * 20_000_000)
                    message.twist.twist.linear.x = SPEED_M_S
                    publisher.publish(message)
                    step += 1
                executor.spin_once(timeout_sec=0.002)
        assert meter.stop(signal.SIGINT) == 0
    assert len(received) >= 20
    assert received[0].current < 0.0
    assert received[-1].charge < received[0].charge
    assert "kWh" in meter.stdout
