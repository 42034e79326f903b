"""The whole plan of the controller with its node times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from iptm_core.state import FloatArray
from iptm_interfaces.codecs._checks import all_finite, increasing, reject
from iptm_interfaces.codecs.time import (
    duration_from_ns,
    ns_from_duration,
    ns_from_time,
    time_from_ns,
)
from iptm_interfaces.topics import ROAD_FRAME, TOPICS, Topic

PLAN_NAMES = list(TOPICS[Topic.PLAN].fields)


@dataclass(frozen=True)
class PlanTrajectory:
    """Predicted motion, temperatures and inputs of the host at the nodes of the horizon.

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
    """Return a plan as a message, stamped with the state that it starts from.

    Raises:
        MessageError: the arrays differ in length.
    """
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
    offsets = (np.rint(plan.times_s * 1e9).astype(np.int64) - stamp_ns).tolist()
    points = [
        JointTrajectoryPoint(positions=row, time_from_start=duration_from_ns(offset))
        for offset, row in zip(offsets, np.column_stack(columns).tolist(), strict=True)
    ]
    message = JointTrajectory(joint_names=PLAN_NAMES, points=points)
    message.header.stamp = time_from_ns(stamp_ns)
    message.header.frame_id = ROAD_FRAME
    return message


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
