"""The messages of one topic as a table: a row per message, a column per scalar, units in the column names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from itertools import chain
from types import MappingProxyType
from typing import Any

from iptm_core.errors import BagError
from iptm_core.user_input import shown
from iptm_interfaces.codecs import s_from_ns
from iptm_interfaces.topics import TOPICS
from iptm_recording.bag_reader import BagReader
from iptm_recording.field_differences import flatten
from iptm_recording.recorded_topics import TopicRecord
from iptm_recording.timeline import StampKind, read_stamp_ns, stamp_kind

MOST_COLUMNS = 16_384
"""What a sheet of Excel holds; a message with more scalars is a picture or a cloud and makes no table."""
TIME_COLUMNS = ("log_time_ns", "publish_time_ns", "stamp_s")
"""Reception, publication and, where messages have one, the header stamp, which joins with `time_s`."""

# Units of fields by type and pattern; other fields are dimensionless, name their unit, or have none known.
_UNITS: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "nav_msgs/msg/Odometry": {
            "pose.pose.position.?": "m",
            "twist.twist.linear.?": "m_s",
            "twist.twist.angular.?": "rad_s",
        },
        "geometry_msgs/msg/AccelStamped": {"accel.linear.?": "m_s2", "accel.angular.?": "rad_s2"},
        "sensor_msgs/msg/Temperature": {"temperature": "c", "variance": "k2"},
        "sensor_msgs/msg/BatteryState": {
            "voltage": "v",
            "cell_voltage.[0-9]*": "v",
            "current": "a",
            "charge": "ah",
            "*capacity": "ah",
            "temperature": "c",
            "cell_temperature.[0-9]*": "c",
        },
        "trajectory_msgs/msg/JointTrajectory": {
            "points.*.positions.leader": "m",
            "points.*.velocities.leader": "m_s",
        },
    }
)
_SCALAR = "std_msgs/msg/Float64"
_JOINT_VALUE = re.compile(r"(points\.\d+\.(?:positions|velocities)\.)(\d+)")


def message_columns(reader: BagReader, topic: TopicRecord) -> dict[str, list[Any]]:
    """Return the messages of a topic as columns of equal length.

    Fields are named by their path (`pose.pose.position.x_m`), elements of arrays by their number, named
    values and columns of a `JointTrajectory` by their names. A message that lacks a field of others has
    None there.

    Args:
        reader: the bag.
        topic: one of its topics.

    Raises:
        BagError: the topic holds no messages, or makes too many columns; the bag is damaged.
    """
    kind = stamp_kind(topic.type_name, reader.definition_text(topic.type_name))
    columns: dict[str, list[Any]] = {}
    rows = 0
    for item in reader.messages([topic.name]):
        stamp_ns = None if kind is StampKind.NONE else read_stamp_ns(item.data)
        times = (
            item.log_time_ns,
            item.publish_time_ns,
            None if stamp_ns is None else s_from_ns(stamp_ns),
        )
        joints = getattr(item.message, "joint_names", ())
        fields = ((_column(path, joints, topic), value) for path, value in flatten(item.message))
        for name, value in chain(zip(TIME_COLUMNS, times, strict=True), fields):
            column = columns.setdefault(name, [])
            if len(column) > rows:
                raise BagError(f"a message of {topic.name} has two fields {shown(name)}")
            column.extend([None] * (rows - len(column)))
            column.append(value)
        rows += 1
        if len(columns) > MOST_COLUMNS:
            raise BagError(
                f"messages of {topic.name} have {len(columns)} scalars and more;"
                f" allowed in a table: {MOST_COLUMNS}"
            )
    if not rows:
        raise BagError(f"topic {topic.name} of {reader.path} holds no messages")
    if kind is StampKind.NONE:
        del columns["stamp_s"]
    for column in columns.values():
        column.extend([None] * (rows - len(column)))
    return columns


def _column(path: str, joints: Sequence[str], topic: TopicRecord) -> str:
    """Return the name of the column of a field."""
    match = _JOINT_VALUE.fullmatch(path)
    if match is not None and int(match[2]) < len(joints):
        path = match[1] + joints[int(match[2])]
    unit = _unit(path, topic)
    return f"{path}_{unit}" if unit else path


def _unit(path: str, topic: TopicRecord) -> str:
    """Return the unit that is missing in the name of a field, "" if none is."""
    if topic.type_name == _SCALAR:
        for spec in TOPICS.values():
            if spec.type_name == _SCALAR and topic.name.endswith(f"/{spec.name}"):
                return spec.unit.lower().replace("/", "_").replace("^", "")
    for pattern, unit in _UNITS.get(topic.type_name, {}).items():
        if fnmatchcase(path, pattern):
            return unit
    return ""
