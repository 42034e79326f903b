"""The whole plan of the controller with its node times."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from iptm_core.state import NS_PER_S, FloatArray
from iptm_ros.codecs.cdr import put_stamp, serialized
from iptm_ros.codecs.numbers import reject
from iptm_ros.codecs.time import (
    duration_from_ns,
    ns_from_duration,
    ns_from_time,
    time_from_ns,
)
from iptm_ros.message_types import (
    JointTrajectory,
    JointTrajectoryPoint,
)
from iptm_ros.topics import ROAD_FRAME, TOPICS, Topic, frame_in

PLAN_NAMES = list(TOPICS[Topic.PLAN].fields)

_LIST_BYTES = 8 * len(PLAN_NAMES)
# One node in CDR: number of positions or the fill bytes behind it, positions, three empty lists, time.
_POINT = np.dtype(
    {
        "names": ["positions", "sec", "nanosec"],
        "formats": [f"({len(PLAN_NAMES)},)<f8", "<i4", "<u4"],
        "offsets": [4, _LIST_BYTES + 16, _LIST_BYTES + 20],
        "itemsize": _LIST_BYTES + 24,
    }
)


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
        reject(
            topic,
            f"{name} do not increase: {values[index]} is followed by {values[index + 1]}",
        )


@dataclass(frozen=True)
class PlanTrajectory:
    """Predicted motion, temperatures and inputs of the ego vehicle at the nodes of the horizon.

    All arrays have shape (n,). The inputs hold from their node to the next; the last node repeats
    the inputs of the last interval.

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


def encode_plan(plan: PlanTrajectory, stamp_ns: int) -> JointTrajectory:
    """Return a plan as a message, stamped with the state that it starts from."""
    offsets_ns, table = _table(plan, stamp_ns)
    points = [
        JointTrajectoryPoint(positions=row, time_from_start=duration_from_ns(offset))
        for offset, row in zip(offsets_ns.tolist(), table.tolist(), strict=True)
    ]
    message = JointTrajectory(joint_names=PLAN_NAMES, points=points)
    message.header.stamp = time_from_ns(stamp_ns)
    message.header.frame_id = ROAD_FRAME
    return message


def encode_plan_bytes(plan: PlanTrajectory, stamp_ns: int, prefix: str = "") -> bytes:
    """Return the bytes of the message, a fifth of the work; its frame has the prefix of a vehicle."""
    offsets_ns, table = _table(plan, stamp_ns)
    start, points_at = _form(len(table), prefix)
    data = bytearray(start)
    put_stamp(data, stamp_ns)
    points = np.frombuffer(data, _POINT, len(table), points_at)
    seconds = offsets_ns // NS_PER_S
    points["positions"] = table
    points["sec"] = seconds
    points["nanosec"] = offsets_ns - seconds * NS_PER_S
    return bytes(data)


def _table(plan: PlanTrajectory, stamp_ns: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the node times relative to the stamp (ns), shape (n,), and the columns, shape (n, 6)."""
    columns = (
        plan.positions_m,
        plan.speeds_m_s,
        plan.cell_1_temperatures_k,
        plan.cell_n_temperatures_k,
        plan.accelerations_m_s2,
        plan.compressor_powers_w,
    )
    sizes = [plan.times_s.size, *(column.size for column in columns)]
    if len(set(sizes)) != 1:
        reject(Topic.PLAN, f"columns have {sizes} entries; allowed: equal numbers")
    offsets_ns: NDArray[np.int64] = np.rint(plan.times_s * 1e9).astype(np.int64) - stamp_ns
    return offsets_ns, np.column_stack(columns)


@lru_cache(maxsize=16)
def _form(count: int, prefix: str) -> tuple[bytes, int]:
    """Return the bytes of a plan with `count` nodes, and the offset of its first record."""
    mark = 1.0e300
    nodes: FloatArray = np.arange(count, dtype=np.float64)
    message = encode_plan(PlanTrajectory(nodes, *(np.full(count, mark) for _ in PLAN_NAMES)), 0)
    message.header.frame_id = frame_in(prefix, ROAD_FRAME)
    data = serialized(message)
    return data, data.index(struct.pack("<d", mark)) - 4 if count else len(data)


def decode_plan(message: JointTrajectory) -> tuple[int, PlanTrajectory]:
    """Return the stamp (ns) and the plan.

    Raises:
        MessageError: wrong columns, a row of another length, a value that is not finite, or times
            that do not increase.
    """
    if message.joint_names != PLAN_NAMES:
        reject(Topic.PLAN, f"joint_names are {message.joint_names}; allowed: {PLAN_NAMES}")
    stamp_ns = ns_from_time(message.header.stamp)
    for index, point in enumerate(message.points):
        if len(point.positions) != len(PLAN_NAMES):
            reject(
                Topic.PLAN,
                f"point {index} has {len(point.positions)} values; allowed: {len(PLAN_NAMES)}",
            )
    offsets = np.array([ns_from_duration(p.time_from_start) for p in message.points], np.int64)
    table = np.array([p.positions for p in message.points], np.float64)
    table = table.reshape(len(message.points), len(PLAN_NAMES))
    times_s = (offsets + stamp_ns) / 1e9
    increasing(Topic.PLAN, "times", times_s)
    for name, column in zip(PLAN_NAMES, table.T, strict=True):
        all_finite(Topic.PLAN, name, column)
    return stamp_ns, PlanTrajectory(times_s, *(np.ascontiguousarray(c) for c in table.T))
