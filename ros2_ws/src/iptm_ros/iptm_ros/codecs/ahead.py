"""What lies ahead of the ego vehicle, as messages: its plan, and the road.

The slope of the road is given over position, its bounds by kind and place, each with its speed and the end
of its validity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.road_ahead import RoadAhead, SpeedLimits, Stop
from iptm_core.state import FloatArray, SlopePreview
from iptm_ros.codecs.cdr import (
    FRAME_AT,
    Stamped,
    Writer,
    ns_from_time,
    put_stamp,
    reject,
    stamp_ns_of,
    time_from_ns,
)
from iptm_ros.codecs.motion import (
    all_finite,
    decode_table,
    increasing,
    table_bytes,
)
from iptm_ros.message_types import Float64MultiArray, JointState, MultiArrayDimension, PointCloud2
from iptm_ros.topics import ROAD_FRAME, TOPICS, Topic, frame_in

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


def plan_bytes(plan: PlanTrajectory, stamp_ns: int, prefix: str) -> bytes:
    """Return a plan as the bytes of a message, stamped with the state that it starts from.

    Its frame has the prefix of a vehicle.
    """
    columns = dict(zip(PLAN_NAMES, vars(plan).values(), strict=True))
    return table_bytes(Topic.PLAN, stamp_ns, columns, prefix)


def decode_plan(
    message: PointCloud2 | Stamped[dict[str, FloatArray]],
) -> tuple[int, PlanTrajectory]:
    """Return the stamp (ns) and the plan.

    Raises:
        MessageError: see `decode_table`.
    """
    stamp_ns, columns = decode_table(Topic.PLAN, message)
    return stamp_ns, PlanTrajectory(*columns.values())


LEAD_VEHICLE, SPEED_LIMIT, STOP = TOPICS[Topic.ROAD_AHEAD].fields
_SLOPE_LABEL = ", ".join(TOPICS[Topic.SLOPE].fields)
_LONGEST_FRAME = 256
_NOTHING_KNOWN = RoadAhead(has_leader=False)


def encode_road_ahead(
    road: RoadAhead | None, stamp_ns: int, prefix: str = "", *, has_leader: bool
) -> JointState:
    """Return the road ahead as a message, its frame with the prefix of a vehicle."""
    known = road or _NOTHING_KNOWN
    rows: list[tuple[str, float, float, float]] = []
    if has_leader:
        rows.append((LEAD_VEHICLE, math.nan, math.nan, math.inf))
    if known.limits is not None:
        places, limits = known.limits.starts_m.tolist(), known.limits.limits_m_s.tolist()
        rows += [
            (SPEED_LIMIT, at_m, limit, math.inf) for at_m, limit in zip(places, limits, strict=True)
        ]
    rows += [(STOP, stop.position_m, 0.0, stop.until_s) for stop in known.stops]
    message = JointState(
        name=[row[0] for row in rows],
        position=[row[1] for row in rows],
        velocity=[row[2] for row in rows],
        effort=[row[3] for row in rows],
    )
    message.header.stamp = time_from_ns(stamp_ns)
    message.header.frame_id = frame_in(prefix, ROAD_FRAME)
    return message


def road_ahead_bytes(
    road: RoadAhead | None, stamp_ns: int, prefix: str, *, has_leader: bool
) -> bytes | JointState:
    """Return `encode_road_ahead`, as bytes where nothing but the lead vehicle is known."""
    if road is not None:
        return encode_road_ahead(road, stamp_ns, prefix, has_leader=has_leader)
    data = bytearray(_without_bounds(frame_in(prefix, ROAD_FRAME), has_leader=has_leader))
    put_stamp(data, stamp_ns)
    return bytes(data)


def road_of(topic: Topic, data: bytes) -> Stamped[RoadAhead] | None:
    """Return a road of which nothing but the lead vehicle is known; None for bytes of another form."""
    if topic is not Topic.ROAD_AHEAD or len(data) < FRAME_AT:
        return None
    frame_bytes = int.from_bytes(data[FRAME_AT - 4 : FRAME_AT], "little")
    for known in (True, False) if 0 < frame_bytes <= _LONGEST_FRAME else ():
        form = _without_bounds("-" * (frame_bytes - 1), has_leader=known)
        if data[FRAME_AT + frame_bytes :] == form[FRAME_AT + frame_bytes :]:
            return Stamped(stamp_ns_of(data), RoadAhead(known))
    return None


@lru_cache(maxsize=16)
def _without_bounds(frame: str, *, has_leader: bool) -> bytes:
    message, writer = encode_road_ahead(None, 0, has_leader=has_leader), Writer(frame)
    writer.put("I", len(message.name))
    for name in message.name:
        writer.put_text(name)
    for values in (message.position, message.velocity, message.effort):
        writer.put("I", len(values))
        if values:
            writer.put("d", *values)
    return bytes(writer.data)


def decode_road_ahead(message: JointState | Stamped[RoadAhead]) -> tuple[int, RoadAhead]:
    """Return stamp (ns) and road ahead of a message; bounds of an unknown kind are refused.

    Raises:
        MessageError: lengths differ, a kind is unknown, or a bound is none.
    """
    if isinstance(message, Stamped):
        return message.stamp_ns, message.value
    columns = (message.position, message.velocity, message.effort)
    count = len(message.name)
    if any(len(column) != count for column in columns):
        sizes = ", ".join(str(len(column)) for column in columns)
        reject(Topic.ROAD_AHEAD, f"{count} names, but {sizes} positions, velocities and efforts")
    limits: list[tuple[float, float]] = []
    stops: list[Stop] = []
    for kind, place_m, speed_m_s, until_s in zip(message.name, *columns, strict=True):
        if kind == SPEED_LIMIT:
            limits.append((place_m, speed_m_s))
        elif kind == STOP and math.isfinite(place_m) and not math.isnan(until_s):
            stops.append(Stop(place_m, until_s))
        elif kind != LEAD_VEHICLE:
            reject(
                Topic.ROAD_AHEAD,
                f"bound is {kind} at {place_m} m until {until_s} s; allowed: {LEAD_VEHICLE}, "
                f"{SPEED_LIMIT} and {STOP} at finite places",
            )
    if stops and not limits:
        reject(Topic.ROAD_AHEAD, f"{len(stops)} stops without a speed limit; allowed: with one")
    try:
        known = SpeedLimits(*np.array(limits).T) if limits else None
    except RouteError as error:
        reject(Topic.ROAD_AHEAD, str(error))
    stops.sort(key=lambda stop: stop.position_m)
    road = RoadAhead(LEAD_VEHICLE in message.name, known, tuple(stops))
    return ns_from_time(message.header.stamp), road


def has_leader(data: bytes) -> bool:
    """Return whether a serialised road ahead states a lead vehicle, without decoding it."""
    return LEAD_VEHICLE.encode() in data


def encode_slope(slope: SlopePreview) -> Float64MultiArray:
    """Return the slope over position as a 2 x N array: positions (m), then slopes (rad)."""
    count = int(slope.positions_m.size)
    message = Float64MultiArray()
    message.layout.dim = [
        MultiArrayDimension(label=_SLOPE_LABEL, size=2, stride=2 * count),
        MultiArrayDimension(label="node", size=count, stride=count),
    ]
    message.data = np.concatenate((slope.positions_m, slope.slopes_rad)).tolist()
    return message


def decode_slope(message: Float64MultiArray) -> SlopePreview:
    """Return the slope over position.

    Raises:
        MessageError: the layout is not 2 x N, N is 0, a value is not finite, the
            positions do not increase, or a slope is as steep as a wall.
    """
    topic = Topic.SLOPE
    sizes = [int(dimension.size) for dimension in message.layout.dim]
    if len(sizes) != 2 or sizes[0] != 2 or sizes[1] < 1:
        reject(topic, f"layout is {sizes}; allowed: [2, N] with N at least 1")
    if message.layout.data_offset != 0 or len(message.data) != 2 * sizes[1]:
        reject(topic, f"{len(message.data)} values; allowed: {2 * sizes[1]} without offset")
    values = np.array(message.data, dtype=np.float64)
    positions_m, slopes_rad = values[: sizes[1]], values[sizes[1] :]
    all_finite(topic, "positions", positions_m)
    all_finite(topic, "slopes", slopes_rad)
    increasing(topic, "positions", positions_m)
    if float(np.abs(slopes_rad).max()) >= math.pi / 2.0:
        reject(topic, f"slope is {np.abs(slopes_rad).max()} rad; allowed: below pi/2")
    return SlopePreview(positions_m, slopes_rad)
