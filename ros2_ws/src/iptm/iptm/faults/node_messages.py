"""Bytes of single messages under faults: other stamps, other content of a part of the state."""

from __future__ import annotations

import math
import operator
import struct
from collections.abc import Iterable
from dataclasses import fields
from typing import Any

from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Temperature

from iptm.faults.fault import Fault
from iptm.faults.signals import faulty_state
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import NS_PER_S, VehicleState
from iptm_ros.codecs import serialized, stamp_ns_of
from iptm_ros.topics import Topic

_STAMP = struct.Struct("<iI")
_STAMP_OFFSET = 4  # behind the CDR prefix: first field of a clock and of every header
_MAX_S = 2**31 - 1


class _Content:
    """The state attributes in one message type, with their fields."""

    def __init__(self, message_type: type[Any], offset: float = 0.0, **places: str) -> None:
        self._message_type = message_type
        self._offset = offset
        self._places = places

    def changed(self, faults: Iterable[Fault], stamp_ns: int, data: bytes) -> bytes:
        """Return a message with faults applied; the same bytes object if they change nothing."""
        message = deserialize_message(data, self._message_type)
        held = {
            name: operator.attrgetter(place)(message) + self._offset
            for name, place in self._places.items()
        }
        faulty = faulty_state(faults, stamp_ns, VehicleState(**{**_UNKNOWN, **held}))
        changed = [name for name, value in held.items() if getattr(faulty, name) != value]
        for name in changed:
            parent, _, leaf = self._places[name].rpartition(".")
            owner = operator.attrgetter(parent)(message) if parent else message
            setattr(owner, leaf, float(getattr(faulty, name)) - self._offset)
        return serialized(message) if changed else data


_UNKNOWN = dict.fromkeys((item.name for item in fields(VehicleState)), math.nan)
_CONTENT = {
    Topic.PLANT_ODOMETRY: _Content(
        Odometry, position_m="pose.pose.position.x", speed_m_s="twist.twist.linear.x"
    ),
    Topic.PLANT_ACCELERATION: _Content(AccelStamped, acceleration_m_s2="accel.linear.x"),
    Topic.PLANT_CELL_1_TEMPERATURE: _Content(
        Temperature, CELSIUS_ZERO_K, cell_1_temperature_k="temperature"
    ),
    Topic.PLANT_CELL_N_TEMPERATURE: _Content(
        Temperature, CELSIUS_ZERO_K, cell_n_temperature_k="temperature"
    ),
}


def with_stamp(data: bytes, stamp_ns: int) -> bytes:
    """Return a clock or a message that starts with a header with another stamp, held within what fits."""
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    changed = bytearray(data)
    _STAMP.pack_into(changed, _STAMP_OFFSET, min(max(seconds, -_MAX_S), _MAX_S), nanoseconds)
    return bytes(changed)


def changed_state_message(
    faults: Iterable[Fault], topic: Topic, stamp_ns: int, data: bytes
) -> bytes:
    """Return a state message with faults applied; the same bytes object if none hits it."""
    content = _CONTENT.get(topic)
    hitting = [fault for fault in faults if fault.spec.effect is not None and fault.hits(stamp_ns)]
    if content is None or not hitting:
        return data
    return content.changed(hitting, stamp_ns, data)


def with_stamp_of(message: Odometry, data: bytes) -> bytes:
    """Return a message as bytes, with the exact stamp of the one that it replaces."""
    return with_stamp(serialized(message), stamp_ns_of(data))
