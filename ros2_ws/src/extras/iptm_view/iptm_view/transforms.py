"""Transforms of REP 105 for viewers: map -> odom -> base_link -> battery_pack, and odom -> leader.

In `odom` the road is pulled straight, as in the odometry: the ego vehicle drives along x. `map` has the shape
of the road, so `map -> odom` moves as the ego vehicle turns and climbs, as a localisation's correction does.

`tf2_msgs` is part of every ROS 2 installation, but not of the wheels.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from iptm_core.routes.route import RoadCourse
from iptm_core.state import FloatArray
from iptm_ros.codecs.cdr import time_from_ns
from iptm_ros.topics import (
    EGO_FRAME,
    LEADER_FRAME,
    MAP_FRAME,
    PACK_FRAME,
    ROAD_FRAME,
    frame_in,
)
from iptm_view.scene import EGO_LENGTH_M, LEADER_LENGTH_M, PACK_PLACE_M, Scene

ABSENT = (
    "tf2_msgs is not installed, so no transforms are published; paths and markers are in the frame map and "
    "need none"
)
_DEPTH = 100
_UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


class TransformPublisher:
    """Publishes the transforms of a scene where the message type exists.

    Attributes:
        is_available: whether it does.
    """

    def __init__(self, node: Node, prefix: str) -> None:
        """Publish what never changes; without the message type warn once."""
        self._prefix = prefix
        self.is_available = False
        try:
            messages: Any = importlib.import_module("tf2_msgs.msg")
        except ImportError:
            node.get_logger().info(ABSENT)
            return
        self.is_available = True
        self._type = messages.TFMessage
        # QoS as of tf2's own broadcasters.
        self._publisher = node.create_publisher(self._type, "/tf", QoSProfile(depth=_DEPTH))
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._static_publisher = node.create_publisher(self._type, "/tf_static", latched)
        pack = transform(0, EGO_FRAME, PACK_FRAME, np.array(PACK_PLACE_M), _UPRIGHT, prefix)
        self._static_publisher.publish(self._type(transforms=[pack]))

    def publish(self, scene: Scene, course: RoadCourse) -> None:
        """Publish the transforms of a scene."""
        if self.is_available:
            found = scene_transforms(scene, course, self._prefix)
            self._publisher.publish(self._type(transforms=found))


def scene_transforms(scene: Scene, course: RoadCourse, prefix: str) -> list[TransformStamped]:
    """Return the transforms of a scene."""
    ego = course.poses(scene.ego.position_m, EGO_LENGTH_M)
    turn, place_m = ego.quaternions()[0], ego.points_m[0]
    along_m = np.array([scene.ego.position_m, 0.0, 0.0])
    stamp_ns = scene.stamp_ns
    found = [
        transform(stamp_ns, MAP_FRAME, ROAD_FRAME, place_m - rotated(turn, along_m), turn, prefix),
        transform(stamp_ns, ROAD_FRAME, EGO_FRAME, along_m, _UPRIGHT, prefix),
    ]
    if scene.leader is not None:
        leader = course.poses(scene.leader.position_m, LEADER_LENGTH_M)
        back = inverse(turn)
        seen_m = along_m + rotated(back, leader.points_m[0] - place_m)
        seen_turn = product(back, leader.quaternions()[0])
        found.append(transform(stamp_ns, ROAD_FRAME, LEADER_FRAME, seen_m, seen_turn, prefix))
    return found


def transform(
    stamp_ns: int,
    parent: str,
    child: str,
    place_m: FloatArray,
    turn: FloatArray,
    prefix: str,
) -> TransformStamped:
    """Return one transform as a message; frames come from the topic table."""
    message = TransformStamped()
    message.header.stamp = time_from_ns(stamp_ns)
    message.header.frame_id = frame_in(prefix, parent)
    message.child_frame_id = frame_in(prefix, child)
    for axis, value in zip("xyz", place_m.tolist(), strict=True):
        setattr(message.transform.translation, axis, value)
    for axis, value in zip("xyzw", turn.tolist(), strict=True):
        setattr(message.transform.rotation, axis, value)
    return message


def rotated(turn: FloatArray, vector: FloatArray) -> FloatArray:
    """Return a vector turned by a unit quaternion (x y z w)."""
    axis, scalar = turn[:3], turn[3]
    first = 2.0 * np.cross(axis, vector)
    result: FloatArray = vector + scalar * first + np.cross(axis, first)
    return result


def inverse(turn: FloatArray) -> FloatArray:
    """Return the unit quaternion that turns back."""
    result: FloatArray = turn * np.array([-1.0, -1.0, -1.0, 1.0])
    return result


def product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the unit quaternion that turns by the second, then by the first."""
    axis = first[3] * second[:3] + second[3] * first[:3] + np.cross(first[:3], second[:3])
    return np.append(axis, first[3] * second[3] - first[:3] @ second[:3])
