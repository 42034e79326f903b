"""Serialised messages (CDR, the encoding of DDS): their exact length, and the stamp in their bytes.

Stamps are trip time in seconds <-> integer nanoseconds <-> builtin_interfaces messages. Integer nanoseconds
are the key by which messages of one tick are matched. A multiple of 1 ms survives the round trip float ->
nanoseconds -> float unchanged, because both directions round to the nearest representable value; this holds
for trips of up to 26 days (2^51 ns).
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any, Generic, NoReturn, TypeVar

from iptm_core.errors import MessageError
from iptm_core.state import NS_PER_S
from iptm_ros.message_types import Time
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


_MAX_STAMP_NS = 2**31 * NS_PER_S - 1


def is_stamp(stamp_ns: int) -> bool:
    """Return whether a message can carry a stamp, so that it can be answered with the same."""
    return 0 <= stamp_ns <= _MAX_STAMP_NS


def ns_from_s(time_s: float) -> int:
    """Return seconds as integer nanoseconds, rounded to the nearest."""
    if not math.isfinite(time_s):
        raise MessageError(f"time is {time_s} s; allowed: a finite number")
    return round(time_s * 1e9)


def s_from_ns(time_ns: int) -> float:
    """Return integer nanoseconds as seconds."""
    return time_ns / NS_PER_S


def parts_of_stamp(stamp_ns: int) -> tuple[int, int]:
    """Return seconds and nanoseconds of a stamp; `MessageError` where no message can carry it."""
    if not is_stamp(stamp_ns):
        raise MessageError(f"stamp is {stamp_ns} ns; allowed: 0 to {_MAX_STAMP_NS}")
    return divmod(stamp_ns, NS_PER_S)


def time_from_ns(stamp_ns: int) -> Time:
    """Return a stamp message, see `parts_of_stamp`."""
    seconds, nanoseconds = parts_of_stamp(stamp_ns)
    return Time(sec=seconds, nanosec=nanoseconds)


def ns_from_time(message: Time) -> int:
    """Return a stamp message as integer nanoseconds, the key for matching.

    Returned as sent, even if it is not a trip time; see `is_stamp`.
    """
    return message.sec * NS_PER_S + message.nanosec


def time_from_s(time_s: float) -> Time:
    """Return a stamp message for a trip time in seconds (see `ns_from_s`, `time_from_ns`)."""
    return time_from_ns(ns_from_s(time_s))
