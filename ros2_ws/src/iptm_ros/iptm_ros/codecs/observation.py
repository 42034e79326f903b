"""What is observed in addition to the state of the vehicle: battery, coolant, powers, and the leader."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import (
    BatteryReading,
    IntervalPowers,
    LeaderState,
    PlantObservation,
    SafetyRecord,
)
from iptm_ros.codecs.numbers import (
    StampedNumbers,
    check_stamps,
    encoder,
    known_state,
    read_numbers,
    reject,
)
from iptm_ros.codecs.time import ns_from_s, ns_from_time, s_from_ns, time_from_s
from iptm_ros.message_types import BatteryState, JointState, Odometry, Temperature
from iptm_ros.topics import OBSERVATION_TOPICS, PACK_FRAME, Topic


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


def _decode_charge(message: BatteryState) -> float:
    """Return the state of charge, 0 to 1; NaN where it was not measured."""
    charge = float(message.percentage)
    if math.isinf(charge):
        reject(Topic.PLANT_BATTERY, f"percentage is {charge}; allowed: a finite number")
    return charge


@encoder(Topic.LEADER)
def encode_leader(state: LeaderState, stamp_ns: int | None = None) -> StampedNumbers:
    """Return the leader's position (m) and speed (m/s), at a stamp where its time is not exact enough."""
    if stamp_ns is None:
        stamp_ns = ns_from_s(state.time_s)
    return stamp_ns, (state.position_m, state.speed_m_s)


def decode_leader(message: Odometry) -> LeaderState:
    """Return the leader's state."""
    numbers = read_numbers(Topic.LEADER, message)
    return LeaderState(s_from_ns(ns_from_time(message.header.stamp)), *numbers)


def decode_temperature(topic: Topic, message: Temperature) -> float:
    """Return a temperature in kelvin."""
    return read_numbers(topic, message)[0]


def decode_powers(message: JointState) -> IntervalPowers:
    """Return the mean powers of the interval that ended at the stamp (W)."""
    return IntervalPowers(*read_numbers(Topic.PLANT_POWERS, message))


def decode_safety(message: JointState) -> SafetyRecord:
    """Return what the safety monitor did over the interval that ended at the stamp."""
    return SafetyRecord(*read_numbers(Topic.PLANT_SAFETY, message))


def decode_observation(messages: Mapping[Topic, Any]) -> PlantObservation:
    """Put an observation of the plant together from the messages of one stamp.

    Args:
        messages: those of `OBSERVATION_TOPICS`, at least the odometry; values of missing ones are NaN.
            Without one of `Topic.PLANT_SAFETY` no service braking is known.
    """
    check_stamps((topic for topic in OBSERVATION_TOPICS if topic in messages), messages)
    state = known_state(messages)
    if Topic.PLANT_BATTERY in messages:
        state = replace(state, state_of_charge=_decode_charge(messages[Topic.PLANT_BATTERY]))
    powers, safety = messages.get(Topic.PLANT_POWERS), messages.get(Topic.PLANT_SAFETY)
    return PlantObservation(
        state=state,
        powers=IntervalPowers(*[math.nan] * 5) if powers is None else decode_powers(powers),
        coolant_inlet_temperature_k=_temperature(Topic.PLANT_COOLANT_INLET_TEMPERATURE, messages),
        coolant_outlet_temperature_k=_temperature(Topic.PLANT_COOLANT_OUTLET_TEMPERATURE, messages),
        safety=SafetyRecord() if safety is None else decode_safety(safety),
    )


def _temperature(topic: Topic, messages: Mapping[Topic, Any]) -> float:
    message = messages.get(topic)
    return math.nan if message is None else decode_temperature(topic, message)
