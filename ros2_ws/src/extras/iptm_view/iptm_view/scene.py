"""The scene of the visualizer: paths along the road, both cars as markers, and a URDF of the ego vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Vector3
from nav_msgs.msg import Path
from rclpy.duration import Duration
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from iptm_core.parameters import ModelParameters
from iptm_core.physics.car_following import minimum_gap_m
from iptm_core.routes.route import RoadCourse, RoadPoses
from iptm_core.settings import VEHICLE_LENGTH_M
from iptm_core.state import NS_PER_S, FloatArray, LeaderState
from iptm_core.units import KM_H_PER_M_S
from iptm_ros.codecs.cdr import time_from_ns, time_from_s
from iptm_ros.topics import EGO_FRAME, MAP_FRAME, PACK_FRAME, frame_in

Triple = tuple[float, float, float]

# The model has none of these: they are for drawing, of a car of the compact class.
WIDTH_M = 1.8
CLEARANCE_M = 0.2
_AXLES_M = (-0.85, -3.55)  # behind the front bumper, where the frame of the body lies
_TYRE_WIDTH_M = 0.2
_PACK_SIZE_M = (2.0, 1.4, 0.12)

PACK_PLACE_M: Triple = (-0.5 * VEHICLE_LENGTH_M, 0.0, CLEARANCE_M + 0.5 * _PACK_SIZE_M[2])
"""Middle of the battery pack in the frame of the body."""


def body_size_m(parameters: ModelParameters) -> Triple:
    """Return length, width and height of the body, whose front has the area of the parameter set."""
    return VEHICLE_LENGTH_M, WIDTH_M, parameters.body.frontal_area_m2 / WIDTH_M


def vehicle_urdf(parameters: ModelParameters, prefix: str = "") -> str:
    """Return the URDF of the ego vehicle: body, wheels and the battery pack in it.

    It has no masses: it is made to be looked at.
    """
    body, pack = frame_in(prefix, EGO_FRAME), frame_in(prefix, PACK_FRAME)
    robot = ET.Element("robot", name="iptm_vehicle")
    size = body_size_m(parameters)
    link = ET.SubElement(robot, "link", name=body)
    place = (-0.5 * VEHICLE_LENGTH_M, 0.0, CLEARANCE_M + 0.5 * size[2])
    _box(link, size, place, "body", (0.0, 0.45, 0.7, 0.5))
    radius_m = parameters.powertrain.wheel_radius_m
    for x in _AXLES_M:
        for y in (-0.5 * (WIDTH_M - _TYRE_WIDTH_M), 0.5 * (WIDTH_M - _TYRE_WIDTH_M)):
            visual = _visual(link, (x, y, radius_m), "tyre", (0.1, 0.1, 0.1, 1.0), "1.570796 0 0")
            ET.SubElement(
                ET.SubElement(visual, "geometry"),
                "cylinder",
                radius=f"{radius_m:g}",
                length=f"{_TYRE_WIDTH_M:g}",
            )
    link = ET.SubElement(robot, "link", name=pack)
    _box(link, _PACK_SIZE_M, (0.0, 0.0, 0.0), "pack", (0.9, 0.6, 0.0, 1.0))
    joint = ET.SubElement(robot, "joint", name=f"{body}_to_{pack}", type="fixed")
    ET.SubElement(joint, "parent", link=body)
    ET.SubElement(joint, "child", link=pack)
    ET.SubElement(joint, "origin", xyz=_words(PACK_PLACE_M), rpy="0 0 0")
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _box(
    link: ET.Element, size_m: Triple, place_m: Triple, name: str, color: tuple[float, ...]
) -> None:
    visual = _visual(link, place_m, name, color)
    ET.SubElement(ET.SubElement(visual, "geometry"), "box", size=_words(size_m))


def _visual(
    link: ET.Element,
    place_m: Triple,
    material: str,
    color: tuple[float, ...],
    rpy: str = "0 0 0",
) -> ET.Element:
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz=_words(place_m), rpy=rpy)
    ET.SubElement(ET.SubElement(visual, "material", name=material), "color", rgba=_words(color))
    return visual


def _words(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:.6g}" for number in numbers)


EGO_LENGTH_M = -VEHICLE_LENGTH_M
"""From the position of the ego vehicle, its front bumper, to its other end."""
LEADER_LENGTH_M = VEHICLE_LENGTH_M
"""From the position of the leader, its rear bumper, to its other end."""

MARKER_LIFETIME_S = 3.0
"""Shortest time after which a viewer removes markers that are not published again."""
_LIFETIME_SCENES = 4

_ROAD_POSES = 2000
_FINEST_SPACING_M = 5.0
_LANE_WIDTH_M = 3.5
_BAR_M = (0.3, 0.1)
_TEXT_M = 1.5
_EGO_COLOR = (0.0, 0.45, 0.7, 0.9)
_LEADER_COLOR = (0.84, 0.37, 0.0, 0.9)
_NEAREST_COLOR = (0.8, 0.1, 0.1, 0.9)
_FARTHEST_COLOR = (0.2, 0.5, 0.9, 0.9)
_TEXT_COLOR = (1.0, 1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Scene:
    """Both cars at one instant.

    Attributes:
        stamp_ns: the instant.
        ego: ego vehicle, of which the front bumper counts.
        leader: position of its rear bumper; None without a leader.
        warmest_cell_c: temperature of the warmest cell, None where it is not known.
    """

    stamp_ns: int
    ego: LeaderState
    leader: LeaderState | None
    warmest_cell_c: float | None = None


def path_message(
    course: RoadCourse,
    stamp_ns: int,
    positions_m: FloatArray,
    length_m: float,
    times_s: FloatArray | None = None,
) -> Path:
    """Return positions along the road as poses on it.

    Args:
        course: the road.
        stamp_ns: of the message.
        positions_m: shape (n,).
        length_m: of the body that stands there, see `RoadCourse.poses`.
        times_s: when each pose is reached, shape (n,); None stamps them like the message.
    """
    message = Path()
    message.header.stamp = time_from_ns(stamp_ns)
    message.header.frame_id = MAP_FRAME
    if positions_m.size:
        poses = pose_messages(course.poses(positions_m, length_m))
        message.poses = [PoseStamped(header=message.header, pose=pose) for pose in poses]
    if times_s is not None:
        for entry, time_s in zip(message.poses, times_s.tolist(), strict=True):
            entry.header = type(message.header)(frame_id=MAP_FRAME, stamp=time_from_s(time_s))
    return message


def road_message(course: RoadCourse, stamp_ns: int) -> Path:
    """Return the whole road from the start of the trip: as long as its line, else as its slope is known."""
    line = course.line
    end_m = float(course.slope.positions_m[-1]) if line is None else line.length_m
    spacing_m = max(_FINEST_SPACING_M, end_m / _ROAD_POSES)
    positions_m: FloatArray = np.arange(0.0, end_m + spacing_m, spacing_m, dtype=np.float64)
    return path_message(course, stamp_ns, positions_m, VEHICLE_LENGTH_M)


def scene_message(
    scene: Scene, course: RoadCourse, parameters: ModelParameters, interval_s: float = 0.0
) -> MarkerArray:
    """Return the markers of a scene; those that it does not have are deleted.

    Markers expire, so that none remains when the publisher ends. Viewers count the lifetime in their own
    time, which may be the trip time: it covers several scenes in either.
    """
    ego, leader = scene.ego, scene.leader
    size_m = body_size_m(parameters)
    words = [f"{KM_H_PER_M_S * ego.speed_m_s:.0f} km/h"]
    markers = {"ego": _car(course, ego.position_m, EGO_LENGTH_M, size_m, _EGO_COLOR)}
    if leader is not None:
        words.append(f"gap {leader.position_m - ego.position_m:.0f} m")
        markers["leader"] = _car(course, leader.position_m, LEADER_LENGTH_M, size_m, _LEADER_COLOR)
        gap, limits = parameters.gap, parameters.limits
        nearest_m = float(minimum_gap_m(ego.speed_m_s, leader.speed_m_s, gap, limits))
        for name, gap_m, color in (
            ("s_min", nearest_m, _NEAREST_COLOR),
            ("s_max", gap.max_gap_m, _FARTHEST_COLOR),
        ):
            markers[name] = _bar(course, leader.position_m - gap_m, color)
    if scene.warmest_cell_c is not None:
        words.append(f"{scene.warmest_cell_c:.1f} °C")
    above = course.poses(ego.position_m - 0.5 * VEHICLE_LENGTH_M, EGO_LENGTH_M)
    markers["state"] = _marker(
        Marker.TEXT_VIEW_FACING, above, 4.0, (0.0, 0.0, _TEXT_M), _TEXT_COLOR
    )
    markers["state"].text = ", ".join(words)
    for name in ("leader", "s_min", "s_max"):
        markers.setdefault(name, Marker(action=Marker.DELETE))
    lifetime_s = max(MARKER_LIFETIME_S, _LIFETIME_SCENES * interval_s)
    for name, marker in markers.items():
        marker.ns = name
        marker.lifetime = Duration(nanoseconds=round(lifetime_s * NS_PER_S)).to_msg()
        marker.header.frame_id = MAP_FRAME
        marker.header.stamp = time_from_ns(scene.stamp_ns)
    return MarkerArray(markers=list(markers.values()))


def _car(
    course: RoadCourse,
    position_m: float,
    length_m: float,
    size_m: tuple[float, float, float],
    color: tuple[float, ...],
) -> Marker:
    # A box has its origin in its middle; both ends of the car are on the road.
    poses = course.poses(position_m, length_m)
    middle = 0.5 * (poses.points_m + course.points_m(np.array([position_m + length_m])))
    placed = RoadPoses(middle, poses.yaws_rad, poses.grades_rad)
    return _marker(Marker.CUBE, placed, CLEARANCE_M + 0.5 * size_m[2], size_m, color)


def _bar(course: RoadCourse, position_m: float, color: tuple[float, ...]) -> Marker:
    length_m, height_m = _BAR_M
    size_m = (length_m, _LANE_WIDTH_M, height_m)
    return _marker(
        Marker.CUBE, course.poses(position_m, EGO_LENGTH_M), 0.5 * height_m, size_m, color
    )


def _marker(
    kind: int,
    poses: RoadPoses,
    height_m: float,
    size_m: tuple[float, float, float],
    color: tuple[float, ...],
) -> Marker:
    lifted_m = poses.points_m + np.array([0.0, 0.0, height_m])
    raised = RoadPoses(lifted_m, poses.yaws_rad, poses.grades_rad)
    red, green, blue, alpha = color
    return Marker(
        type=kind,
        action=Marker.ADD,
        pose=pose_messages(raised)[0],
        scale=Vector3(x=float(size_m[0]), y=float(size_m[1]), z=float(size_m[2])),
        color=ColorRGBA(r=red, g=green, b=blue, a=alpha),
    )


def pose_messages(poses: RoadPoses) -> Sequence[Pose]:
    """Return poses on the road as messages."""
    return [
        Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))
        for (x, y, z), (qx, qy, qz, qw) in zip(
            poses.points_m.tolist(), poses.quaternions().tolist(), strict=True
        )
    ]
