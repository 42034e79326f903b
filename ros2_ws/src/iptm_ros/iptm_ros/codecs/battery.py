"""The battery as a message, and as its bytes: of those, a tick changes the numbers only."""

from __future__ import annotations

import struct
from functools import lru_cache

from iptm_core.state import BatteryReading
from iptm_core.units import CELSIUS_ZERO_K
from iptm_ros.codecs.cdr import FRAME_AT, aligned, put_stamp, serialized
from iptm_ros.codecs.time import ns_from_s, time_from_s
from iptm_ros.message_types import BatteryState
from iptm_ros.topics import PACK_FRAME, frame_in

_FLOATS, _COUNT_BYTES = struct.Struct("<7f"), 4


def encode_battery(reading: BatteryReading) -> BatteryState:
    """Return the pack's terminal values, the current with the sign of ROS."""
    current_a = -float(reading.pack_current_a)
    temperatures_c = [float(t) - CELSIUS_ZERO_K for t in reading.cell_temperatures_k]
    message = BatteryState(
        voltage=float(reading.pack_voltage_v),
        current=current_a,
        temperature=sum(temperatures_c) / len(temperatures_c),
        charge=float(reading.charge_ah),
        capacity=float(reading.capacity_ah),
        design_capacity=float(reading.design_capacity_ah),
        percentage=float(reading.charge_ah / reading.capacity_ah),
        power_supply_status=_supply_status(current_a),
        power_supply_health=BatteryState.POWER_SUPPLY_HEALTH_GOOD,
        power_supply_technology=BatteryState.POWER_SUPPLY_TECHNOLOGY_LION,
        present=True,
        cell_voltage=[float(v) for v in reading.cell_voltages_v],
        cell_temperature=temperatures_c,
        location=PACK_FRAME,
    )
    message.header.stamp = time_from_s(reading.time_s)
    message.header.frame_id = PACK_FRAME
    return message


def _supply_status(ros_current_a: float) -> int:
    if ros_current_a < 0.0:
        return int(BatteryState.POWER_SUPPLY_STATUS_DISCHARGING)
    if ros_current_a > 0.0:
        return int(BatteryState.POWER_SUPPLY_STATUS_CHARGING)
    return int(BatteryState.POWER_SUPPLY_STATUS_NOT_CHARGING)


def battery_bytes(reading: BatteryReading, prefix: str) -> bytes:
    """Return the bytes of `encode_battery`, its frame with the prefix of a vehicle."""
    current_a = -float(reading.pack_current_a)
    temperatures_c = [float(t) - CELSIUS_ZERO_K for t in reading.cell_temperatures_k]
    count = len(temperatures_c)
    frame = frame_in(prefix, PACK_FRAME)
    data = bytearray(_form(frame, count, len(reading.cell_voltages_v)))
    put_stamp(data, ns_from_s(reading.time_s))
    at = aligned(FRAME_AT + len(frame) + 1, 4)
    _FLOATS.pack_into(
        data,
        at,
        reading.pack_voltage_v,
        sum(temperatures_c) / count,
        current_a,
        reading.charge_ah,
        reading.capacity_ah,
        reading.design_capacity_ah,
        reading.charge_ah / reading.capacity_ah,
    )
    data[at + _FLOATS.size] = _supply_status(current_a)
    at += _FLOATS.size + 4  # status, health, technology and presence, a byte each
    for values in (reading.cell_voltages_v, temperatures_c):
        at += _COUNT_BYTES
        struct.pack_into(f"<{len(values)}f", data, at, *values)
        at += 4 * len(values)
    return bytes(data)


@lru_cache(maxsize=16)
def _form(frame: str, temperatures: int, voltages: int) -> bytes:
    cells = (0.0,) * voltages, (0.0,) * temperatures
    message = encode_battery(BatteryReading(0.0, 0.0, 0.0, *cells, 0.0, 1.0, 1.0))
    message.header.frame_id = frame
    return serialized(message)
