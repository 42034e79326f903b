"""Message classes of the topics: from ROS, or without ROS from rosbags for the same definitions.

Without ROS, messages are only read out of bags; to build or publish one takes the classes of ROS.
"""

from __future__ import annotations

from typing import Any

try:
    from builtin_interfaces.msg import Time
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import AccelStamped
    from nav_msgs.msg import Odometry
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import BatteryState, JointState, PointCloud2, PointField, Temperature
    from std_msgs.msg import (
        Float64,
        Float64MultiArray,
        Header,
        MultiArrayDimension,
        MultiArrayLayout,
        UInt8MultiArray,
    )
except ModuleNotFoundError:
    from rosbags.typesys.stores import ros2_jazzy as _rosbags

    Time = _rosbags.builtin_interfaces__msg__Time
    DiagnosticArray = _rosbags.diagnostic_msgs__msg__DiagnosticArray
    AccelStamped = _rosbags.geometry_msgs__msg__AccelStamped
    Odometry = _rosbags.nav_msgs__msg__Odometry
    Clock = _rosbags.rosgraph_msgs__msg__Clock
    BatteryState = _rosbags.sensor_msgs__msg__BatteryState
    JointState = _rosbags.sensor_msgs__msg__JointState
    PointCloud2 = _rosbags.sensor_msgs__msg__PointCloud2
    PointField = _rosbags.sensor_msgs__msg__PointField
    Temperature = _rosbags.sensor_msgs__msg__Temperature
    Float64 = _rosbags.std_msgs__msg__Float64
    Float64MultiArray = _rosbags.std_msgs__msg__Float64MultiArray
    Header = _rosbags.std_msgs__msg__Header
    MultiArrayDimension = _rosbags.std_msgs__msg__MultiArrayDimension
    MultiArrayLayout = _rosbags.std_msgs__msg__MultiArrayLayout
    UInt8MultiArray = _rosbags.std_msgs__msg__UInt8MultiArray

__all__ = [
    "AccelStamped",
    "BatteryState",
    "Clock",
    "DiagnosticArray",
    "Float64",
    "Float64MultiArray",
    "Header",
    "JointState",
    "MultiArrayDimension",
    "MultiArrayLayout",
    "Odometry",
    "PointCloud2",
    "PointField",
    "Temperature",
    "Time",
    "UInt8MultiArray",
    "type_name",
]


def type_name(message_type: type[Any]) -> str:
    """Return a message type as ROS tools print it, e.g. `nav_msgs/msg/Odometry`."""
    of_rosbags: str | None = getattr(message_type, "__msgtype__", None)
    if of_rosbags is not None:
        return of_rosbags
    package = message_type.__module__.split(".", maxsplit=1)[0]
    return f"{package}/msg/{message_type.__name__}"
