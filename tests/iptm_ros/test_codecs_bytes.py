"""What is published as bytes is the message to the last bit, whatever the numbers and the vehicle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, JointState
from std_msgs.msg import Float64, Float64MultiArray
from tests.table_messages import encode_table

from iptm_core.decision_record import DecisionRecord, Rung, SolveStatus
from iptm_core.errors import MessageError
from iptm_core.state import (
    BatteryReading,
    Command,
    IntervalPowers,
    LeaderPreview,
    LeaderState,
    PlantObservation,
    SafetyRecord,
    VehicleState,
)
from iptm_ros.codecs import (
    PlanTrajectory,
    battery_bytes,
    decode_leader_preview,
    encode_battery,
    encode_clock,
    encode_command,
    encode_decision_record,
    encode_float64,
    encode_leader,
    encode_observation,
    encode_road_ahead,
    leader_preview_bytes,
    plan_bytes,
    repeated_messages,
    road_ahead_bytes,
    road_of,
    serialized,
    table_of,
)
from iptm_ros.codecs.cdr import (
    ns_from_s,
    ns_from_time,
    s_from_ns,
    time_from_ns,
    time_from_s,
)
from iptm_ros.topics import TOPICS, Topic, frame_in

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
    all_data = encode_observation(observed, prefix)
    made = repeated_messages(Topic.PLANT_STATE, all_data[Topic.PLANT_STATE])
    assert made == {topic: all_data[topic] for topic in made}
    assert set(made) | {Topic.PLANT_STATE} == set(all_data)
    for topic, data in all_data.items():
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
    stamp_ns = stamp_ms * 10**6
    named = dict(zip(TOPICS[Topic.PLAN].fields, vars(plan).values(), strict=True))
    message = with_prefix(encode_table(stamp_ns, named), prefix)
    data = plan_bytes(plan, stamp_ns, prefix)
    assert len(serialize_message(message)) == length(message) == len(data)
    assert deserialize_message(data, type(message)) == message
    found = table_of(Topic.PLAN, data)
    assert found is not None
    assert found.stamp_ns == stamp_ns
    for name, column in zip(TOPICS[Topic.PLAN].fields, vars(plan).values(), strict=True):
        assert np.array_equal(found.value[name], column)
    # Bytes of another form are left to the decoder of their type.
    at = data.index(b"speed_m_s")
    for other in (data[:-1], data + b"\0", data[:at] + b"c" + data[at + 1 :], data[:11]):
        assert table_of(Topic.PLAN, other) is None


@pytest.mark.parametrize("topic", [Topic.LEADER_PREVIEW, Topic.LEADER_SAMPLES])
@pytest.mark.parametrize("bounds_m", [np.empty(0), np.array([0.0, 0.5, 2.0])], ids=["known", "not"])
def test_a_preview_is_read_from_its_bytes(topic: Topic, bounds_m: np.ndarray) -> None:
    preview = LeaderPreview(
        *np.array([[1.0, 2.0, 3.0], [5.0, 7.0, 9.0], [2.0, 2.0, 2.0]]), bounds_m
    )
    data = leader_preview_bytes(preview, 1_500_000_000, "car_1", topic)
    columns = list(vars(preview).values())[: 4 if bounds_m.size else 3]
    named = dict(zip(TOPICS[Topic.LEADER_PREVIEW].fields, columns, strict=False))
    message = with_prefix(encode_table(1_500_000_000, named), "car_1")
    assert deserialize_message(data, type(message)) == message
    if bounds_m.size and topic is Topic.LEADER_SAMPLES:
        assert table_of(topic, data) is None
        return
    stamp_ns, found = decode_leader_preview(table_of(topic, data), topic)
    assert stamp_ns == 1_500_000_000
    for name, values in vars(found).items():
        assert np.array_equal(values, getattr(preview, name))


@pytest.mark.parametrize("prefix", ["", "car_1", "fleet/car_12"])
def test_other_bytes_are_those_of_their_messages(prefix: str) -> None:
    reading = BatteryReading(
        3.5, 350.0, -12.3, (3.61, 3.62, 3.5), (300.0, 301.0, 302.0), 40, 50, 60
    )
    pairs = [(encode_battery(reading), battery_bytes(reading, prefix))]
    for has_leader in (True, False):
        road = encode_road_ahead(None, 7, has_leader=has_leader)
        data = road_ahead_bytes(None, 7, prefix, has_leader=has_leader)
        assert isinstance(data, bytes)
        pairs.append((road, data))
        known = road_of(Topic.ROAD_AHEAD, data)
        assert known is not None
        assert (known.stamp_ns, known.value.has_leader) == (7, has_leader)
        assert road_of(Topic.ROAD_AHEAD, data + b"\0") is None
    for message, data in pairs:
        again = serialize_message(with_prefix(message, prefix))
        assert repr(deserialize_message(data, type(message))) == repr(
            deserialize_message(again, type(message))
        )
        assert len(data) == length(message)
    assert deserialize_message(encode_clock(5 * 10**9 + 9), Clock).clock == Time(sec=5, nanosec=9)
    assert deserialize_message(encode_float64(1.25), Float64).data == 1.25


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


@given(st.integers(min_value=0, max_value=26 * 24 * 3600 * 1000))
def test_milliseconds_survive_the_round_trip_exactly(milliseconds: int) -> None:
    time_s = milliseconds / 1000
    assert s_from_ns(ns_from_time(time_from_s(time_s))) == time_s
    assert ns_from_s(time_s) == milliseconds * 1_000_000


@given(st.integers(min_value=0, max_value=2**31 * 10**9 - 1))
def test_stamps_keep_every_nanosecond(stamp_ns: int) -> None:
    assert ns_from_time(time_from_ns(stamp_ns)) == stamp_ns


def test_sum_of_tenths_meets_the_same_stamp() -> None:
    assert ns_from_s(0.1 + 0.2) == ns_from_s(0.3)
    assert s_from_ns(ns_from_s(0.1 + 0.2)) == 0.3


@pytest.mark.parametrize("time_s", [math.nan, math.inf, -math.inf])
def test_non_finite_time_is_refused(time_s: float) -> None:
    with pytest.raises(MessageError, match="finite"):
        ns_from_s(time_s)


@pytest.mark.parametrize("stamp_ns", [-1, 2**31 * 10**9])
def test_stamp_out_of_range_is_refused(stamp_ns: int) -> None:
    with pytest.raises(MessageError, match="allowed: 0 to"):
        time_from_ns(stamp_ns)


def test_largest_stamp_fits() -> None:
    assert time_from_ns(2**31 * 10**9 - 1) == Time(sec=2**31 - 1, nanosec=10**9 - 1)
