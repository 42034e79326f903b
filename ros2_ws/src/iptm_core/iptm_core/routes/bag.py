"""A vehicle's drive in a bag of ROS, as a table: its odometry, and the slope of its road if it is there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from iptm_core.errors import RouteError
from iptm_core.routes.csv_table import CsvTable
from iptm_core.state import NS_PER_S, FloatArray

OWN_ODOMETRY, OWN_SLOPE = "plant/odometry", "v2x/slope"
"""Topics of a vehicle of this suite, as `iptm_ros.topics` describes them."""
_TYPE = "nav_msgs/msg/Odometry"
_ANOTHER_TRIP_NS = 10 * NS_PER_S
"""A stamp that is older by more than that begins another trip; of several the last one counts."""


def read_bag(path: Path, name: str) -> CsvTable:
    """Return ``time_s``, ``speed_m_s`` and, if recorded, ``slope_rad`` of a vehicle's drive.

    Args:
        name: namespace of the vehicle, or a topic of its odometry; "" for the only one.
    """
    if not (path.is_file() or (path / "metadata.yaml").is_file()):
        raise RouteError(
            f"{path}: no file, and no folder with metadata.yaml; allowed: a bag, such as scripts/recover_bag "
            "makes of one that was killed"
        )
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            topic = _odometry(path, {each.topic: each.msgtype for each in reader.connections}, name)
            rows = _last_trip(_messages(reader, topic))
            columns = {"time_s": rows[:, 0], "speed_m_s": rows[:, 2]}
            for road in _messages(reader, topic.rsplit("/", 2)[0] + f"/{OWN_SLOPE}"):
                columns["slope_rad"] = np.interp(rows[:, 1], *np.reshape(road.data, (2, -1)))
    except RouteError:
        raise
    except Exception as reason:  # the readers have error types of their own
        cause = str(reason) or type(reason).__name__
        raise RouteError(
            f"{path}: cannot be read as a bag ({cause}); scripts/recover_bag saves what is whole"
        ) from reason
    source = f"{path}#{topic}"
    if not rows.size:
        raise RouteError(f"{source}: 0 messages; allowed: those of 2 s or more")
    bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if bad.size:
        raise RouteError(f"{source}, message {bad[0] + 1}: not finite; allowed: finite numbers")
    return CsvTable(source, columns, tuple(range(1, len(rows) + 1)), "message")


def _odometry(path: Path, types: Mapping[str, str], name: str) -> str:
    """Return the topic that is meant."""
    known = sorted(topic for topic in types if types[topic] == _TYPE)
    own = f"/{OWN_ODOMETRY}"
    if name:
        wanted = name.strip("/")
        found = [topic for topic in known if topic in {f"/{wanted}", f"/{wanted}{own}"}]
    elif own in known:
        found = [own]
    else:
        found = [topic for topic in known if topic.endswith(own)] or known
    if len(found) == 1:
        return found[0]
    if not known:
        topics = ", ".join(sorted(types)) or "none"
        raise RouteError(f"{path} has no odometry ({_TYPE}); its topics are: {topics}")
    raise RouteError(
        f"{path}: odometry is {name!r}; allowed: {', '.join(f'{path}#{topic}' for topic in known)}"
    )


def _messages(reader: AnyReader, topic: str) -> Iterator[Any]:
    connections = [each for each in reader.connections if each.topic == topic]
    if connections:  # without any, all messages would be read
        for connection, _, data in reader.messages(connections):
            yield reader.deserialize(data, connection.msgtype)


def _last_trip(messages: Iterable[Any]) -> FloatArray:
    """Return time (s, from 0), position (m) and speed (m/s) of the states of the last trip, shape (n, 3)."""
    found: dict[int, tuple[float, float]] = {}
    last_ns = 0
    for message in messages:
        stamp, speed = message.header.stamp, message.twist.twist.linear
        at_ns = stamp.sec * NS_PER_S + stamp.nanosec
        if at_ns < last_ns - _ANOTHER_TRIP_NS:
            found.clear()
        last_ns = at_ns
        found[at_ns] = (message.pose.pose.position.x, float(np.hypot(speed.x, speed.y)))
    first_ns = min(found, default=0)
    rows = [((at_ns - first_ns) / NS_PER_S, *found[at_ns]) for at_ns in sorted(found)]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
