"""Predicted motions as tables: previews of the leader, measured samples of it, and plans."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.state import SPEED_AT_REST_M_S, FloatArray, LeaderPreview
from iptm_ros.codecs.cdr import Stamped, reject
from iptm_ros.codecs.table import (
    BOUND,
    POSITION,
    SPEED,
    TIME,
    decode_table,
    encode_table,
    table_bytes,
)
from iptm_ros.message_types import PointCloud2
from iptm_ros.topics import TOPICS, Topic


def encode_leader_preview(
    preview: LeaderPreview, stamp_ns: int, topic: Topic = Topic.LEADER_PREVIEW
) -> PointCloud2:
    """Return a prediction as a message.

    Raises:
        MessageError: the arrays differ in length, or a time is not finite.
    """
    return encode_table(topic, stamp_ns, _of_preview(preview))


def leader_preview_bytes(
    preview: LeaderPreview, stamp_ns: int, prefix: str, topic: Topic = Topic.LEADER_PREVIEW
) -> bytes:
    """Return the bytes of `encode_leader_preview`, its frame with the prefix of a vehicle."""
    return table_bytes(topic, stamp_ns, _of_preview(preview), prefix)


def _of_preview(preview: LeaderPreview) -> dict[str, FloatArray]:
    columns = {TIME: preview.times_s, POSITION: preview.positions_m, SPEED: preview.speeds_m_s}
    return columns | {BOUND: preview.bounds_m} if preview.bounds_m.size else columns


def decode_leader_preview(
    message: PointCloud2 | Stamped[dict[str, FloatArray]], topic: Topic = Topic.LEADER_PREVIEW
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
    if topic is Topic.LEADER_PREVIEW:
        backwards_m = SPEED_AT_REST_M_S * np.maximum(times_s[1:] - times_s[:-1], 1.0)
        if (positions_m[1:] - positions_m[:-1] < backwards_m).any():
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
    return encode_table(Topic.PLAN, stamp_ns, _of_plan(plan))


def plan_bytes(plan: PlanTrajectory, stamp_ns: int, prefix: str) -> bytes:
    """Return the bytes of `encode_plan`, its frame with the prefix of a vehicle."""
    return table_bytes(Topic.PLAN, stamp_ns, _of_plan(plan), prefix)


def _of_plan(plan: PlanTrajectory) -> dict[str, FloatArray]:
    return dict(zip(PLAN_NAMES, vars(plan).values(), strict=True))


def decode_plan(
    message: PointCloud2 | Stamped[dict[str, FloatArray]],
) -> tuple[int, PlanTrajectory]:
    """Return the stamp (ns) and the plan.

    Raises:
        MessageError: see `decode_table`.
    """
    stamp_ns, columns = decode_table(Topic.PLAN, message)
    return stamp_ns, PlanTrajectory(*columns.values())
