"""What is published as bytes is the message to the last bit, whatever the numbers and the vehicle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import BatteryState, JointState
from std_msgs.msg import Float64MultiArray

from iptm_core.decision_record import DecisionRecord, Rung, SolveStatus
from iptm_core.state import (
    Command,
    IntervalPowers,
    LeaderState,
    PlantObservation,
    SafetyRecord,
    VehicleState,
)
from iptm_ros.codecs import (
    PlanTrajectory,
    encode_command,
    encode_decision_record,
    encode_leader,
    encode_observation,
    encode_plan,
    serialized,
)
from iptm_ros.topics import TOPICS, frame_in

number = st.floats(allow_nan=False)
stamp_s = st.integers(0, 10**6).map(lambda ms: ms / 1e3)
JAZZY = get_typestore(Stores.ROS2_JAZZY)
PREFIXES = st.sampled_from(["", "a", "car_1", "fleet/car_12", "x" * 61])


def length(message: Any) -> int:
    """Return how many bytes a serialised message has by the rules of CDR, computed by rosbags."""
    package = type(message).__module__.split(".")[0]
    type_name = f"{package}/msg/{type(message).__name__}"
    definition = JAZZY.get_msgdef(type_name)
    content = serialize_message(message)[4:]
    return 4 + int(definition.deserialize_cdr_le(content, 0, definition.cls, JAZZY)[1])


def with_prefix(message: Any, prefix: str) -> Any:
    message.header.frame_id = frame_in(prefix, message.header.frame_id)
    if hasattr(message, "child_frame_id"):
        message.child_frame_id = frame_in(prefix, message.child_frame_id)
    return message


@settings(deadline=None, max_examples=50)
@given(st.lists(number, min_size=16, max_size=16), stamp_s, PREFIXES)
def test_bytes_are_those_of_the_message(x: list[float], time_s: float, prefix: str) -> None:
    state = VehicleState(time_s, *x[:8])
    record = DecisionRecord(SolveStatus.SOLVED, x[0], 7, *x[1:5], Rung.STOP, True, *x[5:11])
    cases: tuple[tuple[Any, ...], ...] = (
        (encode_leader, LeaderState(time_s, x[0], x[1])),
        (encode_leader, LeaderState(time_s, x[0], x[1]), 5),
        (encode_command, 123_456_789_012, Command(x[0], x[1])),
        (encode_decision_record, 3, record),
    )
    for encode, *arguments in cases:
        message = with_prefix(encode(*arguments), prefix)
        data = encode.data(prefix, *arguments)
        assert deserialize_message(data, type(message)) == message
        assert len(data) == length(message)
    safety = SafetyRecord(*x[10:13])
    observed = PlantObservation(state, IntervalPowers(*x[:6]), x[6], x[7], safety)
    for topic, data in encode_observation(observed, prefix).items():
        message = deserialize_message(data, TOPICS[topic].message_type)
        assert len(data) == length(message)
        spec_frame = TOPICS[topic].frame.split(" -> ")[0]
        assert message.header.frame_id == frame_in(prefix, spec_frame)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 70), st.integers(0, 10**6), PREFIXES, st.randoms(use_true_random=False))
def test_a_table_has_no_byte_too_many(count: int, stamp_ms: int, prefix: str, random: Any) -> None:
    columns = np.array([[random.uniform(-1e3, 1e3) for _ in range(6)] for _ in range(count)])
    times_s = stamp_ms / 1e3 + np.cumsum([random.uniform(0.01, 5.0) for _ in range(count)])
    plan = PlanTrajectory(times_s, *columns.reshape(count, 6).T)
    message = with_prefix(encode_plan(plan, stamp_ms * 10**6), prefix)
    assert len(serialize_message(message)) == length(message)


def test_a_serialized_message_has_no_byte_too_many() -> None:
    for message in (
        JointState(name=["a"], position=[1.0]),
        BatteryState(serial_number="x"),
        Odometry(),
        Float64MultiArray(),
    ):
        assert len(serialized(message)) == length(message)


def test_numbers_that_are_not_known_pass() -> None:
    record = DecisionRecord(
        SolveStatus.NOT_POSED, math.nan, 0, *[math.nan] * 4, Rung.STOP, False, *[math.inf] * 6
    )
    message = encode_decision_record(0, record)
    again = deserialize_message(encode_decision_record.data("", 0, record), type(message))
    assert np.array(again.position) == pytest.approx(np.array(message.position), nan_ok=True)
