"""Messages between vehicle and controller: state, tracks, datagrams, command, record, battery."""

from __future__ import annotations

import math
import struct
from array import array
from collections.abc import Collection
from enum import IntEnum
from functools import lru_cache
from typing import TypeVar

import numpy as np

from iptm_core.decision_record import DecisionRecord, Rung, SolveStatus
from iptm_core.lead_track import RangeTrack
from iptm_core.state import (
    BatteryReading,
    Command,
    IntervalPowers,
    PlantObservation,
    SafetyRecord,
    VehicleState,
)
from iptm_core.units import CELSIUS_ZERO_K
from iptm_ros.codecs.cdr import (
    FRAME_AT,
    aligned,
    ns_from_s,
    ns_from_time,
    put_stamp,
    reject,
    s_from_ns,
    serialized,
    time_from_ns,
    time_from_s,
)
from iptm_ros.codecs.motion import check_point_step
from iptm_ros.codecs.numbers import (
    LAYOUTS,
    Numbers,
    StampedNumbers,
    encoder,
    read_numbers,
    stamp_of,
)
from iptm_ros.codecs.repeated import numbers_of_state
from iptm_ros.message_types import (
    BatteryState,
    JointState,
    MultiArrayDimension,
    MultiArrayLayout,
    PointCloud2,
    PointField,
    UInt8MultiArray,
)
from iptm_ros.topics import EGO_FRAME, PACK_FRAME, TOPICS, Topic, frame_in


def encode_observation(
    observation: PlantObservation, prefix: str, topics: Collection[Topic] | None = None
) -> dict[Topic, bytes]:
    """Return the bytes of what the plant observes but for the battery, with the frames of a vehicle.

    The state has everything; the other messages repeat parts of it for other tools.

    Args:
        topics: those that are wanted besides the state, None for all.
    """
    state, powers, safety = observation.state, observation.powers, observation.safety
    inlet_k, outlet_k = (
        observation.coolant_inlet_temperature_k,
        observation.coolant_outlet_temperature_k,
    )
    numbers = (
        state.position_m,
        state.speed_m_s,
        state.acceleration_m_s2,
        state.compressor_power_w,
        state.cell_1_temperature_k,
        state.cell_n_temperature_k,
        state.cell_1_capacity_loss,
        state.cell_n_capacity_loss,
        state.state_of_charge,
        powers.traction_power_w,
        powers.auxiliary_power_w,
        powers.battery_power_w,
        powers.chiller_heat_w,
        inlet_k,
        outlet_k,
        safety.service_braking_s,
        safety.smallest_gap_m,
        safety.brake_share,
        powers.battery_heat_w,
        safety.command_source,
    )
    wanted = numbers_of_state(numbers) if topics is None or topics else {}
    if topics is not None:
        wanted = {topic: wanted[topic] for topic in topics}
    wanted[Topic.PLANT_STATE] = numbers
    stamp_ns = ns_from_s(state.time_s)
    return {topic: LAYOUTS[topic].data(stamp_ns, wanted[topic], prefix) for topic in wanted}


def decode_observation(message: JointState) -> PlantObservation:
    """Return what the plant observes; values that it does not publish are NaN, its safety record is empty."""
    motion_and_pack = read_numbers(Topic.PLANT_STATE, message)
    *state, charge, traction_w, auxiliary_w, battery_w, chiller_w = motion_and_pack[:13]
    inlet_k, outlet_k, braking_s, smallest_gap_m, brake_share, heat_w, source = motion_and_pack[13:]
    time_s = s_from_ns(stamp_of(message))
    has_monitor = not math.isnan(braking_s)
    return PlantObservation(
        state=VehicleState(time_s, *state, state_of_charge=charge),
        powers=IntervalPowers(traction_w, state[3], auxiliary_w, battery_w, chiller_w, heat_w),
        coolant_inlet_temperature_k=inlet_k,
        coolant_outlet_temperature_k=outlet_k,
        safety=SafetyRecord(braking_s, smallest_gap_m, brake_share, source)
        if has_monitor
        else SafetyRecord(command_source=source),
    )


def decode_motion(message: JointState | Numbers) -> tuple[int, float, float]:
    """Return stamp (ns), position (m) and speed (m/s) of a plant's state; NaN where they are missing."""
    if type(message) is Numbers:
        position_m, speed_m_s = message.values[:2]
        return message.stamp_ns, position_m, speed_m_s
    values = dict(zip(message.name, message.position, strict=False))
    return (
        ns_from_time(message.header.stamp),
        float(values.get("position_m", math.nan)),
        float(values.get("speed_m_s", math.nan)),
    )


_NAMES = list(TOPICS[Topic.RANGE_TRACKS].fields)
_MOST_TRACKS = 1000
_FORMATS = {PointField.FLOAT32: ("f4", 4), PointField.FLOAT64: ("f8", 8)}


def encode_tracks(tracks: tuple[RangeTrack, ...], stamp_ns: int, prefix: str = "") -> PointCloud2:
    """Return tracks at the instant of their measurement, the frame with the prefix of a vehicle."""
    step = 8 * len(_NAMES)
    values = np.array([[t.gap_m, t.left_m, t.relative_speed_m_s] for t in tracks], "<f8")
    message = PointCloud2(
        height=1,
        width=len(tracks),
        fields=[
            PointField(name=name, offset=8 * place, datatype=PointField.FLOAT64, count=1)
            for place, name in enumerate(_NAMES)
        ],
        is_bigendian=False,
        point_step=step,
        row_step=step * len(tracks),
        data=array("B", values.tobytes()),
        is_dense=True,
    )
    message.header.stamp = time_from_ns(stamp_ns)
    message.header.frame_id = frame_in(prefix, EGO_FRAME)
    return message


def decode_tracks(message: PointCloud2) -> tuple[int, tuple[RangeTrack, ...]]:
    """Return the stamp (ns) and the tracks; points with a value that is not finite are left out.

    Raises:
        MessageError: a field is missing or no number, or the sizes contradict each other.
    """
    topic, places = Topic.RANGE_TRACKS, {field.name: field for field in message.fields}
    count, step = message.width * message.height, message.point_step
    check_point_step(topic, step)
    formats, order = [], ">" if message.is_bigendian else "<"
    for name in _NAMES:
        field = places.get(name)
        if field is None:
            reject(topic, f"missing {name}; got {', '.join(places) or 'no fields'}")
        form, size = _FORMATS.get(field.datatype, ("", 0))
        if not form or not 0 <= field.offset <= step - size:
            reject(
                topic,
                f"field {name} has datatype {field.datatype} at {field.offset} of {step} bytes; allowed: "
                "float32 or float64 inside a point",
            )
        formats.append(order + form)
    if len(message.data) != count * step or count > _MOST_TRACKS:
        reject(
            topic,
            f"{len(message.data)} bytes for {count} points of {step}; allowed: up to {_MOST_TRACKS} points",
        )
    offsets = [int(places[name].offset) for name in _NAMES]
    row = np.dtype({"names": _NAMES, "formats": formats, "offsets": offsets, "itemsize": step})
    rows = np.frombuffer(message.data, row, count)
    values = np.column_stack([rows[name].astype(np.float64) for name in _NAMES])
    sound = values[np.isfinite(values).all(axis=1)].tolist()
    return ns_from_time(message.header.stamp), tuple(RangeTrack(*each) for each in sound)


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


E = TypeVar("E", bound=IntEnum)


@encoder(Topic.COMMAND)
def encode_command(stamp_ns: int, command: Command) -> StampedNumbers:
    """Return a decision, stamped with the state it answers (acceleration m/s^2, power W)."""
    return stamp_ns, (command.acceleration_m_s2, command.compressor_power_w)


def decode_command(message: JointState) -> tuple[int, Command]:
    """Return the stamp (ns) of the state that is answered, and the decision.

    Physical bounds are not checked here: the plant clips, and a sign error must stay visible.
    """
    acceleration_m_s2, compressor_power_w = read_numbers(Topic.COMMAND, message)
    return stamp_of(message), Command(acceleration_m_s2, compressor_power_w)


@encoder(Topic.SOLVE)
def encode_decision_record(stamp_ns: int, record: DecisionRecord) -> StampedNumbers:
    """Return the record of a decision, stamped like the decision."""
    return stamp_ns, tuple(vars(record).values())


def decode_decision_record(message: JointState) -> DecisionRecord:
    """Return the record of a decision."""
    numbers = dict(zip(TOPICS[Topic.SOLVE].fields, read_numbers(Topic.SOLVE, message), strict=True))
    return DecisionRecord(
        status=_enumerated(SolveStatus, "status_code", numbers.pop("status_code")),
        iterations=int(numbers.pop("iterations")),
        rung=_enumerated(Rung, "fallback_rung", numbers.pop("fallback_rung")),
        limiter_active=bool(numbers.pop("limiter_active")),
        **numbers,
    )


def _enumerated(kind: type[E], name: str, value: float) -> E:
    for entry in kind:
        if entry.value == value:
            return entry
    allowed = ", ".join(f"{entry.value} ({entry.name.lower()})" for entry in kind)
    return reject(Topic.SOLVE, f"{name} is {value:g}; allowed: {allowed}")


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
