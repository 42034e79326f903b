"""Tracks of a range sensor: our own, from radar drivers, and malformed ones."""

from __future__ import annotations

from array import array

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField

from iptm_core.errors import MessageError
from iptm_core.lead_track import RangeTrack
from iptm_ros.codecs import decode_tracks, encode_tracks


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
        ("point_step", 16, "field vx has datatype 7 at 16 of 16 bytes"),
    ],
)
def test_a_malformed_message_is_refused(name: str, value: object, refusal: str) -> None:
    message = driver_message()
    setattr(message, name, value)
    with pytest.raises(MessageError, match=refusal):
        decode_tracks(message)
