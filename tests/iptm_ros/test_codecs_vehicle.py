from __future__ import annotations

import dataclasses
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.plant_messages import plant_messages

from iptm_core.errors import MessageError
from iptm_core.state import (
    IntervalPowers,
    LeaderState,
    PlantObservation,
    SafetyRecord,
    VehicleState,
)
from iptm_ros.codecs import decode_leader, decode_motion, decode_observation, encode_leader
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
