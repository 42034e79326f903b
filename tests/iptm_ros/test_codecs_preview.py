"""Previews of the leader as messages and back."""

from __future__ import annotations

import dataclasses
import math
from array import array
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from tests.table_messages import encode_leader_preview

from iptm_core.errors import MessageError
from iptm_core.state import LeaderPreview, SlopePreview
from iptm_ros.codecs import (
    decode_leader_preview,
    decode_slope,
    encode_slope,
)
from iptm_ros.topics import Topic


def make_preview(
    generated_at_s: float, count: int, step_s: float = 1.0, *, bounded: bool = False
) -> LeaderPreview:
    times = generated_at_s + step_s * np.arange(count)
    speeds = 5.0 + np.sin(times)
    positions = 20.0 + 5.0 * times - np.cos(times)
    bounds = 0.3 * (times - times[0]) ** 2 if bounded else np.empty(0)
    return LeaderPreview(times, positions, speeds, bounds)


def sent(message: PointCloud2) -> PointCloud2:
    """What arrives."""
    return deserialize_message(bytes(serialize_message(message)), PointCloud2)


def assert_same(first: LeaderPreview, second: LeaderPreview) -> None:
    assert first.generated_at_s == second.generated_at_s
    np.testing.assert_array_equal(first.times_s, second.times_s)
    np.testing.assert_array_equal(first.positions_m, second.positions_m)
    np.testing.assert_array_equal(first.speeds_m_s, second.speeds_m_s)
    np.testing.assert_array_equal(first.bounds_m, second.bounds_m)


@pytest.mark.parametrize("bounded", [False, True], ids=["known", "bounded"])
@pytest.mark.parametrize("count", [1, 2, 61, 301])
@pytest.mark.parametrize("age_s", [0.0, 0.25, 3.0])
def test_a_preview_arrives_to_the_last_bit(count: int, age_s: float, bounded: bool) -> None:
    preview = make_preview(7.0, count, 1.0 / 3.0, bounded=bounded)
    stamp_ns = round((7.0 + age_s) * 1e9)
    got_ns, got = decode_leader_preview(sent(encode_leader_preview(preview, stamp_ns)))
    assert got_ns == stamp_ns
    assert_same(got, preview)


def test_viewers_find_what_they_draw() -> None:
    """RViz draws x, y and z that are float32; further fields colour the points."""
    preview = make_preview(0.0, 3, bounded=True)
    message = encode_leader_preview(preview, 0)
    assert message.header.frame_id == "odom"
    drawn = [(field.name, field.datatype, field.count) for field in message.fields[:3]]
    assert drawn == [(name, PointField.FLOAT32, 1) for name in ("x", "y", "z")]
    names = [field.name for field in message.fields[3:]]
    assert names == ["time_s", "position_m", "speed_m_s", "bound_m"]
    rows = np.frombuffer(message.data, np.float32).reshape(3, -1)
    np.testing.assert_array_equal(rows[:, 0], preview.positions_m.astype(np.float32))
    assert not rows[:, 1:3].any()
    assert all(field.offset % 8 == 0 for field in message.fields[3:])
    assert message.point_step % 8 == 0


def test_a_known_preview_has_no_bounds_and_an_empty_one_no_rows() -> None:
    known = encode_leader_preview(make_preview(0.0, 3), 0)
    assert "bound_m" not in [field.name for field in known.fields]
    stamp_ns, preview = decode_leader_preview(
        sent(encode_leader_preview(LeaderPreview.empty(), 4_000_000_000))
    )
    assert stamp_ns == 4_000_000_000
    assert preview.times_s.size == preview.positions_m.size == preview.speeds_m_s.size == 0
    assert preview.generated_at_s == -math.inf


def test_fields_may_lie_anywhere_and_others_are_ignored() -> None:
    preview = make_preview(0.0, 3, bounded=True)
    columns = {
        "position_m": preview.positions_m,
        "colour": np.full(3, 7.0),
        "bound_m": preview.bounds_m,
        "speed_m_s": preview.speeds_m_s,
        "time_s": preview.times_s,
    }
    table = np.column_stack(list(columns.values()))
    message = PointCloud2(height=1, width=3, point_step=40, row_step=120, is_dense=True)
    message.fields = [
        PointField(name=name, offset=8 * place, datatype=PointField.FLOAT64, count=1)
        for place, name in enumerate(columns)
    ]
    message.data = array("B", table.tobytes())
    assert_same(decode_leader_preview(sent(message))[1], preview)


@pytest.mark.parametrize(
    ("change", "stamp_ns", "reason"),
    [
        ({"speeds_m_s": np.array([1.0, -0.6, 1.0])}, 0, "speed is -0.6"),
        ({"speeds_m_s": np.array([1.0, math.nan, 1.0])}, 0, r"speed_m_s\[1\] is nan"),
        ({"positions_m": np.array([1.0, math.inf, 2.0])}, 0, r"position_m\[1\] is inf"),
        ({"positions_m": np.array([3.0, 2.0, 4.0])}, 0, "never drives backwards"),
        ({"bounds_m": np.array([0.0, -0.1, 0.2])}, 0, "bound is -0.1 m; allowed: at least 0 m"),
        ({"bounds_m": np.array([0.0, math.nan, 0.2])}, 0, r"bound_m\[1\] is nan"),
        ({"times_s": np.array([0.0, 2.0, 1.0])}, 0, "time_s do not increase: 2.0 is followed"),
        ({"times_s": np.array([0.0, 2.0, 2.0])}, 0, "time_s do not increase"),
        (
            {"times_s": np.array([1.0, 2.0, 3.0])},
            500_000_000,
            "generated 500000000 ns after its publication",
        ),
    ],
)
def test_broken_preview_is_refused(change: dict[str, Any], stamp_ns: int, reason: str) -> None:
    preview = dataclasses.replace(make_preview(0.0, 3), **change)
    message = sent(encode_leader_preview(preview, stamp_ns))
    with pytest.raises(MessageError, match=f"v2x/leader_preview: .*{reason}"):
        decode_leader_preview(message)


def test_measured_positions_may_go_back_and_forth() -> None:
    noisy = dataclasses.replace(make_preview(0.0, 3), positions_m=np.array([3.0, 2.0, 4.0]))
    message = encode_leader_preview(noisy, 0, Topic.LEADER_SAMPLES)
    assert_same(decode_leader_preview(message, Topic.LEADER_SAMPLES)[1], noisy)


def test_the_first_measurements_of_an_interval_may_be_missing() -> None:
    rest = make_preview(7.2, 8, 0.1)
    message = encode_leader_preview(rest, 7_000_000_000, Topic.LEADER_SAMPLES)
    assert_same(decode_leader_preview(sent(message), Topic.LEADER_SAMPLES)[1], rest)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"speeds_m_s": np.zeros(2)}, "have 3, 3, 2 entries"),
        ({"bounds_m": np.zeros(2)}, "have 3, 3, 3, 2 entries"),
        ({"times_s": np.array([0.0, math.nan, 2.0])}, r"time_s\[1\] is nan"),
    ],
)
def test_inconsistent_preview_cannot_be_sent(change: dict[str, Any], reason: str) -> None:
    preview = dataclasses.replace(make_preview(0.0, 3), **change)
    with pytest.raises(MessageError, match=reason):
        encode_leader_preview(preview, 0)


def _rename(message: PointCloud2) -> None:
    message.fields[3].name = "elbow"


def _single(message: PointCloud2) -> None:
    message.fields[4].datatype = PointField.FLOAT32


def _outside(message: PointCloud2) -> None:
    message.fields[5].offset = message.point_step - 7


def _long_points(message: PointCloud2) -> None:
    message.width, message.point_step = 0, 2**31


def _cut(message: PointCloud2) -> None:
    message.data = message.data[:-1]


def _wide(message: PointCloud2) -> None:
    message.width += 1


def _many_rows(message: PointCloud2) -> None:
    message.height, message.width = 3, 1


def _big_endian(message: PointCloud2) -> None:
    message.is_bigendian = True


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (_rename, "missing time_s; got x, y, z, elbow"),
        (
            _single,
            "field position_m has datatype 7, count 1 at 24 of 40 bytes; allowed: one float64",
        ),
        (_outside, "field speed_m_s has datatype 8, count 1 at 33 of 40 bytes"),
        (_long_points, "point_step is 2147483648; allowed: up to"),
        (_cut, "119 bytes in 1 rows of 3 points of 40"),
        (_wide, "120 bytes in 1 rows of 4 points of 40"),
        (_many_rows, "120 bytes in 3 rows of 1 points"),
        (_big_endian, ".*big-endian: True; allowed: one row of little-endian points"),
    ],
)
def test_other_clouds_are_refused(damage: Callable[[PointCloud2], None], reason: str) -> None:
    message = sent(encode_leader_preview(make_preview(0.0, 3), 0))
    damage(message)
    with pytest.raises(MessageError, match=f"v2x/leader_preview: {reason}"):
        decode_leader_preview(message)


@given(
    st.lists(st.tuples(st.integers(0, 400), st.integers(0, 255)), min_size=1, max_size=4),
    st.booleans(),
)
def test_damaged_bytes_decode_to_a_sound_preview_or_not_at_all(
    damage: list[tuple[int, int]], bounded: bool
) -> None:
    message = encode_leader_preview(make_preview(0.0, 5, bounded=bounded), 0)
    data = bytearray(serialize_message(message))
    for place, value in damage:
        data[4 + place % (len(data) - 4)] = value
    try:
        damaged = deserialize_message(bytes(data), PointCloud2)
    except Exception:  # noqa: BLE001  the middleware refuses it
        return
    try:
        _, preview = decode_leader_preview(damaged)
    except MessageError:
        return
    assert np.isfinite(preview.positions_m).all()
    assert (np.diff(preview.times_s) > 0.0).all()
    assert preview.bounds_m.min(initial=0.0) >= 0.0
    assert (preview.speeds_m_s >= -0.5).all()


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
        ([0.0, 0.0], [0.0, 0.0], "values of positions do not increase"),
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
