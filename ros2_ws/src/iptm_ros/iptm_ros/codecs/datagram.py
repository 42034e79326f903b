"""A datagram as the radio delivered it, with the time at which it did."""

from __future__ import annotations

from array import array

from iptm_ros.codecs.numbers import reject
from iptm_ros.message_types import (
    MultiArrayDimension,
    MultiArrayLayout,
    UInt8MultiArray,
)
from iptm_ros.topics import Topic


def encode_raw_datagram(datagram: bytes, received_ns: int) -> UInt8MultiArray:
    """Return a datagram as a message."""
    size = len(datagram)
    dimension = MultiArrayDimension(label=str(received_ns), size=size, stride=size)
    return UInt8MultiArray(layout=MultiArrayLayout(dim=[dimension]), data=array("B", datagram))


def decode_raw_datagram(message: UInt8MultiArray) -> tuple[int, bytes]:
    """Return when a datagram was received (ns of TimestampIts), and its bytes.

    Raises:
        MessageError: the label is not an integer.
    """
    label = message.layout.dim[0].label if message.layout.dim else ""
    try:
        received_ns = int(label)
    except ValueError:
        reject(Topic.DATAGRAMS, f"layout.dim[0].label is {label!r}; allowed: ns of TimestampIts")
    return received_ns, bytes(message.data)
