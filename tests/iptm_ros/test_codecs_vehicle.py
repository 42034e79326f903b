from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.plant_messages import plant_messages

from iptm_core.errors import MessageError
from iptm_core.state import IntervalPowers, LeaderState, SafetyRecord, VehicleState
from iptm_ros.codecs import (
    decode_leader,
    decode_powers,
    decode_safety,
    decode_temperature,
    decode_vehicle_state,
    encode_leader,
    time_from_s,
)
from iptm_ros.topics import STATE_TOPICS, Topic

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
def test_state_survives_the_six_messages(
    position: float, speed: float, acceleration: float, power: float, kelvin: float, loss: float
) -> None:
    state = VehicleState(3.0, position, speed, acceleration, power, kelvin, kelvin, loss, loss)
    back = decode_vehicle_state(plant_messages(state))
    for field in dataclasses.fields(state):
        tolerance = 1e-13 if field.name.endswith("_k") else 0.0
        expected = getattr(state, field.name)
        got = getattr(back, field.name)
        assert got == pytest.approx(expected, abs=tolerance, rel=0.0, nan_ok=True)


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
        ({"position_m": math.nan}, r"plant/odometry: position is nan"),
        ({"speed_m_s": -0.6}, r"plant/odometry: speed is -0.6; allowed: at least -0.5 m/s"),
        ({"speed_m_s": math.inf}, r"plant/odometry: speed is inf"),
        ({"acceleration_m_s2": math.nan}, r"plant/acceleration: acceleration is nan"),
        ({"compressor_power_w": math.nan}, r"plant/powers: compressor_power_w is nan"),
        ({"cell_1_temperature_k": math.nan}, r"plant/cell_1_temperature: absolute temperature"),
        ({"cell_n_temperature_k": -1.0}, r"plant/cell_n_temperature: absolute temperature"),
        ({"cell_1_capacity_loss": -1e-9}, r"plant/capacity_loss: cell_1_capacity_loss"),
        ({"cell_n_capacity_loss": 1.5}, r"plant/capacity_loss: cell_n_capacity_loss is 1.5"),
    ],
)
def test_broken_promise_names_topic_and_value(change: dict[str, float], reason: str) -> None:
    with pytest.raises(MessageError, match=reason):
        decode_vehicle_state(plant_messages(dataclasses.replace(STATE, **change)))


@pytest.mark.parametrize("topic", STATE_TOPICS[1:])
def test_messages_of_different_ticks_are_not_mixed(topic: Topic) -> None:
    messages = plant_messages(STATE)
    messages[topic].header.stamp = time_from_s(11.0)
    with pytest.raises(MessageError, match="stamp is 11000000000 ns"):
        decode_vehicle_state(messages)


def test_leader_round_trip() -> None:
    leader = LeaderState(4.5, 123.4, 5.6)
    message = encode_leader(leader)
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "leader")
    assert decode_leader(message) == leader


def test_leader_driving_backwards_is_refused() -> None:
    with pytest.raises(MessageError, match=r"v2x/leader: speed is -1\.0"):
        decode_leader(encode_leader(LeaderState(0.0, 0.0, -1.0)))


def test_temperature_below_absolute_zero_is_refused() -> None:
    message = plant_messages(STATE)[Topic.PLANT_COOLANT_INLET_TEMPERATURE]
    message.temperature = -300.0
    with pytest.raises(MessageError, match="coolant_inlet"):
        decode_temperature(Topic.PLANT_COOLANT_INLET_TEMPERATURE, message)


@pytest.mark.parametrize(
    "powers",
    [
        IntervalPowers(-1500.0, 400.0, 250.0, -850.0, 900.0),
        IntervalPowers(0.0, -4000.0, 0.0, 4100.0, -4000.0),  # of a heater
    ],
)
def test_powers_keep_their_signs(powers: IntervalPowers) -> None:
    assert decode_powers(plant_messages(STATE, powers)[Topic.PLANT_POWERS]) == powers


@pytest.mark.parametrize(
    ("safety", "reason"),
    [
        (
            SafetyRecord(service_braking_s=-0.1),
            r"service_braking_s is -0.1; allowed: a finite number, at",
        ),
        (SafetyRecord(brake_share=1.5), r"brake_share is 1.5; allowed: 0 to 1"),
        (SafetyRecord(brake_share=math.nan), "brake_share is nan; allowed: a finite number"),
    ],
)
def test_impossible_safety_records_are_refused(safety: SafetyRecord, reason: str) -> None:
    with pytest.raises(MessageError, match=reason):
        decode_safety(plant_messages(STATE, safety=safety)[Topic.PLANT_SAFETY])
