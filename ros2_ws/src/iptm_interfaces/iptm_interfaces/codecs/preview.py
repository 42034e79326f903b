"""What lies ahead: the predicted motion of the leader and the slope of the road.

A prediction carries two times: the stamp of its publication and the instant of its generation, which
is the time of its first point. Where it is uncertain, a second joint has its bounds.
`codecs/preview_wire.py` does the same as the functions here, faster, on serialised bytes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from iptm_core.state import SPEED_AT_REST_M_S, FloatArray, LeaderPreview, SlopePreview
from iptm_interfaces.codecs._checks import all_finite, increasing, reject
from iptm_interfaces.codecs.time import (
    duration_from_ns,
    ns_from_duration,
    ns_from_time,
    time_from_ns,
)
from iptm_interfaces.message_types import (
    Float64MultiArray,
    JointTrajectory,
    JointTrajectoryPoint,
    MultiArrayDimension,
)
from iptm_interfaces.topics import ROAD_FRAME, TOPICS, Topic

PREVIEW_NAMES = list(TOPICS[Topic.LEADER_PREVIEW].fields)
KNOWN_NAMES = PREVIEW_NAMES[:1]
"""Those of a prediction without bounds."""
_SLOPE_LABEL = ", ".join(TOPICS[Topic.SLOPE].fields)
_TOPIC = Topic.LEADER_PREVIEW


def encode_leader_preview(preview: LeaderPreview, stamp_ns: int) -> JointTrajectory:
    """Return a prediction as a message.

    Args:
        preview: prediction, n nodes; may be empty.
        stamp_ns: instant of publication; never changes the instant of generation.

    Raises:
        MessageError: the arrays differ in length, or the first node is not the generation.
    """
    offsets = offsets_ns(preview, stamp_ns)
    positions, velocities = preview_columns(preview)
    points = [
        JointTrajectoryPoint(
            positions=row_positions,
            velocities=row_velocities,
            time_from_start=duration_from_ns(offset_ns),
        )
        for offset_ns, row_positions, row_velocities in zip(
            offsets.tolist(), positions.tolist(), velocities.tolist(), strict=True
        )
    ]
    names = PREVIEW_NAMES if preview.bounds_m.size else KNOWN_NAMES
    message = JointTrajectory(joint_names=names, points=points)
    message.header.stamp = time_from_ns(stamp_ns)
    message.header.frame_id = ROAD_FRAME
    return message


def preview_columns(preview: LeaderPreview) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities of the joints at the nodes, shape (n, 1), with bounds (n, 2) each.

    The velocity of the bound is its mean rate up to the next node, 0 at the last one.
    """
    positions, speeds, bounds = preview.positions_m, preview.speeds_m_s, preview.bounds_m
    if not bounds.size:
        return positions[:, None], speeds[:, None]
    rates = np.zeros(bounds.size)
    rates[:-1] = np.diff(bounds) / np.maximum(np.diff(preview.times_s), 1e-9)
    return np.column_stack([positions, bounds]), np.column_stack([speeds, rates])


def offsets_ns(preview: LeaderPreview, stamp_ns: int) -> NDArray[np.int64]:
    """Return the node times relative to the stamp in integer nanoseconds, shape (n,).

    Raises:
        MessageError: the arrays differ in length, a time is not finite, or the first node is not
            the instant of generation.
    """
    count = preview.times_s.size
    if preview.positions_m.size != count or preview.speeds_m_s.size != count:
        sizes = f"{count}, {preview.positions_m.size}, {preview.speeds_m_s.size}"
        reject(_TOPIC, f"times, positions and speeds have {sizes} entries; allowed: equal numbers")
    if preview.bounds_m.size not in {0, count}:
        reject(_TOPIC, f"bounds have {preview.bounds_m.size} entries; allowed: 0 or {count}")
    if count == 0:
        return np.empty(0, dtype=np.int64)
    all_finite(_TOPIC, "times", preview.times_s)
    if preview.times_s[0] != preview.generated_at_s:
        reject(
            _TOPIC,
            f"first node lies at {preview.times_s[0]} s; allowed: the instant of generation, "
            f"{preview.generated_at_s} s",
        )
    absolute: NDArray[np.int64] = np.rint(preview.times_s * 1e9).astype(np.int64)
    return absolute - stamp_ns


def decode_leader_preview(message: JointTrajectory) -> tuple[int, LeaderPreview]:
    """Return the stamp (ns) and the prediction.

    Raises:
        MessageError: wrong joint names, a point without exactly one position and one velocity for each, a
            value that is not finite, times that do not increase, a leader that drives backwards, a negative
            bound, or a generation after the publication.
    """
    stamp_ns = ns_from_time(message.header.stamp)
    names = list(message.joint_names)
    if sorted(names) not in (KNOWN_NAMES, PREVIEW_NAMES):
        reject(_TOPIC, f"joint_names are {names}; allowed: {KNOWN_NAMES} or {PREVIEW_NAMES}")
    points = message.points
    for index, point in enumerate(points):
        if len(point.positions) != len(names) or len(point.velocities) != len(names):
            reject(
                _TOPIC,
                f"point {index} has {len(point.positions)} positions and {len(point.velocities)} "
                f"velocities; allowed: {len(names)} of each",
            )
    places = [names.index(name) for name in PREVIEW_NAMES if name in names]
    columns = [
        np.array([point.positions[place] for point in points], dtype=np.float64) for place in places
    ]
    preview = build_leader_preview(
        stamp_ns,
        np.array([ns_from_duration(point.time_from_start) for point in points], dtype=np.int64),
        columns[0],
        np.array([point.velocities[places[0]] for point in points], dtype=np.float64),
        columns[1] if len(columns) > 1 else np.empty(0),
    )
    return stamp_ns, preview


def build_leader_preview(
    stamp_ns: int,
    node_offsets_ns: NDArray[np.int64],
    positions_m: FloatArray,
    speeds_m_s: FloatArray,
    bounds_m: FloatArray,
    topic: Topic = _TOPIC,
) -> LeaderPreview:
    """Return a checked prediction from decoded arrays, shape (n,) each; the bounds may be empty.

    Measured positions, those of ``v2x/leader_samples``, may go back and forth; predicted ones may not.

    Raises:
        MessageError: see `decode_leader_preview`.
    """
    if node_offsets_ns.size == 0:
        return LeaderPreview.empty()
    if node_offsets_ns[0] > 0:
        reject(
            topic,
            f"generated {node_offsets_ns[0]} ns after its publication; allowed: at most 0",
        )
    times_s = (node_offsets_ns + stamp_ns) / 1e9
    increasing(topic, "times", times_s)
    all_finite(topic, "positions", positions_m)
    all_finite(topic, "speeds", speeds_m_s)
    if float(speeds_m_s.min()) < SPEED_AT_REST_M_S:
        reject(topic, f"speed is {speeds_m_s.min()}; allowed: at least {SPEED_AT_REST_M_S:g} m/s")
    if bounds_m.size:
        all_finite(topic, "bounds", bounds_m)
        if float(bounds_m.min()) < 0.0:
            reject(topic, f"bound is {bounds_m.min()} m; allowed: at least 0 m")
    backwards_m = SPEED_AT_REST_M_S * np.maximum(np.diff(times_s), 1.0)
    if topic is _TOPIC and (np.diff(positions_m) < backwards_m).any():
        reject(topic, "positions decrease; allowed: a leader that never drives backwards")
    return LeaderPreview(float(times_s[0]), times_s, positions_m, speeds_m_s, bounds_m)


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
