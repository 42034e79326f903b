"""Serialised messages (CDR, the encoding of DDS): their exact length, and the stamp in their bytes."""

from __future__ import annotations

import struct
from typing import Any, NoReturn

from iptm_core.errors import MessageError
from iptm_core.state import NS_PER_S
from iptm_ros.codecs.time import time_from_ns
from iptm_ros.topics import Topic

_STAMP = struct.Struct("<iI")
_STAMP_AT = 4  # the first field of a clock and of every header, after the encapsulation


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
    stamp = time_from_ns(stamp_ns)
    _STAMP.pack_into(data, _STAMP_AT, stamp.sec, stamp.nanosec)


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
