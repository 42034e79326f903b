from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import JointTrajectory

from iptm_core.errors import MessageError
from iptm_core.state import LeaderPreview, SlopePreview
from iptm_ros.codecs import (
    decode_leader_preview,
    decode_leader_preview_bytes,
    decode_slope,
    encode_leader_preview_bytes,
    encode_slope,
)
from iptm_ros.codecs import (
    preview as preview_codec,
)
from iptm_ros.codecs.time import duration_from_ns


def make_preview(
    generated_at_s: float, count: int, step_s: float = 1.0, *, bounded: bool = False
) -> LeaderPreview:
    times = np.round((generated_at_s + step_s * np.arange(count)) * 1e3) / 1e3
    speeds = 5.0 + np.sin(times)
    positions = 20.0 + 5.0 * times - np.cos(times)
    bounds = 0.3 * (times - times[0]) ** 2 if bounded else np.empty(0)
    return LeaderPreview(times, positions, speeds, bounds)


def message_of(preview: LeaderPreview, stamp_ns: int) -> JointTrajectory:
    """What the middleware reads from the bytes."""
    return deserialize_message(encode_leader_preview_bytes(preview, stamp_ns), JointTrajectory)


def assert_same(first: LeaderPreview, second: LeaderPreview) -> None:
    assert first.generated_at_s == second.generated_at_s
    np.testing.assert_array_equal(first.times_s, second.times_s)
    np.testing.assert_array_equal(first.positions_m, second.positions_m)
    np.testing.assert_array_equal(first.speeds_m_s, second.speeds_m_s)
    np.testing.assert_array_equal(first.bounds_m, second.bounds_m)


BOUNDED = pytest.mark.parametrize("bounded", [False, True], ids=["known", "bounded"])


@BOUNDED
@pytest.mark.parametrize("count", [1, 2, 61, 301])
@pytest.mark.parametrize("age_s", [0.0, 0.25, 3.0])
def test_bytes_and_message_carry_the_same_preview_exactly(
    count: int, age_s: float, bounded: bool
) -> None:
    preview = make_preview(7.0, count, bounded=bounded)
    stamp_ns = round((7.0 + age_s) * 1e9)
    message = message_of(preview, stamp_ns)
    for got_ns, got in (
        decode_leader_preview(message),
        decode_leader_preview_bytes(encode_leader_preview_bytes(preview, stamp_ns)),
        decode_leader_preview_bytes(bytes(serialize_message(message))),
    ):
        assert got_ns == stamp_ns
        assert_same(got, preview)


@given(st.integers(0, 10**7), st.integers(0, 5000), st.integers(1, 5000), st.integers(1, 40))
def test_generation_time_survives_any_delay(
    generated_ms: int, age_ms: int, step_ms: int, count: int
) -> None:
    preview = make_preview(generated_ms / 1e3, count, step_ms / 1e3)
    data = encode_leader_preview_bytes(preview, (generated_ms + age_ms) * 10**6)
    assert_same(decode_leader_preview_bytes(data)[1], preview)


def test_bounds_are_a_second_joint_that_a_known_preview_leaves_out() -> None:
    known = message_of(make_preview(0.0, 3), 0)
    bounded = message_of(make_preview(0.0, 3, bounded=True), 0)
    assert known.joint_names == ["leader"]
    assert bounded.joint_names == ["leader", "leader_bound"]
    for one, other in zip(known.points, bounded.points, strict=True):
        assert other.positions[0] == one.positions[0]
        assert other.velocities[0] == one.velocities[0]
    # 0.3 m/s^2 t^2, and its mean rate up to the next node.
    assert [point.positions[1] for point in bounded.points] == pytest.approx([0.0, 0.3, 1.2])
    assert [point.velocities[1] for point in bounded.points] == pytest.approx([0.3, 0.9, 0.0])


def test_joints_are_matched_by_name() -> None:
    preview = make_preview(0.0, 3, bounded=True)
    message = message_of(preview, 0)
    message.joint_names = message.joint_names[::-1]
    for point in message.points:
        point.positions, point.velocities = point.positions[::-1], point.velocities[::-1]
    assert_same(decode_leader_preview_bytes(bytes(serialize_message(message)))[1], preview)


def test_generation_is_the_first_point_before_the_stamp() -> None:
    message = message_of(make_preview(5.0, 3), 6_500_000_000)
    first = message.points[0].time_from_start
    assert (first.sec, first.nanosec) == (-2, 500_000_000)


def test_empty_preview_means_nothing_received_yet() -> None:
    for data in (
        encode_leader_preview_bytes(LeaderPreview.empty(), 4_000_000_000),
        bytes(serialize_message(message_of(LeaderPreview.empty(), 4_000_000_000))),
    ):
        stamp_ns, preview = decode_leader_preview_bytes(data)
        assert stamp_ns == 4_000_000_000
        assert preview.times_s.size == preview.positions_m.size == preview.speeds_m_s.size == 0
        assert preview.generated_at_s == -math.inf


FRAMES = ["", "map", "odom", *(f"{'car_1234567'[:size]}/odom" for size in range(1, 10))]
"""Names of all lengths: the points that follow lie where CDR aligns them."""


@BOUNDED
@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("count", [0, 1, 2, 61])
def test_the_frame_may_be_that_of_any_vehicle(frame: str, count: int, bounded: bool) -> None:
    preview = make_preview(7.0, count, bounded=bounded) if count else LeaderPreview.empty()
    message = message_of(preview, 7_500_000_000)
    message.header.frame_id = frame
    data = encode_leader_preview_bytes(preview, 7_500_000_000, frame)
    assert deserialize_message(data, JointTrajectory) == message
    for coded in (data, bytes(serialize_message(message))):
        stamp_ns, decoded = decode_leader_preview_bytes(coded)
        assert stamp_ns == 7_500_000_000
        assert_same(decoded, preview)


@BOUNDED
@pytest.mark.parametrize("frame", FRAMES)
def test_usual_messages_take_the_fast_way(
    monkeypatch: pytest.MonkeyPatch, frame: str, bounded: bool
) -> None:
    preview = make_preview(0.0, 61, bounded=bounded)
    message = message_of(preview, 0)
    message.header.frame_id = frame
    slow = bytes(serialize_message(message))
    fast = encode_leader_preview_bytes(preview, 0, frame)
    monkeypatch.setattr(preview_codec, "_deserialize", None)
    for data in (slow, fast):
        assert_same(decode_leader_preview_bytes(data)[1], preview)


def encode_ways(preview: LeaderPreview, stamp_ns: int) -> list[bytes]:
    return [
        encode_leader_preview_bytes(preview, stamp_ns),
        bytes(serialize_message(message_of(preview, stamp_ns))),
    ]


@pytest.mark.parametrize(
    ("change", "stamp_ns", "reason"),
    [
        ({"speeds_m_s": np.array([1.0, -0.6, 1.0])}, 0, "speed is -0.6"),
        ({"speeds_m_s": np.array([1.0, math.nan, 1.0])}, 0, r"speeds\[1\] is nan"),
        ({"positions_m": np.array([1.0, math.inf, 2.0])}, 0, r"positions\[1\] is inf"),
        ({"positions_m": np.array([3.0, 2.0, 4.0])}, 0, "never drives backwards"),
        ({"bounds_m": np.array([0.0, -0.1, 0.2])}, 0, "bound is -0.1 m; allowed: at least 0 m"),
        ({"bounds_m": np.array([0.0, math.nan, 0.2])}, 0, r"bounds\[1\] is nan"),
        ({"times_s": np.array([0.0, 2.0, 1.0])}, 0, "times do not increase: 2.0 is followed"),
        ({"times_s": np.array([0.0, 2.0, 2.0])}, 0, "times do not increase"),
        (
            {"times_s": np.array([1.0, 2.0, 3.0])},
            500_000_000,
            "generated 500000000 ns after its publication",
        ),
    ],
)
def test_broken_preview_is_refused(change: dict[str, Any], stamp_ns: int, reason: str) -> None:
    preview = dataclasses.replace(make_preview(0.0, 3), **change)
    for data in encode_ways(preview, stamp_ns):
        with pytest.raises(MessageError, match=f"v2x/leader_preview: .*{reason}"):
            decode_leader_preview_bytes(data)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"speeds_m_s": np.zeros(2)}, "have 3, 3, 2 entries"),
        ({"bounds_m": np.zeros(2)}, "bounds have 2 entries; allowed: 0 or 3"),
        ({"times_s": np.array([0.0, math.nan, 2.0])}, r"times\[1\] is nan"),
    ],
)
def test_inconsistent_preview_cannot_be_sent(change: dict[str, Any], reason: str) -> None:
    preview = dataclasses.replace(make_preview(0.0, 3), **change)
    with pytest.raises(MessageError, match=reason):
        encode_leader_preview_bytes(preview, 0)


def test_foreign_trajectories_are_refused() -> None:
    message = message_of(make_preview(0.0, 3), 0)
    message.joint_names = ["elbow"]
    with pytest.raises(MessageError, match=r"joint_names are \['elbow'\]"):
        decode_leader_preview_bytes(bytes(serialize_message(message)))


def test_point_without_speed_is_refused() -> None:
    message = message_of(make_preview(0.0, 3), 0)
    message.points[1].velocities = []
    for decode, given_ in (
        (decode_leader_preview, message),
        (decode_leader_preview_bytes, bytes(serialize_message(message))),
    ):
        with pytest.raises(
            MessageError, match="point 1 has 1 positions and 0 velocities; allowed: 1 of each"
        ):
            decode(given_)


def test_accelerations_are_welcome_and_ignored() -> None:
    preview = make_preview(0.0, 4)
    message = message_of(preview, 0)
    for point in message.points:
        point.accelerations = [0.5]
    assert_same(decode_leader_preview_bytes(bytes(serialize_message(message)))[1], preview)


def test_nanoseconds_beyond_a_second_are_understood_the_same_way() -> None:
    message = message_of(make_preview(0.0, 2), 0)
    message.points[1].time_from_start = duration_from_ns(0)
    message.points[1].time_from_start.nanosec = 1_500_000_000
    _, slow = decode_leader_preview(message)
    _, fast = decode_leader_preview_bytes(bytes(serialize_message(message)))
    assert slow.times_s[1] == 1.5
    assert_same(slow, fast)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@given(st.binary(max_size=400))
def test_random_bytes_never_do_more_than_raise_message_errors(data: bytes) -> None:
    with pytest.raises(MessageError):
        decode_leader_preview_bytes(data)


@given(
    st.lists(st.tuples(st.integers(0, 283), st.integers(0, 255)), min_size=1, max_size=4),
    st.booleans(),
)
def test_damaged_bytes_decode_to_a_sound_preview_or_not_at_all(
    damage: list[tuple[int, int]], bounded: bool
) -> None:
    data = bytearray(encode_leader_preview_bytes(make_preview(0.0, 5, bounded=bounded), 0))
    for place, value in damage:
        data[place] = value
    try:
        _, preview = decode_leader_preview_bytes(bytes(data))
    except MessageError:
        return
    assert np.isfinite(preview.positions_m).all()
    assert (np.diff(preview.times_s) > 0.0).all()
    assert preview.bounds_m.min(initial=0.0) >= 0.0
    assert (preview.speeds_m_s >= 0.0).all()


SLOPE = SlopePreview(np.array([0.0, 100.0, 250.0]), np.array([0.0, 0.05, -0.02]))


def test_slope_round_trip() -> None:
    message = encode_slope(SLOPE)
    assert [(d.label, d.size, d.stride) for d in message.layout.dim] == [
        ("position_m, slope_rad", 2, 6),
        ("node", 3, 3),
    ]
    back = decode_slope(message)
    np.testing.assert_array_equal(back.positions_m, SLOPE.positions_m)
    np.testing.assert_array_equal(back.slopes_rad, SLOPE.slopes_rad)


def test_level_road_is_one_node() -> None:
    back = decode_slope(encode_slope(SlopePreview(np.zeros(1), np.zeros(1))))
    assert back.slopes_rad.tolist() == [0.0]


@pytest.mark.parametrize(
    ("positions", "slopes", "reason"),
    [
        ([0.0, 0.0], [0.0, 0.0], "positions do not increase"),
        ([0.0, math.nan], [0.0, 0.0], r"positions\[1\] is nan"),
        ([0.0, 1.0], [0.0, math.inf], r"slopes\[1\] is inf"),
        ([0.0, 1.0], [0.0, 1.6], "slope is 1.6 rad"),
        ([], [], "layout is"),
    ],
)
def test_broken_slope_is_refused(positions: list[float], slopes: list[float], reason: str) -> None:
    message = encode_slope(SlopePreview(np.array(positions), np.array(slopes)))
    with pytest.raises(MessageError, match=f"v2x/slope: {reason}"):
        decode_slope(message)


def test_slope_with_missing_data_is_refused() -> None:
    message = encode_slope(SLOPE)
    message.data = message.data[:-1]
    with pytest.raises(MessageError, match="5 values; allowed: 6"):
        decode_slope(message)
