"""Bytes of single messages under faults: other stamps, other content of a part of the state."""

from __future__ import annotations

import math
import struct
from dataclasses import fields

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from iptm.faults.signals import StateFaults
from iptm_core.state import NS_PER_S, VehicleState
from iptm_ros.codecs import serialized

_STAMP = struct.Struct("<iI")
_STAMP_OFFSET = 4  # behind the CDR prefix: first field of a clock and of every header
_MAX_S = 2**31 - 1
_OF_A_STATE = frozenset(item.name for item in fields(VehicleState)) - {"time_s"}
_UNKNOWN = dict.fromkeys((item.name for item in fields(VehicleState)), math.nan)


def with_stamp(data: bytes, stamp_ns: int) -> bytes:
    """Return a clock or a message that starts with a header with another stamp, held within what fits."""
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    changed = bytearray(data)
    _STAMP.pack_into(changed, _STAMP_OFFSET, min(max(seconds, -_MAX_S), _MAX_S), nanoseconds)
    return bytes(changed)


def changed_state_message(faults: StateFaults, stamp_ns: int, data: bytes) -> bytes:
    """Return a state message with faults applied; the same bytes object if they change nothing."""
    if not faults.hits(stamp_ns):
        return data
    message = deserialize_message(data, JointState)
    places = {name: place for place, name in enumerate(message.name) if name in _OF_A_STATE}
    held = {name: message.position[place] for name, place in places.items()}
    faulty = faults.apply(stamp_ns, VehicleState(**{**_UNKNOWN, **held}))
    changed = [name for name, value in held.items() if getattr(faulty, name) != value]
    for name in changed:
        message.position[places[name]] = float(getattr(faulty, name))
    return serialized(message) if changed else data
