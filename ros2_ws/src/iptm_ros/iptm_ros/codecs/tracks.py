"""Tracks of a range sensor: points in the body frame of the ego vehicle, as radar drivers publish them."""

from __future__ import annotations

from array import array

import numpy as np

from iptm_core.lead_track import RangeTrack
from iptm_ros.codecs.numbers import reject
from iptm_ros.codecs.time import ns_from_time, time_from_ns
from iptm_ros.message_types import PointCloud2, PointField
from iptm_ros.topics import EGO_FRAME, TOPICS, Topic

_NAMES = list(TOPICS[Topic.RANGE_TRACKS].fields)
_MOST_TRACKS = 1000
_FORMATS = {PointField.FLOAT32: ("f4", 4), PointField.FLOAT64: ("f8", 8)}


def encode_tracks(tracks: tuple[RangeTrack, ...], stamp_ns: int) -> PointCloud2:
    """Return tracks as a message, stamped with the instant at which they were measured."""
    step = 8 * len(_NAMES)
    values = np.array([[t.gap_m, t.left_m, t.relative_speed_m_s] for t in tracks], "<f8")
    message = PointCloud2(
        height=1,
        width=len(tracks),
        fields=[
            PointField(name=name, offset=8 * place, datatype=PointField.FLOAT64, count=1)
            for place, name in enumerate(_NAMES)
        ],
        is_bigendian=False,
        point_step=step,
        row_step=step * len(tracks),
        data=array("B", values.tobytes()),
        is_dense=True,
    )
    message.header.stamp = time_from_ns(stamp_ns)
    message.header.frame_id = EGO_FRAME
    return message


def decode_tracks(message: PointCloud2) -> tuple[int, tuple[RangeTrack, ...]]:
    """Return the stamp (ns) and the tracks; points with a value that is not finite are left out.

    Raises:
        MessageError: a field is missing or no number, or the sizes contradict each other.
    """
    topic, places = Topic.RANGE_TRACKS, {field.name: field for field in message.fields}
    count, step = message.width * message.height, message.point_step
    formats, order = [], ">" if message.is_bigendian else "<"
    for name in _NAMES:
        field = places.get(name)
        if field is None:
            reject(topic, f"missing {name}; got {', '.join(places) or 'no fields'}")
        form, size = _FORMATS.get(field.datatype, ("", 0))
        if not form or not 0 <= field.offset <= step - size:
            reject(
                topic,
                f"field {name} has datatype {field.datatype} at {field.offset} of {step} bytes; allowed: "
                "float32 or float64 inside a point",
            )
        formats.append(order + form)
    if len(message.data) != count * step or count > _MOST_TRACKS:
        reject(
            topic,
            f"{len(message.data)} bytes for {count} points of {step}; allowed: up to {_MOST_TRACKS} points",
        )
    offsets = [int(places[name].offset) for name in _NAMES]
    row = np.dtype({"names": _NAMES, "formats": formats, "offsets": offsets, "itemsize": step})
    rows = np.frombuffer(message.data, row, count)
    values = np.column_stack([rows[name].astype(np.float64) for name in _NAMES])
    sound = values[np.isfinite(values).all(axis=1)].tolist()
    return ns_from_time(message.header.stamp), tuple(RangeTrack(*each) for each in sound)
