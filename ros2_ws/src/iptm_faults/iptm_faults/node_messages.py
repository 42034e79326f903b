"""Bytes of single messages under faults: other stamps, other content of a part of the state."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable

from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Temperature

from iptm_core.parameters.units import CELSIUS_ZERO_K
from iptm_core.state import VehicleState
from iptm_core.trip_time import NS_PER_S
from iptm_faults.fault import Fault
from iptm_faults.kinds import FaultKind
from iptm_faults.signals import told_state
from iptm_interfaces.codecs import serialized
from iptm_interfaces.topics import Topic

_STAMP = struct.Struct("<iI")
_STAMP_OFFSET = 4  # behind the CDR prefix: first field of a clock and of every header
_MAX_S = 2**31 - 1
_CHANGES = {
    FaultKind.STATE_NAN: (Topic.PLANT_ODOMETRY,),
    FaultKind.STATE_JUMPING: (Topic.PLANT_ODOMETRY,),
    FaultKind.STATE_OVERHEATED: (
        Topic.PLANT_CELL_1_TEMPERATURE,
        Topic.PLANT_CELL_N_TEMPERATURE,
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
    """Return what faults make of one message of the state; the very same bytes where none hits it.

    Args:
        faults: faults of the state.
        topic: what the message tells.
        stamp_ns: its stamp.
        data: the message.
    """
    hitting = [
        fault for fault in faults if topic in _CHANGES.get(fault.kind, ()) and fault.hits(stamp_ns)
    ]
    if not hitting:
        return data
    if topic is Topic.PLANT_ODOMETRY:
        odometry = deserialize_message(data, Odometry)
        motion = odometry.pose.pose.position, odometry.twist.twist.linear
        told = told_state(hitting, stamp_ns, _state(motion[0].x, motion[1].x, math.nan))
        motion[0].x, motion[1].x = float(told.position_m), float(told.speed_m_s)
        return serialized(odometry)
    measured = deserialize_message(data, Temperature)
    told = told_state(hitting, stamp_ns, _state(0.0, 0.0, measured.temperature + CELSIUS_ZERO_K))
    measured.temperature = float(told.cell_1_temperature_k - CELSIUS_ZERO_K)
    return serialized(measured)


def _state(position_m: float, speed_m_s: float, temperature_k: float) -> VehicleState:
    """Return a state of which only what one message tells is known."""
    rest = math.nan
    return VehicleState(
        rest, position_m, speed_m_s, rest, rest, temperature_k, temperature_k, rest, rest
    )
