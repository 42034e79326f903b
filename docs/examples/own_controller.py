"""A minimal controller: follow the leader with a constant time gap, cool with a thermostat.

It takes the place of `scripts/controller`. Plain rclpy and standard messages: nothing of the suite is
imported.
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import Any

import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState, Temperature

TIME_GAP_S = 2.0
STANDSTILL_GAP_M = 6.0
COOL_ABOVE_DEGC = 34.0
COMPRESSOR_POWER_W = 1500.0


class OwnController(Node):
    """Answers the state of every tick with acceleration and compressor power."""

    def __init__(self) -> None:
        super().__init__("own_controller")
        self._inputs: dict[str, Any] = {}
        for topic, kind in {
            "plant/odometry": Odometry,
            "plant/cell_n_temperature": Temperature,
            "v2x/leader": Odometry,
        }.items():
            self.create_subscription(kind, topic, partial(self._take, topic), 10)
        self._commands = self.create_publisher(JointState, "controller/command", 10)

    def _take(self, topic: str, message: Any) -> None:
        self._inputs[topic] = message
        stamps = {(m.header.stamp.sec, m.header.stamp.nanosec) for m in self._inputs.values()}
        if len(self._inputs) == 3 and len(stamps) == 1:  # all inputs of one tick
            self._commands.publish(self._decide())
            self._inputs.clear()

    def _decide(self) -> JointState:
        ego, leader = self._inputs["plant/odometry"], self._inputs["v2x/leader"]
        speed_m_s = ego.twist.twist.linear.x
        gap_m = leader.pose.pose.position.x - ego.pose.pose.position.x
        gap_error_m = gap_m - STANDSTILL_GAP_M - TIME_GAP_S * speed_m_s
        acceleration_m_s2 = 0.1 * gap_error_m + 0.8 * (leader.twist.twist.linear.x - speed_m_s)
        is_warm = self._inputs["plant/cell_n_temperature"].temperature > COOL_ABOVE_DEGC
        command = JointState()
        command.header.stamp = ego.header.stamp  # the state that is answered
        command.name = ["acceleration_m_s2", "compressor_power_w"]
        command.position = [
            min(max(acceleration_m_s2, -3.0), 2.0),
            COMPRESSOR_POWER_W if is_warm else 0.0,
        ]
        return command


def main() -> None:
    """Run until Ctrl-C."""
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(OwnController())


if __name__ == "__main__":
    main()
