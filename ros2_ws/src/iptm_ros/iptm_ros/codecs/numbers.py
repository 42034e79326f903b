"""Stamp and numbers of the suite's own messages straight from their bytes.

Building a `nav_msgs/Odometry` of which two numbers count takes 45 us, reading them 1 us. Bytes of another
form (names in another order, further values, another byte order) are left to the decoder of their type.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import lru_cache
from typing import final

from iptm_core.state import NS_PER_S
from iptm_ros.message_types import JointState, Odometry
from iptm_ros.topics import TOPICS, Topic

_ENCAPSULATION = b"\x00\x01\x00\x00"
_LENGTH = struct.Struct("<I")
_STAMP_AND_LENGTH = struct.Struct("<iII")
_FRAME_AT = 16
_FROM_POSE_TO_SPEED = 8 * (7 + 36)
_MOTION_BYTES = _FROM_POSE_TO_SPEED + 8 * (6 + 36)
_NO_VELOCITY_NO_EFFORT = bytes(8)


@final
class Numbers:
    """What counts of a message, in its place.

    Attributes:
        stamp_ns: of its header.
        packed: the numbers, float64 each, in the order of the topic table.
    """

    __slots__ = ("packed", "stamp_ns")

    def __init__(self, stamp_ns: int, packed: bytes) -> None:
        self.stamp_ns = stamp_ns
        self.packed = packed

    @property
    def values(self) -> Sequence[float]:
        """The numbers."""
        return struct.unpack(f"<{len(self.packed) // 8}d", self.packed)

    @property
    def header(self) -> Numbers:
        """Has the stamp, as the header of a message does."""
        return self

    @property
    def stamp(self) -> Numbers:
        """Has seconds and nanoseconds, as the stamp of a message does."""
        return self

    @property
    def sec(self) -> int:
        """Whole seconds of the stamp."""
        return self.stamp_ns // NS_PER_S

    @property
    def nanosec(self) -> int:
        """Nanoseconds after the whole seconds."""
        return self.stamp_ns % NS_PER_S


def numbers_of(topic: Topic, data: bytes) -> Numbers | None:
    """Return the numbers of a message; None where its bytes have another form than the suite's."""
    kind = TOPICS[topic].message_type
    if len(data) < _FRAME_AT or data[:4] != _ENCAPSULATION:
        return None
    seconds, nanoseconds, frame_bytes = _STAMP_AND_LENGTH.unpack_from(data, 4)
    frame_end = _FRAME_AT + frame_bytes
    stamp_ns = seconds * NS_PER_S + nanoseconds
    if kind is JointState and topic is not Topic.ROAD_AHEAD:  # its number of values varies
        at = _values_at(topic, frame_bytes)
        end = at + 8 * len(TOPICS[topic].fields)
        if data[end:] == _NO_VELOCITY_NO_EFFORT and _has_names(topic, data[_FRAME_AT - 4 : at]):
            return Numbers(stamp_ns, data[at:end])
    elif kind is Odometry:
        child_at = _aligned(frame_end, 4)
        if child_at + 4 > len(data):
            return None
        child_end = child_at + 4 + _LENGTH.unpack_from(data, child_at)[0]
        at = _aligned(child_end, 8)
        speed_at = at + _FROM_POSE_TO_SPEED
        if len(data) == at + _MOTION_BYTES:
            return Numbers(stamp_ns, data[at : at + 8] + data[speed_at : speed_at + 8])
    return None


@lru_cache(maxsize=64)
def _values_at(topic: Topic, frame_bytes: int) -> int:
    """Return where the values of a `sensor_msgs/JointState` start."""
    at = _aligned(_FRAME_AT + frame_bytes, 4) + 4
    for name in TOPICS[topic].fields:
        at = _aligned(at, 4) + 4 + len(name) + 1
    return _aligned(_aligned(at, 4) + 4, 8)


@lru_cache(maxsize=256)
def _has_names(topic: Topic, start: bytes) -> bool:
    """Return whether the bytes between stamp and values hold the names of a topic, and their number twice.

    Bytes that align the next entry may be anything.
    """
    names, shift = TOPICS[topic].fields, _FRAME_AT - 4
    (length,) = _LENGTH.unpack_from(start)
    at = _aligned(_FRAME_AT + length, 4) - shift
    parts = [_LENGTH.pack(len(names))]
    parts += [_LENGTH.pack(len(name) + 1) + name.encode() + b"\0" for name in names]
    for part in (*parts, parts[0]):
        if not start.startswith(part, at):
            return False
        at = _aligned(at + len(part) + shift, 4) - shift
    return True


def _aligned(at: int, size: int) -> int:
    """Return the next place for a value of a size; the encapsulation does not count."""
    return at + -(at - 4) % size
