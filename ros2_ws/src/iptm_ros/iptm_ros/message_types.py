"""Message classes of the topics: from ROS, or without ROS from rosbags for the same definitions.

Without ROS, messages are only read out of bags; to build or publish one takes the classes of ROS.
"""

from __future__ import annotations

from typing import Any

try:
    from builtin_interfaces.msg import Time as Time
    from diagnostic_msgs.msg import DiagnosticArray as DiagnosticArray
    from geometry_msgs.msg import AccelStamped as AccelStamped
    from nav_msgs.msg import Odometry as Odometry
    from rosgraph_msgs.msg import Clock as Clock
    from sensor_msgs.msg import BatteryState as BatteryState
    from sensor_msgs.msg import JointState as JointState
    from sensor_msgs.msg import PointCloud2 as PointCloud2
    from sensor_msgs.msg import PointField as PointField
    from sensor_msgs.msg import Temperature as Temperature
    from std_msgs.msg import Float64 as Float64
    from std_msgs.msg import Float64MultiArray as Float64MultiArray
    from std_msgs.msg import Header as Header
    from std_msgs.msg import MultiArrayDimension as MultiArrayDimension
    from std_msgs.msg import MultiArrayLayout as MultiArrayLayout
    from std_msgs.msg import String as String
    from std_msgs.msg import UInt8MultiArray as UInt8MultiArray
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
    String = _rosbags.std_msgs__msg__String
    UInt8MultiArray = _rosbags.std_msgs__msg__UInt8MultiArray


def type_name(message_type: type[Any]) -> str:
    """Return a message type as ROS tools print it, e.g. `nav_msgs/msg/Odometry`."""
    of_rosbags: str | None = getattr(message_type, "__msgtype__", None)
    if of_rosbags is not None:
        return of_rosbags
    package = message_type.__module__.split(".", maxsplit=1)[0]
    return f"{package}/msg/{message_type.__name__}"
