"""What is observed: the state of vehicle and pack, its parts as other tools take them, and the leader."""

from __future__ import annotations

import math
from collections.abc import Sequence

from iptm_core.state import (
    BatteryReading,
    IntervalPowers,
    LeaderState,
    PlantObservation,
    SafetyRecord,
    VehicleState,
)
from iptm_core.units import CELSIUS_ZERO_K
from iptm_ros.codecs.numbers import LAYOUTS, StampedNumbers, encoder, read_numbers
from iptm_ros.codecs.time import ns_from_s, ns_from_time, s_from_ns, time_from_s
from iptm_ros.message_types import BatteryState, JointState, Odometry
from iptm_ros.topics import PACK_FRAME, Topic


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


def encode_observation(observation: PlantObservation, prefix: str) -> dict[Topic, bytes]:
    """Return the bytes of what the plant observes but for the battery, with the frames of a vehicle.

    The state has everything; the other messages repeat parts of it for other tools.
    """
    state, powers, safety = observation.state, observation.powers, observation.safety
    inlet_k, outlet_k = (
        observation.coolant_inlet_temperature_k,
        observation.coolant_outlet_temperature_k,
    )
    numbers: dict[Topic, Sequence[float]] = {
        Topic.PLANT_CELL_1_TEMPERATURE: (state.cell_1_temperature_k - CELSIUS_ZERO_K,),
        Topic.PLANT_CELL_N_TEMPERATURE: (state.cell_n_temperature_k - CELSIUS_ZERO_K,),
        Topic.PLANT_COOLANT_INLET_TEMPERATURE: (inlet_k - CELSIUS_ZERO_K,),
        Topic.PLANT_COOLANT_OUTLET_TEMPERATURE: (outlet_k - CELSIUS_ZERO_K,),
        Topic.PLANT_ACCELERATION: (state.acceleration_m_s2,),
        Topic.PLANT_ODOMETRY: (state.position_m, state.speed_m_s),
        Topic.PLANT_STATE: (
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
        ),
    }
    stamp_ns = ns_from_s(state.time_s)
    return {topic: LAYOUTS[topic].data(stamp_ns, numbers[topic], prefix) for topic in numbers}


def decode_observation(message: JointState) -> PlantObservation:
    """Return what the plant observes; values that it does not publish are NaN, its safety record is empty."""
    motion_and_pack = read_numbers(Topic.PLANT_STATE, message)
    *state, charge, traction_w, auxiliary_w, battery_w, chiller_w = motion_and_pack[:13]
    inlet_k, outlet_k, braking_s, smallest_gap_m, brake_share, heat_w, source = motion_and_pack[13:]
    time_s = s_from_ns(ns_from_time(message.header.stamp))
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


def decode_motion(message: JointState) -> tuple[int, float, float]:
    """Return stamp (ns), position (m) and speed (m/s) of a plant's state; NaN where they are missing."""
    values = dict(zip(message.name, message.position, strict=False))
    return (
        ns_from_time(message.header.stamp),
        float(values.get("position_m", math.nan)),
        float(values.get("speed_m_s", math.nan)),
    )
