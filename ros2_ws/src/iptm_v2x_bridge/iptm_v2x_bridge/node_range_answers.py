"""The node's answers to the clock where a range sensor measures the leader, alone or with its messages."""

from __future__ import annotations

from sensor_msgs.msg import PointCloud2

from iptm_ros.codecs import decode_tracks
from iptm_ros.qos import SENSOR_QOS
from iptm_ros.topics import Topic
from iptm_v2x_bridge.bridge import TickBridge
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.node_answers import AnswerContext, CamAnswers, TickAnswers
from iptm_v2x_bridge.range_sensor import RangeSensorBridge

WAIT_S = 0.5
"""Wall time for which a tick waits for a measurement at it or later; not again until the sensor measures."""
LOOK_S = 0.05


class _Sensor:
    """The tracks from their topic, and the wait for them at a tick."""

    def __init__(self, context: AnswerContext) -> None:
        self._node, self._retry = context.node, context.retry
        self.bridge = RangeSensorBridge()
        self._asked: tuple[int, float] = (-1, 0.0)
        self._is_silent = False
        self.messages = 0
        self._node.listen(Topic.RANGE_TRACKS, self._on_tracks, qos=SENSOR_QOS)
        self._node.every(LOOK_S, self._retry)

    def begin_trip(self, messages: TickBridge | None = None) -> RangeSensorBridge:
        """Begin a trip; a measurement of its first tick may have arrived before that."""
        self.bridge = RangeSensorBridge(messages, self.bridge)
        return self.bridge

    def _on_tracks(self, message: PointCloud2) -> None:
        stamp_ns, tracks = decode_tracks(message)
        self.messages += 1
        self._is_silent = False
        self.bridge.take(stamp_ns, tracks)
        self._retry()

    def missing(self, time_ns: int) -> str:
        """Return the reason for waiting, empty for none."""
        if self._is_silent or self.bridge.has_measured(time_ns):
            return ""
        now_s = self._node.awake.now_s()
        if self._asked[0] != time_ns:
            self._asked = time_ns, now_s
        self._is_silent = now_s - self._asked[1] > WAIT_S
        return "" if self._is_silent else "waiting for the range sensor"

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return {
            "range_sensor_messages": self.messages,
            "range_sensor_silent": self._is_silent,
            **{f"ticks_{join.name.lower()}": count for join, count in self.bridge.counts.items()},
        }


class RangeSensorAnswers(TickAnswers[RangeSensorBridge]):
    """The leader is what a range sensor measures; a tick is answered with the measurement nearest to it."""

    def __init__(self, context: AnswerContext) -> None:
        super().__init__(context, needs_ego=True)
        self._sensor = _Sensor(context)

    def _start(self, time_ns: int) -> tuple[RangeSensorBridge, TickBridge]:  # noqa: ARG002
        bridge = self._sensor.begin_trip()
        return bridge, self._with_rules(bridge)

    def _awaited(self, trip: RangeSensorBridge, time_ns: int) -> str:  # noqa: ARG002
        return self._sensor.missing(time_ns)

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return self._sensor.report()


class JoinedAnswers(CamAnswers):
    """Gap and speed by the range sensor, the future by messages."""

    def __init__(self, context: AnswerContext) -> None:
        super().__init__(context)
        self._sensor = _Sensor(context)

    def _joined(self, bridge: CamBridge) -> TickBridge:
        return self._sensor.begin_trip(bridge)

    def _awaited(self, trip: CamBridge, time_ns: int) -> str:
        return super()._awaited(trip, time_ns) or self._sensor.missing(time_ns)

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return super().report() | self._sensor.report()
