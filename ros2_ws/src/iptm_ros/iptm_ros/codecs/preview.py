"""What lies ahead: the predicted motion of the leader, as serialised bytes.

A prediction carries two times: the stamp of its publication and the instant of its generation, which
is the time of its first point. Where it is uncertain, a second joint has its bounds.

A preview of 61 nodes costs about 0.8 ms as message objects (build, serialise, parse, take apart),
more than everything else in a tick but the solver; here it costs some tens of microseconds. In CDR,
the encoding of DDS, every point of one position and one velocity takes 48 bytes, 64 with the bound, so a
NumPy record array is laid over them. The result is an ordinary `trajectory_msgs/JointTrajectory`.
Received bytes of any other shape (byte order, names, points) are decoded as message objects.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import MessageError
from iptm_core.state import NS_PER_S, SPEED_AT_REST_M_S, FloatArray, LeaderPreview
from iptm_ros.codecs.numbers import reject
from iptm_ros.codecs.plan import all_finite, increasing
from iptm_ros.codecs.time import ns_from_duration, ns_from_time, time_from_ns
from iptm_ros.message_types import JointTrajectory
from iptm_ros.topics import ROAD_FRAME, TOPICS, Topic

PREVIEW_NAMES = list(TOPICS[Topic.LEADER_PREVIEW].fields)
KNOWN_NAMES = PREVIEW_NAMES[:1]
"""Those of a prediction without bounds."""
_TOPIC = Topic.LEADER_PREVIEW
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

    Raises:
        MessageError: the arrays differ in length, or a time is not finite.
    """
    relative_ns = _offsets_ns(preview, stamp_ns)
    count = relative_ns.size
    stamp = time_from_ns(stamp_ns)
    frame_name = _padded(frame)
    layout = _LAYOUTS[preview.bounds_m.size > 0]
    names_at, count_at, points_at = layout.offsets(len(frame.encode()) + 1)
    data = bytearray(max(points_at + layout.point.itemsize * count, count_at + 4))
    data[:_STAMP_OFFSET] = _LITTLE_ENDIAN_CDR
    struct.pack_into("<iI", data, _STAMP_OFFSET, stamp.sec, stamp.nanosec)
    data[_FRAME_OFFSET : _FRAME_OFFSET + len(frame_name)] = frame_name
    data[names_at : names_at + len(layout.names)] = layout.names
    if count:
        points = np.frombuffer(data, layout.point, count, points_at)
        seconds = relative_ns // NS_PER_S
        positions, velocities = _columns(preview)
        joints = positions.shape[1]
        points["position_count"] = joints
        points["positions"] = positions
        points["speed_count"] = joints
        points["speeds"] = velocities
        points["sec"] = seconds
        points["nanosec"] = relative_ns - seconds * NS_PER_S
        # After the points, as it may lie in the first record.
        struct.pack_into("<I", data, count_at + 4, joints)
    struct.pack_into("<I", data, count_at, count)
    return bytes(data)


def _columns(preview: LeaderPreview) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities of the joints at the nodes, shape (n, 1), with bounds (n, 2) each.

    The velocity of the bound is its mean rate up to the next node, 0 at the last one.
    """
    positions, speeds, bounds = preview.positions_m, preview.speeds_m_s, preview.bounds_m
    if not bounds.size:
        return positions[:, None], speeds[:, None]
    rates = np.zeros(bounds.size)
    rates[:-1] = np.diff(bounds) / np.maximum(np.diff(preview.times_s), 1e-9)
    return np.column_stack([positions, bounds]), np.column_stack([speeds, rates])


def _offsets_ns(preview: LeaderPreview, stamp_ns: int) -> NDArray[np.int64]:
    """Return the node times relative to the stamp in integer nanoseconds, shape (n,)."""
    count = preview.times_s.size
    if preview.positions_m.size != count or preview.speeds_m_s.size != count:
        sizes = f"{count}, {preview.positions_m.size}, {preview.speeds_m_s.size}"
        reject(_TOPIC, f"times, positions and speeds have {sizes} entries; allowed: equal numbers")
    if preview.bounds_m.size not in {0, count}:
        reject(_TOPIC, f"bounds have {preview.bounds_m.size} entries; allowed: 0 or {count}")
    if count == 0:
        return np.empty(0, dtype=np.int64)
    all_finite(_TOPIC, "times", preview.times_s)
    absolute: NDArray[np.int64] = np.rint(preview.times_s * 1e9).astype(np.int64)
    return absolute - stamp_ns


def decode_leader_preview_bytes(
    data: bytes, topic: Topic = Topic.LEADER_PREVIEW
) -> tuple[int, LeaderPreview]:
    """Return the stamp (ns) and the prediction from a serialised message (raw subscription).

    Raises:
        MessageError: the bytes are not such a message, or see `decode_leader_preview`.
    """
    points = _points_if_plain(data)
    if points is None:
        return decode_leader_preview(_deserialize(data), topic)
    stamp_s, stamp_rest_ns = struct.unpack_from("<iI", data, _STAMP_OFFSET)
    stamp_ns = stamp_s * NS_PER_S + stamp_rest_ns
    positions = points["positions"].astype(np.float64)
    preview = _checked(
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


def decode_leader_preview(
    message: JointTrajectory, topic: Topic = _TOPIC
) -> tuple[int, LeaderPreview]:
    """Return the stamp (ns) and the prediction.

    Raises:
        MessageError: wrong joint names, a point without exactly one position and one velocity for each, a
            value that is not finite, times that do not increase, a leader that drives backwards, a negative
            bound, or a generation after the publication.
    """
    stamp_ns = ns_from_time(message.header.stamp)
    names = list(message.joint_names)
    if sorted(names) not in (KNOWN_NAMES, PREVIEW_NAMES):
        reject(_TOPIC, f"joint_names are {names}; allowed: {KNOWN_NAMES} or {PREVIEW_NAMES}")
    points = message.points
    for index, point in enumerate(points):
        if len(point.positions) != len(names) or len(point.velocities) != len(names):
            reject(
                _TOPIC,
                f"point {index} has {len(point.positions)} positions and {len(point.velocities)} "
                f"velocities; allowed: {len(names)} of each",
            )
    places = [names.index(name) for name in PREVIEW_NAMES if name in names]
    columns = [
        np.array([point.positions[place] for point in points], dtype=np.float64) for place in places
    ]
    preview = _checked(
        stamp_ns,
        np.array([ns_from_duration(point.time_from_start) for point in points], dtype=np.int64),
        columns[0],
        np.array([point.velocities[places[0]] for point in points], dtype=np.float64),
        columns[1] if len(columns) > 1 else np.empty(0),
        topic,
    )
    return stamp_ns, preview


def _checked(
    stamp_ns: int,
    node_offsets_ns: NDArray[np.int64],
    positions_m: FloatArray,
    speeds_m_s: FloatArray,
    bounds_m: FloatArray,
    topic: Topic,
) -> LeaderPreview:
    """Return a checked prediction from decoded arrays, shape (n,) each; the bounds may be empty.

    Measured positions, those of ``v2x/leader_samples``, may go back and forth; predicted ones may not.
    """
    if node_offsets_ns.size == 0:
        return LeaderPreview.empty()
    if node_offsets_ns[0] > 0:
        reject(
            topic,
            f"generated {node_offsets_ns[0]} ns after its publication; allowed: at most 0",
        )
    times_s = (node_offsets_ns + stamp_ns) / 1e9
    increasing(topic, "times", times_s)
    all_finite(topic, "positions", positions_m)
    all_finite(topic, "speeds", speeds_m_s)
    if float(speeds_m_s.min()) < SPEED_AT_REST_M_S:
        reject(topic, f"speed is {speeds_m_s.min()}; allowed: at least {SPEED_AT_REST_M_S:g} m/s")
    if bounds_m.size:
        all_finite(topic, "bounds", bounds_m)
        if float(bounds_m.min()) < 0.0:
            reject(topic, f"bound is {bounds_m.min()} m; allowed: at least 0 m")
    backwards_m = SPEED_AT_REST_M_S * np.maximum(np.diff(times_s), 1.0)
    if topic is _TOPIC and (np.diff(positions_m) < backwards_m).any():
        reject(topic, "positions decrease; allowed: a leader that never drives backwards")
    return LeaderPreview(times_s, positions_m, speeds_m_s, bounds_m)
