"""Messages for viewers: paths, markers, transforms and the description of the car."""

from __future__ import annotations

import itertools
import math
import sys
from types import ModuleType, SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy
from visualization_msgs.msg import Marker

from iptm_core.errors import IptmError
from iptm_core.parameters import load_parameters
from iptm_core.physics.car_following import minimum_gap_m
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.route import RoadCourse
from iptm_core.settings import VEHICLE_LENGTH_M
from iptm_core.state import LeaderState, SlopePreview
from iptm_string.order import vehicles_in_string
from iptm_view.scene import (
    EGO_LENGTH_M,
    LEADER_LENGTH_M,
    PACK_PLACE_M,
    Scene,
    body_size_m,
    path_message,
    road_message,
    scene_message,
    vehicle_urdf,
)
from iptm_view.transforms import TransformPublisher, inverse, product, rotated, scene_transforms
from iptm_view.visualizer_node import VisualizerParameters

S = 10**9
PARAMETERS = load_parameters().values
STRAIGHT = RoadCourse(SlopePreview(np.array([0.0, 1000.0]), np.zeros(2)))
# North, then east, climbing.
BENT = RoadCourse(
    SlopePreview(np.array([0.0, 1000.0]), np.array([0.05, 0.05])),
    RoadLine(np.array([48.0, 48.001, 48.001]), np.array([10.0, 10.0, 10.01])),
)
SCENE = Scene(
    7 * S, LeaderState(7.0, 100.0, 20.0), LeaderState(7.0, 160.0, 15.0), warmest_cell_c=36.54
)


def test_a_path_tells_place_and_time_of_each_pose() -> None:
    path = path_message(STRAIGHT, 3 * S, np.array([10.0, 25.0]), EGO_LENGTH_M, np.array([3.0, 4.5]))
    assert path.header.frame_id == "map"
    assert [pose.pose.position.x for pose in path.poses] == [10.0, 25.0]
    stamps = [(pose.header.stamp.sec, pose.header.stamp.nanosec) for pose in path.poses]
    assert stamps == [(3, 0), (4, 500_000_000)]
    assert path_message(STRAIGHT, 0, np.empty(0), EGO_LENGTH_M).poses == []


def test_the_road_goes_as_far_as_it_is_known() -> None:
    assert road_message(STRAIGHT, 0).poses[-1].pose.position.x == pytest.approx(1000.0, abs=5.0)
    assert BENT.line is not None
    last = road_message(BENT, 0).poses[-1].pose.position
    expected = BENT.points_m([BENT.line.length_m])[0]
    assert [last.x, last.y] == pytest.approx(expected[:2].tolist(), abs=5.0)
    # Where nothing is known of its end there is still a place to stand on.
    nothing = RoadCourse(SlopePreview(np.zeros(1), np.zeros(1)))
    assert len(road_message(nothing, 0).poses) > 0


def test_markers_expire_after_several_scenes() -> None:
    """No marker outlives a visualizer that was killed, and none flickers in a run that flies by."""
    for interval_s, lifetime_s in ((0.0, 3), (0.1, 3), (15.0, 60)):
        scene = scene_message(SCENE, STRAIGHT, PARAMETERS, interval_s)
        assert {(m.lifetime.sec, m.lifetime.nanosec) for m in scene.markers} == {(lifetime_s, 0)}


def test_the_scene_by_hand() -> None:
    markers = {marker.ns: marker for marker in scene_message(SCENE, STRAIGHT, PARAMETERS).markers}
    assert set(markers) == {"ego", "leader", "s_min", "s_max", "state"}
    assert all(marker.header.frame_id == "map" for marker in markers.values())
    ego, leader = markers["ego"], markers["leader"]
    # The front bumper of the ego vehicle and the rear bumper of the leader are where they were measured.
    assert ego.pose.position.x + 0.5 * ego.scale.x == pytest.approx(100.0)
    assert leader.pose.position.x - 0.5 * leader.scale.x == pytest.approx(160.0)
    nearest_m = minimum_gap_m(20.0, 15.0, PARAMETERS.gap, PARAMETERS.limits)
    assert markers["s_min"].pose.position.x == pytest.approx(160.0 - nearest_m)
    assert markers["s_max"].pose.position.x == pytest.approx(160.0 - PARAMETERS.gap.max_gap_m)
    assert markers["state"].text == "72 km/h, gap 60 m, 36.5 °C"
    assert ego.scale.y * ego.scale.z == pytest.approx(PARAMETERS.body.frontal_area_m2)


@pytest.mark.parametrize("course", [STRAIGHT, BENT], ids=["straight", "bent"])
def test_vehicles_of_a_string_start_one_behind_the_other(course: RoadCourse) -> None:
    """All in the one frame `map`; the road before its beginning goes on straight."""
    places = []
    for vehicle in vehicles_in_string(3, 15.0, VEHICLE_LENGTH_M):
        scene = Scene(0, LeaderState(0.0, vehicle.start_position_m, 0.0), None)
        ego = scene_message(scene, course, PARAMETERS).markers[0]
        assert (ego.ns, ego.header.frame_id) == ("ego", "map")
        places.append([ego.pose.position.x, ego.pose.position.y])
    ahead = course.points_m([10.0])[0, :2] / 10.0
    for front, behind in itertools.pairwise(np.array(places)):
        np.testing.assert_allclose(
            front - behind, (15.0 + VEHICLE_LENGTH_M) * ahead, rtol=1e-4, atol=1e-6
        )


def test_markers_of_a_leader_that_is_gone_are_deleted() -> None:
    alone = Scene(SCENE.stamp_ns, SCENE.ego, None)
    markers = scene_message(alone, STRAIGHT, PARAMETERS).markers
    actions = {marker.ns: marker.action for marker in markers}
    assert {ns for ns, action in actions.items() if action == Marker.DELETE} == {
        "leader", "s_min", "s_max",
    }  # fmt: skip
    assert actions["ego"] == actions["state"] == Marker.ADD


def numbers(message: Any, axes: str) -> np.ndarray:
    return np.array([getattr(message, axis) for axis in axes])


@pytest.mark.parametrize("course", [STRAIGHT, BENT], ids=["straight", "bent"])
def test_transforms_put_both_cars_on_the_road(course: RoadCourse) -> None:
    to_map, to_ego, to_leader = scene_transforms(SCENE, course, "car_1")
    names = [(t.header.frame_id, t.child_frame_id) for t in (to_map, to_ego, to_leader)]
    assert names == [
        ("map", "car_1/odom"), ("car_1/odom", "car_1/base_link"), ("car_1/odom", "car_1/leader"),
    ]  # fmt: skip
    assert {t.header.stamp.sec for t in (to_map, to_ego, to_leader)} == {7}
    # As in the odometry: along x of odom.
    assert numbers(to_ego.transform.translation, "xyz").tolist() == [100.0, 0.0, 0.0]
    outer = numbers(to_map.transform.rotation, "xyzw")
    for moved, position_m, length_m in (
        (to_ego, 100.0, EGO_LENGTH_M), (to_leader, 160.0, LEADER_LENGTH_M),
    ):  # fmt: skip
        expected = course.poses(position_m, length_m)
        place = numbers(to_map.transform.translation, "xyz") + rotated(
            outer, numbers(moved.transform.translation, "xyz")
        )
        assert place == pytest.approx(expected.points_m[0], abs=1e-6)
        turn = product(outer, numbers(moved.transform.rotation, "xyzw"))
        assert product(inverse(turn), expected.quaternions()[0]) == pytest.approx(
            np.array([0.0, 0.0, 0.0, 1.0]), abs=1e-9
        )
    if course is STRAIGHT:
        assert numbers(to_map.transform.translation, "xyz").tolist() == [0.0, 0.0, 0.0]


class FakeNode:
    """Records published messages and log lines."""

    def __init__(self) -> None:
        self.logged: list[str] = []
        self.published: dict[str, list[Any]] = {}
        self.latched: dict[str, bool] = {}

    def get_logger(self) -> Any:
        return SimpleNamespace(info=self.logged.append)

    def create_publisher(self, kind: Any, name: str, qos: Any) -> Any:
        heard = self.published.setdefault(name, [])
        self.latched[name] = qos.durability is DurabilityPolicy.TRANSIENT_LOCAL

        def publish(message: Any) -> None:
            assert isinstance(message, kind)
            heard.append(message)

        return SimpleNamespace(publish=publish)


def test_transforms_are_published_where_the_type_is_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class TFMessage:
        def __init__(self, transforms: list[Any]) -> None:
            self.transforms = transforms

    module = ModuleType("tf2_msgs.msg")
    module.TFMessage = TFMessage  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "tf2_msgs", ModuleType("tf2_msgs"))
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", module)
    node = FakeNode()
    publisher = TransformPublisher(node, "car_1")
    publisher.publish(SCENE, STRAIGHT)
    publisher.publish(SCENE, STRAIGHT)
    ((pack,),) = (message.transforms for message in node.published["/tf_static"])
    assert (pack.header.frame_id, pack.child_frame_id) == ("car_1/base_link", "car_1/battery_pack")
    assert numbers(pack.transform.translation, "xyz") == pytest.approx(PACK_PLACE_M)
    assert [len(message.transforms) for message in node.published["/tf"]] == [3, 3]
    assert node.latched == {"/tf": False, "/tf_static": True}
    assert node.logged == []


def test_transforms_are_left_out_where_it_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    node = FakeNode()
    publisher = TransformPublisher(node, "")
    publisher.publish(SCENE, STRAIGHT)
    publisher.publish(SCENE, STRAIGHT)
    assert node.published == {}
    (message,) = node.logged
    assert "tf2_msgs is not installed" in message


def test_the_description_is_a_tree_with_the_frames_of_the_vehicle() -> None:
    robot = ET.fromstring(vehicle_urdf(PARAMETERS, "car_1"))  # noqa: S314 - made a line before
    links = {link.attrib["name"]: link for link in robot.findall("link")}
    assert set(links) == {"car_1/base_link", "car_1/battery_pack"}
    (joint,) = robot.findall("joint")
    assert joint.find("parent").attrib["link"] == "car_1/base_link"
    assert joint.find("child").attrib["link"] == "car_1/battery_pack"
    # The pack lies within the car, the wheels stand on the road.
    place = [float(word) for word in joint.find("origin").attrib["xyz"].split()]
    length_m, width_m, _ = body_size_m(PARAMETERS)
    pack = [float(w) for w in links["car_1/battery_pack"].find(".//box").attrib["size"].split()]
    assert -length_m < place[0] - 0.5 * pack[0] < place[0] + 0.5 * pack[0] < 0.0
    assert pack[1] < width_m
    tyres = [
        v for v in links["car_1/base_link"].findall("visual") if v.find(".//cylinder") is not None
    ]
    assert len(tyres) == 4
    for tyre in tyres:
        radius = float(tyre.find(".//cylinder").attrib["radius"])
        assert radius == PARAMETERS.powertrain.wheel_radius_m
        assert float(tyre.find("origin").attrib["xyz"].split()[2]) == pytest.approx(radius)


def test_a_road_without_places_is_refused(tmp_path: Any) -> None:
    table = tmp_path / "speeds.csv"
    table.write_text("time_s,speed_m_s\n0,0\n1,1\n2,0\n", encoding="utf-8")
    for road in (str(table), "wltc_class3b"):
        with pytest.raises(IptmError, match="latitude_deg"):
            VisualizerParameters(road=road).road_line()
    assert VisualizerParameters().road_line() is None
    assert math.isfinite(VisualizerParameters().rate_hz)
