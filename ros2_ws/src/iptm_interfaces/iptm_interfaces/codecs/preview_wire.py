"""Leader previews as serialised bytes: one array copy instead of one Python object per node.

A preview of 61 nodes costs about 0.8 ms as message objects (build, serialise, parse, take apart),
more than everything else in a tick but the solver; here it costs some tens of microseconds. In CDR,
the encoding of DDS, every point of one position and one velocity takes 48 bytes, so a NumPy record
array is laid over them. The result is an ordinary `trajectory_msgs/JointTrajectory` for any reader.
Received bytes of any other shape (byte order, names, points) are decoded the ordinary way.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import MessageError
from iptm_core.state import LeaderPreview
from iptm_core.trip_time import NS_PER_S
from iptm_interfaces.codecs.cdr import serialized
from iptm_interfaces.codecs.preview import (
    PREVIEW_NAMES,
    build_leader_preview,
    decode_leader_preview,
    encode_leader_preview,
    offsets_ns,
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


# In front of the points: encoding, stamp, frame, one joint name, number of points.
_STAMP_OFFSET = len(_LITTLE_ENDIAN_CDR)
_FRAME_OFFSET = _STAMP_OFFSET + 8
# Writers need not clear the fill bytes, so only the meaningful ones are compared.
_NAMES = struct.pack("<II", 1, len(PREVIEW_NAMES[0]) + 1) + PREVIEW_NAMES[0].encode() + b"\x00"
_NAMES_SIZE = 4 + len(_padded(PREVIEW_NAMES[0]))


def _offsets(frame_size: int) -> tuple[int, int, int]:
    """Return where the joint names, the number of points and the records of the points begin.

    A float64 lies on a multiple of eight behind the encoding. Every record is 48 bytes long, so they all
    fit if the first one does. Where the frame's name is so long that the first point lies four bytes off,
    that point has no fill bytes behind its first number: its record begins with the number of points.

    Args:
        frame_size: of the frame's name with its zero, in bytes.
    """
    names = _FRAME_OFFSET + 4 + frame_size + -frame_size % 4
    count = names + _NAMES_SIZE
    points = count + 4
    return names, count, points - (points - _STAMP_OFFSET) % 8


# One point.
_POINT = np.dtype(
    {
        "names": [
            "position_count", "position", "speed_count", "speed", "acceleration_count",
            "effort_count", "sec", "nanosec",
        ],
        "formats": ["<u4", "<f8", "<u4", "<f8", "<u4", "<u4", "<i4", "<u4"],
        "offsets": [0, 8, 16, 24, 32, 36, 40, 44],
        "itemsize": 48,
    }
)  # fmt: skip


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
    names_at, count_at, points_at = _offsets(len(frame.encode()) + 1)
    data = bytearray(points_at + _POINT.itemsize * count)
    data[:_STAMP_OFFSET] = _LITTLE_ENDIAN_CDR
    struct.pack_into("<iI", data, _STAMP_OFFSET, stamp.sec, stamp.nanosec)
    data[_FRAME_OFFSET : _FRAME_OFFSET + len(frame_name)] = frame_name
    data[names_at : names_at + len(_NAMES)] = _NAMES
    points = np.frombuffer(data, _POINT, count, points_at)
    seconds = relative_ns // NS_PER_S
    points["position_count"] = 1
    points["position"] = preview.positions_m
    points["speed_count"] = 1
    points["speed"] = preview.speeds_m_s
    points["sec"] = seconds
    points["nanosec"] = relative_ns - seconds * NS_PER_S
    # Last, as they may lie in the first record.
    struct.pack_into("<II", data, count_at, count, 1)
    return bytes(data)


def decode_leader_preview_bytes(
    data: bytes, topic: Topic = Topic.LEADER_PREVIEW
) -> tuple[int, LeaderPreview]:
    """Return the stamp (ns) and the prediction from a serialised message (raw subscription).

    Args:
        data: the message.
        topic: that of predictions, or that of measurements of the range sensor.

    Raises:
        MessageError: the bytes are no such message, or see `decode_leader_preview`.
    """
    points = _points_if_plain(data)
    if points is None:
        return decode_leader_preview(_deserialize(data))
    stamp_s, stamp_rest_ns = struct.unpack_from("<iI", data, _STAMP_OFFSET)
    stamp_ns = stamp_s * NS_PER_S + stamp_rest_ns
    preview = build_leader_preview(
        stamp_ns,
        points["sec"].astype(np.int64) * NS_PER_S + points["nanosec"],
        points["position"].astype(np.float64),
        points["speed"].astype(np.float64),
        topic,
    )
    return stamp_ns, preview


def _points_if_plain(data: bytes) -> NDArray[np.void] | None:
    """Return a view of the points, shape (n,), if the bytes have the usual shape, else None."""
    if len(data) < _FRAME_OFFSET + 4 or data[:2] != _LITTLE_ENDIAN_CDR[:2]:
        return None
    frame_size: int = struct.unpack_from("<I", data, _FRAME_OFFSET)[0]
    names_at, count_at, points_at = _offsets(frame_size)
    if data[names_at : names_at + len(_NAMES)] != _NAMES or len(data) < count_at + 8:
        return None
    count, first_position_count = struct.unpack_from("<II", data, count_at)
    # Other publishers may append unused bytes, so the buffer may be longer than needed.
    if count == 0 or len(data) < points_at + _POINT.itemsize * count:
        return None
    points = np.frombuffer(data, _POINT, count, points_at)
    plain = (points["speed_count"] == 1) & (points["acceleration_count"] == 0)
    plain &= points["effort_count"] == 0
    plain[1:] &= points["position_count"][1:] == 1
    return points if first_position_count == 1 and plain.all() else None


def _deserialize(data: bytes) -> JointTrajectory:
    from rclpy.serialization import deserialize_message  # noqa: PLC0415  readers of bags do without ROS

    try:
        return deserialize_message(data, JointTrajectory)
    except Exception as error:  # the binding raises error types of its own
        raise MessageError(
            f"{Topic.LEADER_PREVIEW.value}: {len(data)} bytes are no JointTrajectory: {error}"
        ) from error
