"""Draws a run for RViz, Foxglove and the like: road, plan, preview and both cars in space.

It subscribes to the suite's topics, so it works with a run and with a bag that is played, and costs
the nodes nothing without a viewer.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from iptm_core.declaration import parameter
from iptm_core.errors import ParameterError
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.route import USER_SUFFIXES, RoadCourse
from iptm_core.routes.user_csv import read_user_trip
from iptm_core.settings import FrameSettings, ModelSettings
from iptm_core.state import LeaderState, SlopePreview
from iptm_core.units import CELSIUS_ZERO_K
from iptm_core.user_input import is_path
from iptm_ros.codecs import (
    decode_leader,
    decode_leader_preview,
    decode_observation,
    decode_plan,
    decode_slope,
    s_from_ns,
)
from iptm_ros.command_line import node_main
from iptm_ros.diagnostics import REPORT_PERIOD_S, DiagnosticsReporter, Level
from iptm_ros.parameters import declare_parameters
from iptm_ros.publishers import LATCHED_QOS
from iptm_ros.recording.timeline import read_stamp_ns
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import TOPICS, Topic
from iptm_view.graph_subscriptions import GraphSubscriptions, listening_node
from iptm_view.scene import (
    EGO_LENGTH_M,
    LEADER_LENGTH_M,
    Scene,
    path_message,
    road_message,
    scene_message,
    vehicle_urdf,
)
from iptm_view.transforms import TransformPublisher
from iptm_view.visual_topics import DESCRIPTION_TOPIC, PUBLISHER, VISUAL_TOPICS


@dataclass(frozen=True)
class VisualizerParameters(FrameSettings, ModelSettings):
    """Parameters of the node: its groups, the last of the bases first, and its own."""

    road: str = parameter(
        "",
        "recorded drive along whose road the scene lies: path of a .gpx file, of a .csv file with places, or "
        "FILE.xml#VEHICLE of SUMO with degrees; empty for a straight road",
    )
    rate_hz: float = parameter(
        20.0, "messages per second of wall time at most, of each topic", "Hz", 0.1, 200.0
    )

    def road_line(self) -> RoadLine | None:
        """Return where the road lies, None for a straight one."""
        if not self.road:
            return None
        allowed = "a drive with places (.gpx; .csv with latitude_deg and longitude_deg), or empty"
        if not is_path(self.road, USER_SUFFIXES):
            raise ParameterError(f"parameter road is {self.road!r}; allowed: {allowed}")
        line = read_user_trip(Path(self.road)).line
        if line is None:
            raise ParameterError(
                f"parameter road is {self.road!r}, a file without places; allowed: {allowed}"
            )
        return line


_LOOK_PERIOD_S = 0.2
_REPEAT_PERIOD_S = 1.0
_DEPTH = 10
_STAMPS_KEPT = 16
_FLAT = SlopePreview(np.zeros(1), np.zeros(1))
_OF_A_SCENE = (Topic.PLANT_STATE, Topic.LEADER)
_ALONE = (Topic.PLAN, Topic.LEADER_PREVIEW, Topic.SLOPE)


class VisualizerNode(SuiteNode):
    """Publishes paths and markers for 3-D viewers, transforms where `tf2_msgs` exists, and a URDF."""

    def __init__(self) -> None:
        super().__init__(PUBLISHER)
        self._options = declare_parameters(self, VisualizerParameters)
        self.reject_unknown_parameters()
        self.use_frame_prefix(self._options.frame_prefix)
        self._model = self._options.model().values
        self._course = RoadCourse(_FLAT, self._options.road_line())
        self._newest: dict[Topic, bytes] = {}
        self._by_stamp: dict[int, dict[Topic, bytes]] = {}
        self._stamp_ns = 0
        self._scenes = 0
        self._scene: tuple[Scene, float] | None = None
        self._publishers_3d = {
            topic: self.create_publisher(spec.message_type, spec.name, spec.qos)
            for topic, spec in VISUAL_TOPICS.items()
        }
        self._description_publisher = self.create_publisher(String, DESCRIPTION_TOPIC, LATCHED_QOS)
        urdf = vehicle_urdf(self._model, self.frame_prefix)
        self._description_publisher.publish(String(data=urdf))
        self._transforms = TransformPublisher(self, self.frame_prefix)
        self._graph = GraphSubscriptions(
            listening_node(f"{self.get_name()}_listener", self.get_namespace()), _DEPTH
        )
        self._reporter = DiagnosticsReporter.of_node(self, "scene")
        self.every(_LOOK_PERIOD_S, self._look)
        self.every(1.0 / self._options.rate_hz, self._show)
        self.every(_REPEAT_PERIOD_S, self._publish_scene)
        self.every(REPORT_PERIOD_S, self._report)
        self._look()
        self._report()

    def _look(self) -> None:
        self._graph.look((*_OF_A_SCENE, *_ALONE))

    def _take(self, topic: Topic, data: bytes) -> None:
        """Keep the newest messages as they are; most of a fast run are never looked at."""
        if topic in _ALONE:
            self._newest[topic] = data
            return
        stamp_ns = read_stamp_ns(data)
        if stamp_ns is None:
            return
        self._by_stamp.setdefault(stamp_ns, {})[topic] = data
        if len(self._by_stamp) > _STAMPS_KEPT:
            # The oldest in order of arrival: a new trip begins at 0 again.
            del self._by_stamp[next(iter(self._by_stamp))]

    def _show(self) -> None:
        for heard in self._graph.take():
            self._take(*heard)
        for topic, draw in (
            (Topic.SLOPE, self._draw_road),
            (Topic.PLAN, self._draw_plan),
            (Topic.LEADER_PREVIEW, self._draw_preview),
        ):
            data = self._newest.pop(topic, None)
            if data is not None:
                self.guard(topic.value, draw, data)
        self._draw_scene()

    def _draw_road(self, data: bytes) -> None:
        slope = decode_slope(_message(Topic.SLOPE, data))
        self._course = RoadCourse(slope, self._course.line)
        road = road_message(self._course, self._stamp_ns)
        self._publishers_3d[Topic.VISUAL_ROAD].publish(road)

    def _draw_plan(self, data: bytes) -> None:
        def build() -> Any:
            stamp_ns, plan = decode_plan(_message(Topic.PLAN, data))
            return path_message(
                self._course, stamp_ns, plan.positions_m, EGO_LENGTH_M, plan.times_s
            )

        self._publish_if_heard(Topic.VISUAL_PLAN, build)

    def _draw_preview(self, data: bytes) -> None:
        def build(*, is_bound: bool) -> Any:
            stamp_ns, preview = decode_leader_preview(_message(Topic.LEADER_PREVIEW, data))
            # A prediction that was sent long ago begins in the past; a stamp is never before 0.
            first = int(np.searchsorted(preview.times_s, max(0.0, stamp_ns * 1e-9)))
            if is_bound and not preview.bounds_m.size:
                first = preview.times_s.size
            motion = preview.cautious() if is_bound else preview
            return path_message(
                self._course,
                stamp_ns,
                motion.positions_m[first:],
                LEADER_LENGTH_M,
                motion.times_s[first:],
            )

        self._publish_if_heard(Topic.VISUAL_LEADER_PREVIEW, partial(build, is_bound=False))
        self._publish_if_heard(Topic.VISUAL_LEADER_BOUND, partial(build, is_bound=True))

    def _draw_scene(self) -> None:
        """Draw the newest instant of which both cars are known, or the ego vehicle alone without a leader."""
        complete = [
            stamp for stamp, found in self._by_stamp.items() if set(_OF_A_SCENE) <= set(found)
        ]
        alone = [stamp for stamp, found in self._by_stamp.items() if Topic.PLANT_STATE in found]
        stamps = complete or (alone if len(alone) >= _STAMPS_KEPT else [])
        if not stamps:
            return
        stamp_ns = stamps[-1]
        messages = self._by_stamp[stamp_ns]
        # Older ones are of no use any more; newer ones may become complete.
        arrived = list(self._by_stamp)
        for stamp in arrived[: arrived.index(stamp_ns) + 1]:
            del self._by_stamp[stamp]
        scene = _scene(stamp_ns, messages)
        self._scene = scene, max(0.0, s_from_ns(stamp_ns - self._stamp_ns))
        self._stamp_ns = stamp_ns
        self._scenes += 1
        self._transforms.publish(scene, self._course)
        self._publish_scene()

    def _publish_scene(self) -> None:
        """Publish the newest scene; also again while the trip stands still, as markers expire."""
        if self._scene is not None:
            scene, interval_s = self._scene
            self._publish_if_heard(
                Topic.VISUAL_SCENE,
                lambda: scene_message(scene, self._course, self._model, interval_s),
            )

    def _publish_if_heard(self, topic: Topic, build: Callable[[], Any]) -> None:
        publisher = self._publishers_3d[topic]
        if publisher.get_subscription_count():
            publisher.publish(build())

    def _report(self) -> None:
        level, reason = Level.OK, "drawing"
        if not self._graph.is_running:
            level, reason = Level.WARN, "waiting for a trip"
        values = {"scenes": self._scenes, "transforms": self._transforms.is_available}
        self._reporter.report(self._stamp_ns, level, reason, lambda: values)


def _scene(stamp_ns: int, messages: dict[Topic, bytes]) -> Scene:
    """Decode the messages of one instant."""
    state = decode_observation(_message(Topic.PLANT_STATE, messages[Topic.PLANT_STATE])).state
    leader = messages.get(Topic.LEADER)
    return Scene(
        stamp_ns,
        LeaderState(state.time_s, state.position_m, state.speed_m_s),
        None if leader is None else decode_leader(_message(Topic.LEADER, leader)),
        state.cell_n_temperature_k - CELSIUS_ZERO_K,
    )


def _message(topic: Topic, data: bytes) -> Any:
    return deserialize_message(data, TOPICS[topic].message_type)


def main() -> None:
    """Run the node."""
    sys.exit(node_main("visualize", VisualizerNode, VisualizerParameters))


if __name__ == "__main__":
    main()
