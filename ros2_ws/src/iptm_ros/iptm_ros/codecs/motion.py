"""Motions: the lead vehicle now, and tables over time for its previews, its measured samples and plans.

A table is a `sensor_msgs/PointCloud2` with a point per row. RViz and Foxglove draw its `x`, `y`, `z`
(float32: the position along the road, 0, 0); the columns that the topic table names follow as float64,
absolute and in SI units. A preview carries two times: the stamp of its publication and the instant of its
generation, which is the time of its first row. Where it is uncertain, a further column has its bounds.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iptm_core.state import SPEED_AT_REST_M_S, FloatArray, LeaderPreview, LeaderState
from iptm_ros.codecs.cdr import (
    FRAME_AT,
    Stamped,
    Writer,
    aligned,
    ns_from_s,
    ns_from_time,
    put_stamp,
    reject,
    s_from_ns,
    stamp_ns_of,
)
from iptm_ros.codecs.numbers import StampedNumbers, encoder, read_numbers, stamp_of
from iptm_ros.message_types import Odometry, PointCloud2, PointField
from iptm_ros.topics import ROAD_FRAME, TOPICS, Topic, frame_in

TIME, POSITION, SPEED, BOUND = "time_s", "position_m", "speed_m_s", "bound_m"
_DRAWN = ("x", "y", "z")
_LENGTH, _TWO, _DENSE = struct.Struct("<I"), struct.Struct("<II"), b"\x01"
_MOST_POINT_BYTES = 65_536
_DRAWN_BYTES = 16  # three float32 and a gap, so that the float64 values are aligned


@lru_cache(maxsize=8)
def _layout(names: tuple[str, ...]) -> tuple[Sequence[PointField], np.dtype[np.void]]:
    """Return the fields of a message with columns, and its rows as records."""
    drawn = [
        PointField(name=name, offset=4 * place, datatype=PointField.FLOAT32, count=1)
        for place, name in enumerate(_DRAWN)
    ]
    columns = [
        PointField(name=name, offset=_DRAWN_BYTES + 8 * place, datatype=PointField.FLOAT64, count=1)
        for place, name in enumerate(names)
    ]
    row = np.dtype(
        {
            "names": [*_DRAWN, *names],
            "formats": ["<f4"] * len(_DRAWN) + ["<f8"] * len(names),
            "offsets": [field.offset for field in (*drawn, *columns)],
            "itemsize": _DRAWN_BYTES + 8 * len(names),
        }
    )
    return [*drawn, *columns], row


def _rows(topic: Topic, columns: Mapping[str, FloatArray]) -> NDArray[np.void]:
    """Return columns, the time and the position among them, as the points of a message."""
    count = columns[TIME].size
    if any(column.size != count for column in columns.values()):
        sizes = ", ".join(str(column.size) for column in columns.values())
        reject(topic, f"columns have {sizes} entries; allowed: equal numbers")
    all_finite(topic, TIME, columns[TIME])
    rows: NDArray[np.void] = np.zeros(count, _layout(tuple(columns))[1])
    rows["x"] = columns[POSITION]
    for name, column in columns.items():
        rows[name] = column
    return rows


def table_bytes(
    topic: Topic, stamp_ns: int, columns: Mapping[str, FloatArray], prefix: str
) -> bytes:
    """Return a table as the bytes of a message.

    Args:
        topic: names the columns in refusals.
        stamp_ns: of the message.
        columns: float64, shape (n,) each, the time and the position among them.
        prefix: of the frame of a vehicle.

    Raises:
        MessageError: the columns differ in length, or a time is not finite.
    """
    rows = _rows(topic, columns)
    start, fields = _form(tuple(columns), frame_in(prefix, ROAD_FRAME))
    head = bytearray(start)
    put_stamp(head, stamp_ns)
    count, size = _LENGTH.pack(rows.size), _TWO.pack(rows.nbytes, rows.nbytes)
    return b"".join((head, count, fields, size, rows.data, _DENSE))


@lru_cache(maxsize=64)
def _form(names: tuple[str, ...], frame: str) -> tuple[bytes, bytes]:
    """Return the bytes before the number of points, and those between it and the size of their data."""
    fields, row = _layout(names)
    writer = Writer(frame)
    writer.put("I", 1)  # height
    count_at = len(writer.data)
    writer.put("I", 0, len(fields))
    for field in fields:
        writer.put_text(field.name)
        writer.put("I", field.offset)
        writer.put("B", field.datatype)
        writer.put("I", field.count)
    writer.put("B", 0)  # little-endian
    writer.put("I", row.itemsize)
    return bytes(writer.data[:count_at]), bytes(writer.data[count_at + _LENGTH.size :])


def _count_at(frame_bytes: int) -> int:
    return aligned(FRAME_AT + frame_bytes, 4) + _LENGTH.size


@lru_cache(maxsize=16)
def _forms_of(topic: Topic) -> tuple[tuple[tuple[str, ...], bytes], ...]:
    """Return the names of columns that a table may have, and the form of each; nothing for no table."""
    every = tuple(TOPICS[topic].fields)
    if TOPICS[topic].message_type is not PointCloud2 or TIME not in every:
        return ()
    choices = (every, every[:-1]) if every[-1] == BOUND else (every,)
    return tuple((names, _form(names, ROAD_FRAME)[1]) for names in choices)


def table_of(topic: Topic, data: bytes) -> Stamped[dict[str, FloatArray]] | None:
    """Return stamp and columns of a table of finite values; None where its bytes have another form."""
    if len(data) < FRAME_AT:
        return None
    at = _count_at(_LENGTH.unpack_from(data, FRAME_AT - _LENGTH.size)[0]) - _LENGTH.size
    for names, fields in _forms_of(topic):
        first = at + 2 * _LENGTH.size + len(fields) + _TWO.size
        if data.startswith(fields, at + 2 * _LENGTH.size) and len(data) > first:
            height, count = _TWO.unpack_from(data, at)
            step = _DRAWN_BYTES + 8 * len(names)
            sizes = _TWO.pack(count * step, count * step)
            is_whole = data.startswith(sizes, first - _TWO.size)
            if height == 1 and is_whole and len(data) == first + count * step + len(_DENSE):
                points = np.frombuffer(data, np.float64, count * step // 8, first)
                columns = points.reshape(count, step // 8)[:, _DRAWN_BYTES // 8 :].T.copy()
                if np.isfinite(columns).all():
                    return Stamped(stamp_ns_of(data), dict(zip(names, columns, strict=True)))
    return None


def decode_table(
    topic: Topic,
    message: PointCloud2 | Stamped[dict[str, FloatArray]],
    optional: Sequence[str] = (),
) -> tuple[int, dict[str, FloatArray]]:
    """Return the stamp (ns) and the columns of the topic table, shape (n,) each.

    Other fields are ignored, and the fields may lie anywhere in a point.

    Args:
        topic: gives the names of the columns.
        message: the table, or the numbers in its bytes.
        optional: columns that may be missing.

    Raises:
        MessageError: a column is missing or no float64, the sizes contradict each other, a value is not
            finite, or the times do not increase.
    """
    if isinstance(message, Stamped):
        stamp_ns, columns = message.stamp_ns, message.value
    else:
        stamp_ns, columns = ns_from_time(message.header.stamp), _columns(topic, message, optional)
        for name, column in columns.items():
            all_finite(topic, name, column)
    increasing(topic, TIME, columns[TIME])
    return stamp_ns, columns


def _columns(topic: Topic, message: PointCloud2, optional: Sequence[str]) -> dict[str, FloatArray]:
    places = {field.name: field for field in message.fields}
    names = [name for name in TOPICS[topic].fields if name in places or name not in optional]
    missing = [name for name in names if name not in places]
    if missing:
        reject(topic, f"missing {', '.join(missing)}; got {', '.join(places) or 'no fields'}")
    count, step = message.width * message.height, message.point_step
    check_point_step(topic, step)
    row = np.dtype(
        {
            "names": names,
            "formats": ["<f8"] * len(names),
            "offsets": [_checked(topic, places[name], step) for name in names],
            "itemsize": step,
        }
    )
    if message.is_bigendian or len(message.data) != count * step or message.height > 1:
        reject(
            topic,
            f"{len(message.data)} bytes in {message.height} rows of {message.width} points of {step}, "
            f"big-endian: {bool(message.is_bigendian)}; allowed: one row of little-endian points",
        )
    rows = np.frombuffer(message.data, row, count)
    return {name: rows[name].astype(np.float64) for name in names}


def check_point_step(topic: Topic, step: int) -> None:
    """Check the length of a point in bytes: a message without points may state any."""
    if step > _MOST_POINT_BYTES:
        reject(topic, f"point_step is {step}; allowed: up to {_MOST_POINT_BYTES}")


def _checked(topic: Topic, field: Any, step: int) -> int:
    """Return the offset of a float64 field."""
    offset = int(field.offset)
    if field.datatype != PointField.FLOAT64 or field.count != 1 or not 0 <= offset <= step - 8:
        reject(
            topic,
            f"field {field.name} has datatype {field.datatype}, count {field.count} at {offset} of {step} "
            f"bytes; allowed: one float64 ({PointField.FLOAT64}) inside a point",
        )
    return offset


def all_finite(topic: Topic, name: str, values: FloatArray) -> None:
    """Check that an array is finite everywhere; names the first entry that is not."""
    good = np.isfinite(values)
    if not good.all():
        index = int(good.argmin())
        reject(topic, f"{name}[{index}] is {values[index]}; allowed: finite numbers")


def increasing(topic: Topic, name: str, values: FloatArray) -> None:
    """Check that an array increases strictly."""
    good = values[1:] > values[:-1]
    if not good.all():
        index = int(good.argmin())
        before, after = values[index], values[index + 1]
        reject(topic, f"values of {name} do not increase: {before} is followed by {after}")


@encoder(Topic.LEADER)
def encode_leader(state: LeaderState, stamp_ns: int | None = None) -> StampedNumbers:
    """Return the leader's position (m) and speed (m/s), at a stamp where its time is not exact enough."""
    if stamp_ns is None:
        stamp_ns = ns_from_s(state.time_s)
    return stamp_ns, (state.position_m, state.speed_m_s)


def decode_leader(message: Odometry) -> LeaderState:
    """Return the leader's state."""
    numbers = read_numbers(Topic.LEADER, message)
    return LeaderState(s_from_ns(stamp_of(message)), *numbers)


def leader_preview_bytes(
    preview: LeaderPreview, stamp_ns: int, prefix: str, topic: Topic = Topic.LEADER_PREVIEW
) -> bytes:
    """Return a prediction as the bytes of a message, its frame with the prefix of a vehicle.

    Raises:
        MessageError: see `table_bytes`.
    """
    columns = {TIME: preview.times_s, POSITION: preview.positions_m, SPEED: preview.speeds_m_s}
    if preview.bounds_m.size:
        columns[BOUND] = preview.bounds_m
    return table_bytes(topic, stamp_ns, columns, prefix)


def decode_leader_preview(
    message: PointCloud2 | Stamped[dict[str, FloatArray]], topic: Topic = Topic.LEADER_PREVIEW
) -> tuple[int, LeaderPreview]:
    """Return the stamp (ns) and the prediction.

    Measured positions, as in ``v2x/leader_samples``, may go back and forth, and the first ones of an interval
    may be missing; predicted ones begin when they were generated, before their stamp.

    Raises:
        MessageError: see `decode_table`; a negative bound; of a prediction a leader that drives backwards, or
            a generation after the publication.
    """
    stamp_ns, columns = decode_table(topic, message, optional=(BOUND,))
    times_s, positions_m, speeds_m_s = columns[TIME], columns[POSITION], columns[SPEED]
    bounds_m = columns.get(BOUND, np.empty(0))
    if not times_s.size:
        return stamp_ns, LeaderPreview.empty()
    if float(speeds_m_s.min()) < SPEED_AT_REST_M_S:
        reject(topic, f"speed is {speeds_m_s.min()}; allowed: at least {SPEED_AT_REST_M_S:g} m/s")
    if float(bounds_m.min(initial=0.0)) < 0.0:
        reject(topic, f"bound is {bounds_m.min()} m; allowed: at least 0 m")
    if topic is Topic.LEADER_PREVIEW:
        late_ns = round(float(times_s[0]) * 1e9) - stamp_ns
        if late_ns > 0:
            reject(topic, f"generated {late_ns} ns after its publication; allowed: at most 0")
        backwards_m = SPEED_AT_REST_M_S * np.maximum(times_s[1:] - times_s[:-1], 1.0)
        if (positions_m[1:] - positions_m[:-1] < backwards_m).any():
            reject(topic, "positions decrease; allowed: a leader that never drives backwards")
    return stamp_ns, LeaderPreview(times_s, positions_m, speeds_m_s, bounds_m)
