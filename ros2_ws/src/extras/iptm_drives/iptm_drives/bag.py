"""A vehicle's drive in a bag of ROS, as a table: its odometry, and the slope of its road if it is there."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from iptm_core.errors import RouteError
from iptm_core.routes.drive_table import DriveTable
from iptm_core.state import NS_PER_S, FloatArray
from iptm_core.user_input import read_file

OWN_ODOMETRY, OWN_SLOPE = "plant/odometry", "v2x/slope"
"""Topics of a vehicle of this suite, as `iptm_ros.topics` describes them."""
_TYPE = "nav_msgs/msg/Odometry"
_MAGICS = {b"\x89MCAP0\r\n": ".mcap", b"SQLite f": ".db3", b"#ROSBAG ": ".bag"}
_SIDEWAYS = 0.1


def read_bag(path: Path, name: str) -> DriveTable:
    """Return times, places, speeds and, if recorded, slopes of a vehicle's drive.

    A speed is negative where the twist points backwards. Of several roads on the topic the last one counts.

    Args:
        name: namespace of the vehicle, or a topic of its odometry; "" for the only one.
    """
    storages = _storages(path)
    if not storages:
        raise RouteError(
            f"{path}: no file, and no folder with metadata.yaml; allowed: a bag, such as scripts/iptm "
            "recover makes of one that was killed"
        )
    with tempfile.TemporaryDirectory(prefix="iptm_bag_") as scratch:
        try:
            with _opened(path, storages, Path(scratch)) as reader:
                topic = _odometry(
                    path, {each.topic: each.msgtype for each in reader.connections}, name
                )
                rows = np.array(
                    [_row(at_ns, message) for at_ns, message in _messages(reader, topic)],
                    np.float64,
                ).reshape(-1, 6)
                slopes = None
                for _, road in _messages(reader, topic.rsplit("/", 2)[0] + f"/{OWN_SLOPE}"):
                    slopes = np.interp(rows[:, 2], *np.reshape(road.data, (2, -1)))
        except RouteError:
            raise
        except Exception as reason:  # the readers have error types of their own
            cause = str(reason) or type(reason).__name__
            raise RouteError(
                f"{path}: cannot be read as a bag ({cause}); scripts/iptm recover saves the intact part"
            ) from reason
    source = f"{path}#{topic}"
    if not len(rows):
        raise RouteError(f"{source}: 0 messages; allowed: recordings of 2 s or more")
    columns = {
        "time_s": rows[:, 1],
        "east_m": rows[:, 2],
        "north_m": rows[:, 3],
        "speed_m_s": _signed(rows[:, 4], rows[:, 5]),
    }
    if slopes is not None:
        columns["slope_rad"] = slopes
    numbers = np.arange(1, len(rows) + 1)
    return DriveTable(source, columns, numbers, "message", received_s=rows[:, 0])


def _row(at_ns: int, message: Any) -> tuple[float, ...]:
    """Return time of receipt, stamp, place and velocity of a message."""
    stamp, place = message.header.stamp, message.pose.pose.position
    speed = message.twist.twist.linear
    at = (at_ns / NS_PER_S, (stamp.sec * NS_PER_S + stamp.nanosec) / NS_PER_S)
    return *at, place.x, place.y, speed.x, speed.y


def _signed(ahead: FloatArray, left: FloatArray) -> FloatArray:
    """Return speeds with the sign of the velocity ahead, where it is one: not in a frame of the map."""
    speeds: FloatArray = np.hypot(ahead, left)
    sideways = np.abs(left) > _SIDEWAYS * np.abs(ahead)
    return speeds if sideways.mean() > _SIDEWAYS else np.copysign(speeds, ahead)


def _storages(path: Path) -> list[Path]:
    """Return the files with messages in a bag, by their magic."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return [file for file in files if file.is_file() and _suffix(file)]


def _suffix(file: Path) -> str:
    with file.open("rb") as content:
        magic = content.read(8)
    return _MAGICS.get(
        magic, file.suffix if file.suffix in _MAGICS.values() or file.suffix == ".zstd" else ""
    )


def _opened(path: Path, storages: list[Path], scratch: Path) -> AnyReader:
    """Open a bag: as its metadata say, or file by file where they name no storage that is known."""
    store = get_typestore(Stores.ROS2_JAZZY)
    metadata = path / "metadata.yaml"
    if metadata.is_file():
        text = read_file(metadata, 10_000_000, RouteError).decode("utf-8", errors="replace")
        if "storage_identifier: mcap" in text or "storage_identifier: sqlite3" in text:
            return AnyReader([path], default_typestore=store)
    links = []
    for number, file in enumerate(storages):
        link = scratch / f"{number}{_suffix(file)}"
        link.symlink_to(file.resolve())
        links.append(link)
    return AnyReader(links, default_typestore=store)


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


def _messages(reader: AnyReader, topic: str) -> Iterator[tuple[int, Any]]:
    connections = [each for each in reader.connections if each.topic == topic]
    if connections:  # without any, all messages would be read
        for connection, at_ns, data in reader.messages(connections):
            yield at_ns, reader.deserialize(data, connection.msgtype)
