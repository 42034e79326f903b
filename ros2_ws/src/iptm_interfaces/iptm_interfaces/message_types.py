"""Message classes of the topics: those of ROS, without ROS those of rosbags for the same definitions.

Without ROS, messages are only read out of bags; to build or publish one takes the classes of ROS.
"""

from __future__ import annotations

from typing import Any

try:
    from builtin_interfaces.msg import Duration, Time
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import AccelStamped
    from nav_msgs.msg import Odometry
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import BatteryState, JointState, Temperature
    from std_msgs.msg import (
        Float64,
        Float64MultiArray,
        Header,
        MultiArrayDimension,
        MultiArrayLayout,
        UInt8MultiArray,
    )
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
except ModuleNotFoundError:
    from rosbags.typesys.stores.ros2_jazzy import (
        builtin_interfaces__msg__Duration as Duration,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        builtin_interfaces__msg__Time as Time,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        diagnostic_msgs__msg__DiagnosticArray as DiagnosticArray,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        geometry_msgs__msg__AccelStamped as AccelStamped,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        nav_msgs__msg__Odometry as Odometry,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        rosgraph_msgs__msg__Clock as Clock,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        sensor_msgs__msg__BatteryState as BatteryState,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        sensor_msgs__msg__JointState as JointState,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        sensor_msgs__msg__Temperature as Temperature,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        std_msgs__msg__Float64 as Float64,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        std_msgs__msg__Float64MultiArray as Float64MultiArray,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        std_msgs__msg__Header as Header,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        std_msgs__msg__MultiArrayDimension as MultiArrayDimension,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        std_msgs__msg__MultiArrayLayout as MultiArrayLayout,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        std_msgs__msg__UInt8MultiArray as UInt8MultiArray,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        trajectory_msgs__msg__JointTrajectory as JointTrajectory,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        trajectory_msgs__msg__JointTrajectoryPoint as JointTrajectoryPoint,
    )

__all__ = [
    "AccelStamped",
    "BatteryState",
    "Clock",
    "DiagnosticArray",
    "Duration",
    "Float64",
    "Float64MultiArray",
    "Header",
    "JointState",
    "JointTrajectory",
    "JointTrajectoryPoint",
    "MultiArrayDimension",
    "MultiArrayLayout",
    "Odometry",
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
