"""Tables over time: one flat standard message for previews, measured samples and plans.

A `sensor_msgs/PointCloud2` with a point per row. RViz and Foxglove draw its `x`, `y`, `z` (float32: the
position along the road, 0, 0); the columns that the topic table names follow as float64, absolute and in SI
units. A preview carries two times: the stamp of its publication and the instant of its generation, which is
the time of its first row. Where it is uncertain, a further column has its bounds.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from iptm_core.state import SPEED_AT_REST_M_S, FloatArray, LeaderPreview
from iptm_ros.codecs.cdr import reject
from iptm_ros.codecs.time import ns_from_time, time_from_ns
from iptm_ros.message_types import PointCloud2, PointField
from iptm_ros.topics import ROAD_FRAME, TOPICS, Topic

TIME, POSITION = "time_s", "position_m"
_DRAWN = ("x", "y", "z")
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


def encode_table(topic: Topic, stamp_ns: int, columns: Mapping[str, FloatArray]) -> PointCloud2:
    """Return a table as a message.

    Args:
        topic: names the columns in refusals.
        stamp_ns: of the message.
        columns: float64, shape (n,) each, the time and the position among them.

    Raises:
        MessageError: the columns differ in length, or a time is not finite.
    """
    count = columns[TIME].size
    if any(column.size != count for column in columns.values()):
        sizes = ", ".join(str(column.size) for column in columns.values())
        reject(topic, f"columns have {sizes} entries; allowed: equal numbers")
    all_finite(topic, TIME, columns[TIME])
    fields, row = _layout(tuple(columns))
    rows = np.zeros(count, row)
    rows["x"] = columns[POSITION]
    for name, column in columns.items():
        rows[name] = column
    message = PointCloud2(
        height=1,
        width=count,
        fields=fields,
        is_bigendian=False,
        point_step=row.itemsize,
        row_step=row.itemsize * count,
        data=array("B", rows.tobytes()),
        is_dense=True,
    )
    message.header.stamp = time_from_ns(stamp_ns)
    message.header.frame_id = ROAD_FRAME
    return message


def decode_table(
    topic: Topic, message: PointCloud2, optional: Sequence[str] = ()
) -> tuple[int, dict[str, FloatArray]]:
    """Return the stamp (ns) and the columns of the topic table, shape (n,) each.

    Other fields are ignored, and the fields may lie anywhere in a point.

    Args:
        topic: gives the names of the columns.
        message: the table.
        optional: columns that may be missing.

    Raises:
        MessageError: a column is missing or no float64, the sizes contradict each other, a value is not
            finite, or the times do not increase.
    """
    places = {field.name: field for field in message.fields}
    names = [name for name in TOPICS[topic].fields if name in places or name not in optional]
    missing = [name for name in names if name not in places]
    if missing:
        reject(topic, f"missing {', '.join(missing)}; got {', '.join(places) or 'no fields'}")
    count, step = message.width * message.height, message.point_step
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
    columns = {name: rows[name].astype(np.float64) for name in names}
    for name, column in columns.items():
        all_finite(topic, name, column)
    increasing(topic, TIME, columns[TIME])
    return ns_from_time(message.header.stamp), columns


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


SPEED, BOUND = "speed_m_s", "bound_m"


def encode_leader_preview(
    preview: LeaderPreview, stamp_ns: int, topic: Topic = Topic.LEADER_PREVIEW
) -> PointCloud2:
    """Return a prediction as a message.

    Raises:
        MessageError: the arrays differ in length, or a time is not finite.
    """
    columns: dict[str, FloatArray] = {
        TIME: preview.times_s,
        POSITION: preview.positions_m,
        SPEED: preview.speeds_m_s,
    }
    if preview.bounds_m.size:
        columns[BOUND] = preview.bounds_m
    return encode_table(topic, stamp_ns, columns)


def decode_leader_preview(
    message: PointCloud2, topic: Topic = Topic.LEADER_PREVIEW
) -> tuple[int, LeaderPreview]:
    """Return the stamp (ns) and the prediction.

    Measured positions, as in ``v2x/leader_samples``, may go back and forth; predicted ones may not.

    Raises:
        MessageError: see `decode_table`; a leader that drives backwards, a negative bound, or a generation
            after the publication.
    """
    stamp_ns, columns = decode_table(topic, message, optional=(BOUND,))
    times_s, positions_m, speeds_m_s = columns[TIME], columns[POSITION], columns[SPEED]
    bounds_m = columns.get(BOUND, np.empty(0))
    if not times_s.size:
        return stamp_ns, LeaderPreview.empty()
    late_ns = round(float(times_s[0]) * 1e9) - stamp_ns
    if late_ns > 0:
        reject(topic, f"generated {late_ns} ns after its publication; allowed: at most 0")
    if float(speeds_m_s.min()) < SPEED_AT_REST_M_S:
        reject(topic, f"speed is {speeds_m_s.min()}; allowed: at least {SPEED_AT_REST_M_S:g} m/s")
    if float(bounds_m.min(initial=0.0)) < 0.0:
        reject(topic, f"bound is {bounds_m.min()} m; allowed: at least 0 m")
    backwards_m = SPEED_AT_REST_M_S * np.maximum(np.diff(times_s), 1.0)
    if topic is Topic.LEADER_PREVIEW and (np.diff(positions_m) < backwards_m).any():
        reject(topic, "positions decrease; allowed: a leader that never drives backwards")
    return stamp_ns, LeaderPreview(times_s, positions_m, speeds_m_s, bounds_m)


PLAN_NAMES = list(TOPICS[Topic.PLAN].fields)


@dataclass(frozen=True)
class PlanTrajectory:
    """Predicted motion, temperatures and inputs of the ego vehicle at the nodes of the horizon.

    All arrays have shape (n,), in the order of the columns of the message. The inputs hold from their node to
    the next; the last node repeats the inputs of the last interval.

    Attributes:
        times_s: node times, increasing, absolute (trip time).
        positions_m: distance along the road.
        speeds_m_s: speed.
        cell_1_temperatures_k: first cell of a coolant channel.
        cell_n_temperatures_k: last cell of a coolant channel.
        accelerations_m_s2: acceleration input.
        compressor_powers_w: compressor power input.
    """

    times_s: FloatArray
    positions_m: FloatArray
    speeds_m_s: FloatArray
    cell_1_temperatures_k: FloatArray
    cell_n_temperatures_k: FloatArray
    accelerations_m_s2: FloatArray
    compressor_powers_w: FloatArray


def encode_plan(plan: PlanTrajectory, stamp_ns: int) -> PointCloud2:
    """Return a plan as a message, stamped with the state that it starts from."""
    return encode_table(
        Topic.PLAN, stamp_ns, dict(zip(PLAN_NAMES, vars(plan).values(), strict=True))
    )


def decode_plan(message: PointCloud2) -> tuple[int, PlanTrajectory]:
    """Return the stamp (ns) and the plan.

    Raises:
        MessageError: see `decode_table`.
    """
    stamp_ns, columns = decode_table(Topic.PLAN, message)
    return stamp_ns, PlanTrajectory(*columns.values())
