"""State, leader, tracks of a range sensor (our own and foreign ones) and battery on the wire."""

from __future__ import annotations

import dataclasses
import math
from array import array
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import BatteryState, PointCloud2, PointField
from tests.plant_messages import plant_messages

from iptm_core.errors import MessageError
from iptm_core.lead_track import RangeTrack
from iptm_core.state import (
    BatteryReading,
    IntervalPowers,
    LeaderState,
    PlantObservation,
    SafetyRecord,
    VehicleState,
)
from iptm_ros.codecs import (
    decode_leader,
    decode_motion,
    decode_observation,
    decode_tracks,
    encode_battery,
    encode_leader,
    encode_tracks,
)
from iptm_ros.topics import TOPICS, Topic

STATE = VehicleState(
    time_s=12.0,
    position_m=345.6789,
    speed_m_s=7.25,
    acceleration_m_s2=-0.3,
    compressor_power_w=1234.5,
    cell_1_temperature_k=301.25,
    cell_n_temperature_k=303.5,
    cell_1_capacity_loss=0.001 + 1e-12,
    cell_n_capacity_loss=0.001 + 3e-12,
)


numbers = st.floats(-1e6, 1e6)
positive = st.floats(0.0, 1e6)


@given(numbers, positive, numbers, positive, st.floats(200.0, 400.0), st.floats(0.0, 1.0))
def test_the_state_survives_its_message_to_the_last_bit(
    position: float, speed: float, acceleration: float, power: float, kelvin: float, loss: float
) -> None:
    charged = {"state_of_charge": loss}
    state = VehicleState(
        3.0, position, speed, acceleration, power, kelvin, kelvin, loss, loss, **charged
    )
    powers = IntervalPowers(-position, power, speed, acceleration, kelvin, power)
    safety = SafetyRecord(0.1, kelvin, loss)
    message = plant_messages(state, powers, (kelvin, kelvin + 1.0), safety)[Topic.PLANT_STATE]
    assert decode_observation(message) == PlantObservation(
        state, powers, kelvin, kelvin + 1.0, safety
    )
    assert decode_motion(message) == (3 * 10**9, position, speed)


def test_a_plant_may_leave_out_what_it_does_not_know() -> None:
    message = plant_messages(STATE)[Topic.PLANT_STATE]
    names = list(TOPICS[Topic.PLANT_STATE].fields)
    needed = names[: names.index("state_of_charge")]
    pairs = dict(zip(message.name, message.position, strict=True))
    message.name = [*reversed(needed), "of_its_own"]
    message.position = [*(pairs[name] for name in reversed(needed)), 1.0]
    found = decode_observation(message)
    assert replace(found.state, state_of_charge=0.5) == replace(STATE, state_of_charge=0.5)
    assert math.isnan(found.state.state_of_charge)
    assert math.isnan(found.powers.battery_power_w)
    assert found.powers.compressor_power_w == STATE.compressor_power_w
    assert math.isnan(found.coolant_inlet_temperature_k)
    assert str(found.safety) == str(SafetyRecord(command_source=math.nan))
    message.name[0] = "another"
    with pytest.raises(MessageError, match="plant/state: missing cell_n_capacity_loss"):
        decode_observation(message)
    assert math.isnan(decode_motion(type(message)())[1])


def test_frames_and_units_on_the_wire() -> None:
    messages = plant_messages(STATE)
    odometry = messages[Topic.PLANT_ODOMETRY]
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert odometry.pose.pose.orientation.w == 1.0
    assert messages[Topic.PLANT_ACCELERATION].header.frame_id == "base_link"
    assert messages[Topic.PLANT_CELL_1_TEMPERATURE].temperature == pytest.approx(28.1, abs=1e-12)


def test_numpy_scalars_are_sent_as_plain_numbers() -> None:
    single: Any = np.float32(2.5)
    state = dataclasses.replace(STATE, position_m=single, speed_m_s=3)
    odometry = plant_messages(state)[Topic.PLANT_ODOMETRY]
    assert type(odometry.pose.pose.position.x) is float
    assert odometry.pose.pose.position.x == 2.5
    assert odometry.twist.twist.linear.x == 3.0


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"position_m": math.nan}, "position_m is nan; allowed: a finite number"),
        ({"speed_m_s": -0.6}, "speed_m_s is -0.6; allowed: at least -0.5 m/s"),
        ({"speed_m_s": math.inf}, "speed_m_s is inf"),
        ({"acceleration_m_s2": math.nan}, "acceleration_m_s2 is nan"),
    ],
)
def test_broken_promise_names_topic_and_value(change: dict[str, float], reason: str) -> None:
    message = plant_messages(dataclasses.replace(STATE, **change))[Topic.PLANT_STATE]
    with pytest.raises(MessageError, match=f"plant/state: {reason}"):
        decode_observation(message)


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0])
def test_values_of_the_pack_are_left_to_the_controller_to_judge(value: float) -> None:
    names = ("compressor_power_w", "cell_1_temperature_k", "cell_n_temperature_k")
    names += ("cell_1_capacity_loss", "cell_n_capacity_loss")
    state = dataclasses.replace(STATE, **dict.fromkeys(names, value))
    found = decode_observation(plant_messages(state)[Topic.PLANT_STATE]).state
    np.testing.assert_array_equal([getattr(found, name) for name in names], value)


def test_leader_round_trip() -> None:
    leader = LeaderState(4.5, 123.4, 5.6)
    message = encode_leader(leader)
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "leader")
    assert decode_leader(message) == leader


def test_leader_driving_backwards_is_refused() -> None:
    with pytest.raises(MessageError, match=r"v2x/leader: speed is -1\.0"):
        decode_leader(encode_leader(LeaderState(0.0, 0.0, -1.0)))


@pytest.mark.parametrize(
    ("safety", "reason"),
    [
        (
            SafetyRecord(service_braking_s=-0.1),
            r"service_braking_s is -0.1; allowed: a finite number, at",
        ),
        (SafetyRecord(command_source=3.0), r"command_source is 3.0; allowed: 0, 1 or 2"),
        (SafetyRecord(brake_share=1.5), r"brake_share is 1.5; allowed: 0 to 1"),
    ],
)
def test_impossible_safety_records_are_refused(safety: SafetyRecord, reason: str) -> None:
    with pytest.raises(MessageError, match=reason):
        decode_observation(plant_messages(STATE, safety=safety)[Topic.PLANT_STATE])


def driver_message() -> PointCloud2:
    """Two points as a radar driver publishes them: float32, further fields, big-endian."""
    row = np.dtype([(name, ">f4") for name in ("x", "y", "z", "rcs", "vx")])
    points = np.array([(50.0, -0.5, 0.7, 9.0, -1.5), (np.nan, 0.0, 0.0, 0.0, 0.0)], row)
    fields = [
        PointField(name=name, offset=4 * place, datatype=PointField.FLOAT32, count=1)
        for place, name in enumerate(row.names or ())
    ]
    message = PointCloud2(
        height=1, width=2, fields=fields, is_bigendian=True, point_step=20, row_step=40,
        data=array("B", points.tobytes()),
    )  # fmt: skip
    message.header.stamp.sec = 7
    return message


@pytest.mark.parametrize(
    "tracks", [(), (RangeTrack(42.5, 0.25, -1.5), RangeTrack(90.0, -3.0, 0.1))]
)
def test_round_trip(tracks: tuple[RangeTrack, ...]) -> None:
    message = encode_tracks(tracks, 1_795_749_682_123_456_789)
    assert message.header.frame_id == "base_link"
    assert decode_tracks(message) == (1_795_749_682_123_456_789, tracks)


def test_points_of_a_driver_are_read_and_what_is_not_finite_is_left_out() -> None:
    assert decode_tracks(driver_message()) == (7_000_000_000, (RangeTrack(50.0, -0.5, -1.5),))


@pytest.mark.parametrize(
    ("name", "value", "refusal"),
    [
        ("fields", [], "missing x; got no fields"),
        ("width", 3, "40 bytes for 3 points of 20"),
        ("point_step", 2**31, "point_step is 2147483648; allowed: up to"),
        ("point_step", 16, "field vx has datatype 7 at 16 of 16 bytes"),
    ],
)
def test_a_malformed_message_is_refused(name: str, value: object, refusal: str) -> None:
    message = driver_message()
    setattr(message, name, value)
    with pytest.raises(MessageError, match=refusal):
        decode_tracks(message)


READING = BatteryReading(
    time_s=5.0,
    pack_voltage_v=345.5,
    pack_current_a=40.25,
    cell_voltages_v=(3.5, 3.25),
    cell_temperatures_k=(300.0, 303.0),
    charge_ah=30.0,
    capacity_ah=60.0,
    design_capacity_ah=62.5,
)


def test_discharging_is_negative_on_the_wire_and_positive_inside() -> None:
    message = encode_battery(READING)
    assert message.current == -40.25
    assert message.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_DISCHARGING


@pytest.mark.parametrize(
    ("current_a", "status"),
    [
        (-3.0, BatteryState.POWER_SUPPLY_STATUS_CHARGING),
        (0.0, BatteryState.POWER_SUPPLY_STATUS_NOT_CHARGING),
    ],
)
def test_status_follows_the_current(current_a: float, status: int) -> None:
    reading = BatteryReading(0.0, 350.0, current_a, (3.6, 3.6), (300.0, 300.0))
    assert encode_battery(reading).power_supply_status == status


def test_values_are_those_of_ros_in_single_precision() -> None:
    message = encode_battery(READING)
    assert (message.header.stamp.sec, message.header.frame_id) == (5, "battery_pack")
    assert message.voltage == READING.pack_voltage_v
    assert tuple(message.cell_voltage) == READING.cell_voltages_v
    assert list(message.cell_temperature) == pytest.approx([26.85, 29.85], abs=1e-5)
    assert message.temperature == pytest.approx(28.35, abs=1e-5)
    assert (message.charge, message.capacity, message.percentage) == (30.0, 60.0, 0.5)


def test_unmeasured_values_are_nan_as_ros_defines() -> None:
    message = encode_battery(BatteryReading(0.0, 350.0, 1.0, (3.6, 3.6), (300.0, 300.0)))
    assert math.isnan(message.charge)
    assert math.isnan(message.percentage)
