"""A run, or the messages of a topic, as a Parquet or CSV file for other tools."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from fnmatch import fnmatchcase
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pyarrow as pa

from iptm_bags.compare_bags import flatten
from iptm_core.errors import BagError
from iptm_core.user_input import shown
from iptm_ros.codecs import s_from_ns
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.recorded_topics import TopicRecord
from iptm_ros.recording.timeline import StampKind, read_stamp_ns, stamp_kind
from iptm_ros.recording.trajectory_file import (
    create,
    export_table,
    trajectory_columns,
    write_parquet,
)
from iptm_ros.recording.trajectory_reader import read_trajectory

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
    }
)


def message_columns(reader: BagReader, topic: TopicRecord) -> dict[str, list[Any]]:
    """Return the messages of a topic as columns of equal length.

    Fields are named by their path (`pose.pose.position.x_m`), elements of arrays by their number, named
    values and columns of tables by their names (`speed_m_s.0`). A message that lacks a field of others has
    None there.

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
        fields = ((_column(path, topic), value) for path, value in flatten(item.message))
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


def _column(path: str, topic: TopicRecord) -> str:
    """Return the name of the column of a field."""
    unit = _unit(path, topic)
    return f"{path}_{unit}" if unit else path


def _unit(path: str, topic: TopicRecord) -> str:
    """Return the unit that is missing in the name of a field, "" if none is."""
    for pattern, unit in _UNITS.get(topic.type_name, {}).items():
        if fnmatchcase(path, pattern):
            return unit
    return ""


TRAJECTORY = "trajectory"


def trajectory_table(bag: Path, namespace: str | None = None) -> pa.Table:
    """Return the run of a bag tick by tick: the columns of `iptm_core.trajectory.Trajectory`, and the gap."""
    columns = trajectory_columns(read_trajectory(bag, namespace))
    return export_table(columns, _metadata(bag, TRAJECTORY, namespace))


def topic_table(bag: Path, topic: str, namespace: str | None = None) -> pa.Table:
    """Return the messages of a topic, see `message_columns`.

    Raises:
        BagError: the bag cannot be read, has no such topic, or its messages make no table.
    """
    name = topic
    if namespace is not None and not topic.startswith("/"):
        prefix = namespace.strip("/")
        name = f"/{prefix}/{topic}" if prefix else f"/{topic}"
    with BagReader(bag) as reader:
        columns = message_columns(reader, reader.resolve(name))
    return export_table(columns, _metadata(bag, topic, namespace))


def write_csv(path: Path, table: pa.Table) -> None:
    """Write a CSV file (RFC 4180, UTF-8, decimal points); its numbers read back exactly."""

    def write() -> None:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(table.column_names)
            writer.writerows(zip(*table.to_pydict().values(), strict=True))

    create(path, write)


# What a user can ask for by the ending of a file.
WRITERS: Mapping[str, Callable[[Path, pa.Table], None]] = {
    ".parquet": write_parquet,
    ".csv": write_csv,
}
_ENDINGS = " or ".join(WRITERS)


def check_output(path: Path) -> None:
    """Refuse a file that cannot become an export, before the bag is read."""
    if path.suffix not in WRITERS:
        raise BagError(f"output is {shown(str(path))}; allowed: a name that ends in {_ENDINGS}")
    try:
        exists = path.exists() or path.is_symlink()
    except OSError as error:
        raise BagError(f"output {shown(str(path))}: {error.strerror}") from None
    if exists:
        raise BagError(f"{path} exists already; a file is never overwritten")


def _metadata(bag: Path, table: str, namespace: str | None) -> dict[str, str]:
    with BagReader(bag) as reader:
        texts = reader.run_information().to_custom_data()
    own = {"bag": bag.absolute().name, "table": table, "namespace": namespace or ""}
    return {name: text for name, text in {**texts, **own}.items() if text}


def write_table(
    bag: Path, output: Path, topic: str | None = None, namespace: str | None = None
) -> pa.Table:
    """Write the run of a bag, or the messages of a topic, into a new file; return the table.

    Raises:
        BagError: the bag cannot be read, or the file cannot be written.
    """
    check_output(output)
    table = (
        trajectory_table(bag, namespace) if topic is None else topic_table(bag, topic, namespace)
    )
    WRITERS[output.suffix](output, table)
    return table
