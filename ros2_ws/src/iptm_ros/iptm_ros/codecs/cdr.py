"""Serialised messages (CDR, the encoding of DDS): their exact length, and the stamp in their bytes."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, Generic, NoReturn, TypeVar

from iptm_core.errors import MessageError
from iptm_core.state import NS_PER_S
from iptm_ros.codecs.time import parts_of_stamp
from iptm_ros.topics import Topic

ENCAPSULATION = b"\x00\x01\x00\x00"
_STAMP = struct.Struct("<iI")
FRAME_AT = 16
"""Where the frame of a header starts, behind stamp and length."""
_STAMP_AT = 4  # the first field of a clock and of every header, after the encapsulation


Value = TypeVar("Value")


@dataclass(frozen=True)
class Stamped(Generic[Value]):
    """What the bytes of a message hold, in its place, with its stamp in integer nanoseconds."""

    stamp_ns: int
    value: Value


def serialized(message: Any) -> bytes:
    """Return the bytes of a message, none more.

    `rclpy.serialization.serialize_message` returns a buffer whose length is an upper estimate: after empty
    float64 arrays it ends with uninitialised memory, which strict readers refuse. The message is the shortest
    prefix that can be deserialised. That takes a moment per surplus byte, which callers with a fixed layout
    spend once.
    """
    from rclpy.serialization import serialize_message  # noqa: PLC0415  readers of bags do without ROS

    data = bytes(serialize_message(message))
    end = len(data)
    while _is_whole(data[: end - 1], type(message)):
        end -= 1
    return data[:end]


def stamp_ns_of(data: bytes) -> int:
    """Return the stamp of a clock or of a message that starts with a header, from its bytes.

    Raises:
        MessageError: the bytes end before.
    """
    least = _STAMP_AT + _STAMP.size
    if len(data) < least:
        raise MessageError(f"message has {len(data)} bytes; allowed: at least {least}")
    seconds, nanoseconds = _STAMP.unpack_from(data, _STAMP_AT)
    return int(seconds) * NS_PER_S + int(nanoseconds)


def put_stamp(data: bytearray, stamp_ns: int) -> None:
    """Write the stamp of a message that starts with a header into its bytes."""
    _STAMP.pack_into(data, _STAMP_AT, *parts_of_stamp(stamp_ns))


def encode_clock(time_ns: int) -> bytes:
    """Return the bytes of a `rosgraph_msgs/Clock`."""
    return ENCAPSULATION + _STAMP.pack(*parts_of_stamp(time_ns))


def encode_float64(value: float) -> bytes:
    """Return the bytes of a `std_msgs/Float64`."""
    return ENCAPSULATION + struct.pack("<d", value)


class Writer:
    """Builds the bytes of a message that starts with a header. Bytes that align the next value are zero.

    Attributes:
        data: the bytes so far, none more.
    """

    def __init__(self, frame: str) -> None:
        self.data = bytearray(ENCAPSULATION)
        self.put("I", 0, 0)
        self.put_text(frame)

    def put(self, kind: str, *values: float) -> None:
        """Append values of a kind of `struct`."""
        at = len(self.data)
        self.data += bytes(aligned(at, struct.calcsize(kind)) - at)
        self.data += struct.pack(f"<{len(values)}{kind}", *values)

    def put_text(self, text: str) -> None:
        """Append a text."""
        coded = text.encode() + b"\0"
        self.put("I", len(coded))
        self.data += coded


def aligned(at: int, size: int) -> int:
    """Return the next place for a value of a size; the encapsulation does not count."""
    return at + -(at - _STAMP_AT) % size


def _is_whole(data: bytes, message_type: type[Any]) -> bool:
    """Return whether bytes hold all fields of a message."""
    from rclpy.serialization import deserialize_message  # noqa: PLC0415  as above

    try:
        deserialize_message(data, message_type)
    except Exception:  # noqa: BLE001  the binding raises error types of its own
        return False
    return True


def reject(topic: Topic, reason: str) -> NoReturn:
    """Raise the error of a message that breaks the promise of its topic."""
    raise MessageError(f"{topic.value}: {reason}")
