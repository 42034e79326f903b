"""Motion and thermal state of the ego vehicle, and motion of the leader.

The ego vehicle's state travels in the messages of one stamp that `STATE_TOPICS` lists; `decode_vehicle_state`
puts them together again. Temperatures are degrees Celsius on the wire, so kelvin values come back within one
rounding step (6e-14 K).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import nan
from typing import Any

from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import (
    SPEED_AT_REST_M_S,
    IntervalPowers,
    LeaderState,
    PlantObservation,
    SafetyRecord,
    VehicleState,
)
from iptm_interfaces.codecs._checks import finite, not_negative, reject
from iptm_interfaces.codecs.battery import decode_charge, decode_powers
from iptm_interfaces.codecs.fixed_layout import Numbers, encoder
from iptm_interfaces.codecs.named_values import decode_named_values, named_values
from iptm_interfaces.codecs.time import ns_from_s, ns_from_time, s_from_ns
from iptm_interfaces.message_types import (
    AccelStamped,
    Header,
    JointState,
    Odometry,
    Temperature,
)
from iptm_interfaces.topics import (
    EGO_FRAME,
    LEADER_FRAME,
    OBSERVATION_TOPICS,
    PACK_FRAME,
    ROAD_FRAME,
    STATE_TOPICS,
    Topic,
)


def _decode_motion(topic: Topic, message: Odometry) -> tuple[float, float]:
    position_m = finite(topic, "position", message.pose.pose.position.x)
    speed_m_s = finite(topic, "speed", message.twist.twist.linear.x)
    if speed_m_s < SPEED_AT_REST_M_S:
        reject(topic, f"speed is {speed_m_s}; allowed: at least {SPEED_AT_REST_M_S:g} m/s")
    return position_m, speed_m_s


_MOTION = ("pose.pose.position.x", "twist.twist.linear.x")


def _motion(body: str) -> Odometry:
    return Odometry(header=Header(frame_id=ROAD_FRAME), child_frame_id=body)


@encoder(lambda: _motion(EGO_FRAME), *_MOTION)
def encode_ego_odometry(state: VehicleState) -> Numbers:
    """Return the ego vehicle's position (m) and speed (m/s)."""
    return ns_from_s(state.time_s), (state.position_m, state.speed_m_s)


@encoder(lambda: _motion(LEADER_FRAME), *_MOTION)
def encode_leader(state: LeaderState, stamp_ns: int | None = None) -> Numbers:
    """Return the leader's position (m) and speed (m/s), at a stamp where its time is not exact enough."""
    if stamp_ns is None:
        stamp_ns = ns_from_s(state.time_s)
    return stamp_ns, (state.position_m, state.speed_m_s)


def decode_leader(message: Odometry) -> LeaderState:
    """Return the leader's state.

    Raises:
        MessageError: position or speed is not finite, or the vehicle drives backwards.
    """
    position_m, speed_m_s = _decode_motion(Topic.LEADER, message)
    return LeaderState(s_from_ns(ns_from_time(message.header.stamp)), position_m, speed_m_s)


@encoder(lambda: AccelStamped(header=Header(frame_id=EGO_FRAME)), "accel.linear.x")
def encode_acceleration(state: VehicleState) -> Numbers:
    """Return the acceleration actuated over the interval that ended at the stamp (m/s^2)."""
    return ns_from_s(state.time_s), (state.acceleration_m_s2,)


@encoder(lambda: Temperature(header=Header(frame_id=PACK_FRAME)), "temperature")
def encode_temperature(time_s: float, temperature_k: float) -> Numbers:
    """Return a temperature; kelvin in, degrees Celsius on the wire. Its variance is unknown (0)."""
    return ns_from_s(time_s), (float(temperature_k) - CELSIUS_ZERO_K,)


def decode_temperature(topic: Topic, message: Temperature) -> float:
    """Return a temperature in kelvin.

    Raises:
        MessageError: it is not finite or below absolute zero.
    """
    temperature_k: float = message.temperature + CELSIUS_ZERO_K
    return not_negative(topic, "absolute temperature", temperature_k)


@named_values(Topic.PLANT_CAPACITY_LOSS)
def encode_capacity_loss(state: VehicleState) -> Numbers:
    """Return the capacity losses of cell 1 and cell N_c (fractions of nominal)."""
    return ns_from_s(state.time_s), (state.cell_1_capacity_loss, state.cell_n_capacity_loss)


def decode_capacity_loss(message: JointState) -> tuple[float, float]:
    """Return the capacity losses of cell 1 and cell N_c (fractions of nominal).

    Raises:
        MessageError: a loss is missing, not finite or outside 0 to 1.
    """
    cell_1, cell_n = decode_named_values(Topic.PLANT_CAPACITY_LOSS, message)
    for name, value in (("cell_1_capacity_loss", cell_1), ("cell_n_capacity_loss", cell_n)):
        if not 0.0 <= value <= 1.0:
            reject(Topic.PLANT_CAPACITY_LOSS, f"{name} is {value}; allowed: 0 to 1")
    return cell_1, cell_n


@named_values(Topic.PLANT_SAFETY)
def encode_safety(time_s: float, record: SafetyRecord) -> Numbers:
    """Return what the safety monitor did over the interval that ended at a time."""
    values = (record.service_braking_s, record.smallest_gap_m, record.brake_share)
    return ns_from_s(time_s), values


def decode_safety(message: JointState) -> SafetyRecord:
    """Return what the safety monitor did over the interval that ended at the stamp.

    Raises:
        MessageError: a value is missing, or the time or the share not finite or out of range.
    """
    record = SafetyRecord(
        *decode_named_values(Topic.PLANT_SAFETY, message, frozenset({"smallest_gap_m"}))
    )
    not_negative(Topic.PLANT_SAFETY, "service_braking_s", record.service_braking_s)
    if not 0.0 <= record.brake_share <= 1.0:
        reject(Topic.PLANT_SAFETY, f"brake_share is {record.brake_share}; allowed: 0 to 1")
    return record


def decode_vehicle_state(messages: Mapping[Topic, Any]) -> VehicleState:
    """Put the ego vehicle's state together from the messages of one stamp.

    Args:
        messages: at least those of `STATE_TOPICS`.

    Raises:
        MessageError: the stamps differ or one of the messages breaks its promise.
    """
    _common_stamp_ns(STATE_TOPICS, messages)
    return _known_state(messages)


def _known_state(messages: Mapping[Topic, Any]) -> VehicleState:
    """Return the state as far as there are messages of it, at least the odometry; the rest is NaN."""
    odometry = messages[Topic.PLANT_ODOMETRY]
    position_m, speed_m_s = _decode_motion(Topic.PLANT_ODOMETRY, odometry)
    acceleration = messages.get(Topic.PLANT_ACCELERATION)
    powers, losses = messages.get(Topic.PLANT_POWERS), messages.get(Topic.PLANT_CAPACITY_LOSS)
    battery = messages.get(Topic.PLANT_BATTERY)
    cell_1_loss, cell_n_loss = (nan, nan) if losses is None else decode_capacity_loss(losses)
    return VehicleState(
        time_s=s_from_ns(ns_from_time(odometry.header.stamp)),
        position_m=position_m,
        speed_m_s=speed_m_s,
        acceleration_m_s2=nan
        if acceleration is None
        else finite(Topic.PLANT_ACCELERATION, "acceleration", acceleration.accel.linear.x),
        compressor_power_w=nan if powers is None else decode_powers(powers).compressor_power_w,
        cell_1_temperature_k=_temperature(Topic.PLANT_CELL_1_TEMPERATURE, messages),
        cell_n_temperature_k=_temperature(Topic.PLANT_CELL_N_TEMPERATURE, messages),
        cell_1_capacity_loss=cell_1_loss,
        cell_n_capacity_loss=cell_n_loss,
        state_of_charge=nan if battery is None else decode_charge(battery),
    )


def decode_observation(messages: Mapping[Topic, Any]) -> PlantObservation:
    """Put an observation of the plant together from the messages of one stamp.

    Args:
        messages: those of `OBSERVATION_TOPICS`, at least the odometry; values of missing ones are NaN.
            Without one of `Topic.PLANT_SAFETY` no service braking is known.

    Raises:
        MessageError: the stamps differ or one of the messages breaks its promise.
    """
    safety, powers = messages.get(Topic.PLANT_SAFETY), messages.get(Topic.PLANT_POWERS)
    _common_stamp_ns((topic for topic in OBSERVATION_TOPICS if topic in messages), messages)
    return PlantObservation(
        state=_known_state(messages),
        powers=IntervalPowers(*[nan] * 5) if powers is None else decode_powers(powers),
        coolant_inlet_temperature_k=_temperature(Topic.PLANT_COOLANT_INLET_TEMPERATURE, messages),
        coolant_outlet_temperature_k=_temperature(Topic.PLANT_COOLANT_OUTLET_TEMPERATURE, messages),
        safety=SafetyRecord() if safety is None else decode_safety(safety),
    )


def _temperature(topic: Topic, messages: Mapping[Topic, Any]) -> float:
    message = messages.get(topic)
    return nan if message is None else decode_temperature(topic, message)


def _common_stamp_ns(topics: Iterable[Topic], messages: Mapping[Topic, Any]) -> int:
    """Return the stamp that all messages share."""
    first, *others = topics
    stamp_ns = ns_from_time(messages[first].header.stamp)
    for topic in others:
        other_ns = ns_from_time(messages[topic].header.stamp)
        if other_ns != stamp_ns:
            reject(
                topic, f"stamp is {other_ns} ns; allowed: {stamp_ns} ns, as that of {first.value}"
            )
    return stamp_ns
