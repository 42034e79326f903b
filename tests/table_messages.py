"""Tables of previews, samples and plans as message objects; one is laid out apart from the suite's bytes."""

from __future__ import annotations

from array import array
from collections.abc import Mapping

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2, PointField

from iptm_core.state import FloatArray, LeaderPreview
from iptm_ros.codecs import PlanTrajectory, leader_preview_bytes, plan_bytes, time_from_ns
from iptm_ros.topics import ROAD_FRAME, Topic


def encode_table(stamp_ns: int, columns: Mapping[str, FloatArray]) -> PointCloud2:
    """Return columns as points: `x`, `y`, `z` in float32, a gap, and the columns in float64."""
    count, step = columns["time_s"].size, 16 + 8 * len(columns)
    points = np.zeros((count, step), np.uint8)
    points[:, :4] = columns["position_m"].astype("<f4").reshape(-1, 1).view(np.uint8)
    points[:, 16:] = np.column_stack(list(columns.values())).astype("<f8").view(np.uint8)
    message = PointCloud2(height=1, width=count, point_step=step, row_step=points.size)
    message.is_dense, message.data = True, array("B", points.tobytes())
    kinds = (PointField.FLOAT32, PointField.FLOAT64)
    places = [("x", 0, 0), ("y", 4, 0), ("z", 8, 0)]
    places += [(name, 16 + 8 * place, 1) for place, name in enumerate(columns)]
    message.fields = [
        PointField(name=name, offset=offset, datatype=kinds[kind], count=1)
        for name, offset, kind in places
    ]
    message.header.stamp = time_from_ns(stamp_ns)
    message.header.frame_id = ROAD_FRAME
    return message


def encode_leader_preview(
    preview: LeaderPreview, stamp_ns: int, topic: Topic = Topic.LEADER_PREVIEW
) -> PointCloud2:
    """Return a preview, or measured samples, as the message that the suite sends."""
    return deserialize_message(leader_preview_bytes(preview, stamp_ns, "", topic), PointCloud2)


def encode_plan(plan: PlanTrajectory, stamp_ns: int) -> PointCloud2:
    """Return a plan as the message that the suite sends."""
    return deserialize_message(plan_bytes(plan, stamp_ns, ""), PointCloud2)
