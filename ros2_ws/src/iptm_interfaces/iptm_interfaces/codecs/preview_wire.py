"""Leader previews as serialised bytes: one array copy instead of one Python object per node.

A preview of 61 nodes costs about 0.8 ms as message objects (build, serialise, parse, take apart),
more than everything else in a tick but the solver; here it costs some tens of microseconds. In CDR,
the encoding of DDS, every point of one position and one velocity takes 48 bytes, 64 with the bound, so a
NumPy record array is laid over them. The result is an ordinary `trajectory_msgs/JointTrajectory`.
Received bytes of any other shape (byte order, names, points) are decoded the ordinary way.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import MessageError
from iptm_core.state import NS_PER_S, LeaderPreview
from iptm_interfaces.codecs.cdr import serialized
from iptm_interfaces.codecs.preview import (
    KNOWN_NAMES,
    PREVIEW_NAMES,
    build_leader_preview,
    decode_leader_preview,
    encode_leader_preview,
    offsets_ns,
    preview_columns,
)
from iptm_interfaces.codecs.time import time_from_ns
from iptm_interfaces.message_types import (
    JointTrajectory,
)
from iptm_interfaces.topics import ROAD_FRAME, Topic

_LITTLE_ENDIAN_CDR = b"\x00\x01\x00\x00"


def _padded(text: str) -> bytes:
    """Return a CDR string (length, characters, zero) filled up to the next multiple of four."""
    data = text.encode() + b"\x00"
    return struct.pack("<I", len(data)) + data + b"\x00" * (-len(data) % 4)


# In front of the points: encoding, stamp, frame, joint names, number of points.
_STAMP_OFFSET = len(_LITTLE_ENDIAN_CDR)
_FRAME_OFFSET = _STAMP_OFFSET + 8


class _Layout:
    """Where the parts of a message lie whose points have one or two joints.

    Attributes:
        names: number of joint names, and these.
        point: one point as a record.
    """

    def __init__(self, joint_names: list[str]) -> None:
        joints = len(joint_names)
        self.names = struct.pack("<I", joints) + b"".join(map(_padded, joint_names))
        # Writers need not clear the fill bytes, so only the meaningful ones are compared.
        self._compared: list[tuple[int, bytes]] = [(0, self.names[:4])]
        place = 4
        for name in joint_names:
            meant = struct.pack("<I", len(name) + 1) + name.encode() + b"\x00"
            self._compared.append((place, meant))
            place += len(_padded(name))
        numbers = 8 * joints
        self.point = np.dtype(
            {
                "names": [
                    "position_count", "positions", "speed_count", "speeds", "acceleration_count",
                    "effort_count", "sec", "nanosec",
                ],
                "formats": [
                    "<u4", ("<f8", (joints,)), "<u4", ("<f8", (joints,)), "<u4", "<u4", "<i4", "<u4",
                ],
                "offsets": [
                    0, 8, 8 + numbers, 16 + numbers,
                    *(16 + 2 * numbers + more for more in (0, 4, 8, 12)),
                ],
                "itemsize": 32 + 2 * numbers,
            }
        )  # fmt: skip

    def offsets(self, frame_size: int) -> tuple[int, int, int]:
        """Return where the joint names, the number of points and the records of the points begin.

        A float64 lies on a multiple of eight behind the encoding. The length of a record is one, so they all
        fit if the first one does. If the length of the names puts the first point four bytes off, that
        point has no fill bytes behind its first number: its record begins with the number of points.

        Args:
            frame_size: of the frame's name with its zero, in bytes.
        """
        names = _FRAME_OFFSET + 4 + frame_size + -frame_size % 4
        count = names + len(self.names)
        points = count + 4
        return names, count, points - (points - _STAMP_OFFSET) % 8

    def has_names(self, data: bytes, names_at: int) -> bool:
        """Return whether the joint names are those of this layout."""
        return all(
            data[names_at + place : names_at + place + len(meant)] == meant
            for place, meant in self._compared
        )


_LAYOUTS = (_Layout(KNOWN_NAMES), _Layout(PREVIEW_NAMES))
"""Without and with bounds."""


def encode_leader_preview_bytes(
    preview: LeaderPreview, stamp_ns: int, frame: str = ROAD_FRAME
) -> bytes:
    """Return a prediction, serialised, to be given to `Publisher.publish`.

    Args:
        preview: prediction, n nodes; may be empty.
        stamp_ns: instant of publication.
        frame: name of the frame in the graph.

    Raises:
        MessageError: see `encode_leader_preview`.
    """
    relative_ns = offsets_ns(preview, stamp_ns)
    count = relative_ns.size
    if count == 0:
        message = encode_leader_preview(preview, stamp_ns)
        message.header.frame_id = frame
        return serialized(message)
    stamp = time_from_ns(stamp_ns)
    frame_name = _padded(frame)
    layout = _LAYOUTS[preview.bounds_m.size > 0]
    names_at, count_at, points_at = layout.offsets(len(frame.encode()) + 1)
    data = bytearray(points_at + layout.point.itemsize * count)
    data[:_STAMP_OFFSET] = _LITTLE_ENDIAN_CDR
    struct.pack_into("<iI", data, _STAMP_OFFSET, stamp.sec, stamp.nanosec)
    data[_FRAME_OFFSET : _FRAME_OFFSET + len(frame_name)] = frame_name
    data[names_at : names_at + len(layout.names)] = layout.names
    points = np.frombuffer(data, layout.point, count, points_at)
    seconds = relative_ns // NS_PER_S
    positions, velocities = preview_columns(preview)
    joints = positions.shape[1]
    points["position_count"] = joints
    points["positions"] = positions
    points["speed_count"] = joints
    points["speeds"] = velocities
    points["sec"] = seconds
    points["nanosec"] = relative_ns - seconds * NS_PER_S
    # Last, as they may lie in the first record.
    struct.pack_into("<II", data, count_at, count, joints)
    return bytes(data)


def decode_leader_preview_bytes(
    data: bytes, topic: Topic = Topic.LEADER_PREVIEW
) -> tuple[int, LeaderPreview]:
    """Return the stamp (ns) and the prediction from a serialised message (raw subscription).

    Args:
        data: the message.
        topic: that of predictions, or that of measurements of the range sensor.

    Raises:
        MessageError: the bytes are not such a message, or see `decode_leader_preview`.
    """
    points = _points_if_plain(data)
    if points is None:
        return decode_leader_preview(_deserialize(data))
    stamp_s, stamp_rest_ns = struct.unpack_from("<iI", data, _STAMP_OFFSET)
    stamp_ns = stamp_s * NS_PER_S + stamp_rest_ns
    positions = points["positions"].astype(np.float64)
    preview = build_leader_preview(
        stamp_ns,
        points["sec"].astype(np.int64) * NS_PER_S + points["nanosec"],
        positions[:, 0],
        points["speeds"][:, 0].astype(np.float64),
        positions[:, 1] if positions.shape[1] > 1 else np.empty(0),
        topic,
    )
    return stamp_ns, preview


def _points_if_plain(data: bytes) -> NDArray[np.void] | None:
    """Return a view of the points, shape (n,), if the bytes have the usual shape, else None."""
    if len(data) < _FRAME_OFFSET + 4 or data[:2] != _LITTLE_ENDIAN_CDR[:2]:
        return None
    frame_size: int = struct.unpack_from("<I", data, _FRAME_OFFSET)[0]
    for joints, layout in enumerate(_LAYOUTS, 1):
        names_at, count_at, points_at = layout.offsets(frame_size)
        if not layout.has_names(data, names_at) or len(data) < count_at + 8:
            continue
        count, first_position_count = struct.unpack_from("<II", data, count_at)
        # Other publishers may append unused bytes, so the buffer may be longer than needed.
        if count == 0 or len(data) < points_at + layout.point.itemsize * count:
            return None
        points = np.frombuffer(data, layout.point, count, points_at)
        plain = (points["speed_count"] == joints) & (points["acceleration_count"] == 0)
        plain &= points["effort_count"] == 0
        plain[1:] &= points["position_count"][1:] == joints
        return points if first_position_count == joints and plain.all() else None
    return None


def _deserialize(data: bytes) -> JointTrajectory:
    from rclpy.serialization import deserialize_message  # noqa: PLC0415  readers of bags do without ROS

    try:
        return deserialize_message(data, JointTrajectory)
    except Exception as error:  # the binding raises error types of its own
        raise MessageError(
            f"{Topic.LEADER_PREVIEW.value}: {len(data)} bytes are not a JointTrajectory: {error}"
        ) from error
