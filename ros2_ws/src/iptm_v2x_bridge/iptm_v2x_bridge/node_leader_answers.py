"""The node's answers to the clock where messages of cars, a range sensor, or both state the leader.

Datagrams come from a socket, a topic or a recording.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sensor_msgs.msg import PointCloud2

from iptm_core.errors import BagError, ParameterError
from iptm_core.settings import LeaderSource
from iptm_core.state import NS_PER_MS
from iptm_ros.codecs import decode_raw_datagram, decode_tracks, encode_raw_datagram
from iptm_ros.publishers import SENSOR_QOS
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import TOPICS, Topic
from iptm_v2x_bridge.bridge import BridgeAnswer, TickBridge
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.datagrams import (
    MAX_KEPT,
    DatagramSource,
    EndOfTick,
    LockStepSource,
    Received,
    SocketSource,
)
from iptm_v2x_bridge.its import CAPTURE_SUFFIXES, ReportingBridge, extra_for
from iptm_v2x_bridge.messages.cam import specification
from iptm_v2x_bridge.messages.packets import its_timestamp_ms
from iptm_v2x_bridge.node_answers import AnswerContext, TickAnswers, Trip
from iptm_v2x_bridge.prediction.road_rules import RoadRules
from iptm_v2x_bridge.range_sensor import RangeSensorBridge
from iptm_v2x_bridge.settings import CamSettings

if TYPE_CHECKING:
    from iptm_v2x_bridge.radio_recording import RadioRecording

MAX_WAITING = 1000
"""Messages of a topic that the middleware keeps."""


def open_source(options: CamSettings, node: SuiteNode) -> DatagramSource:
    """Return the source that the parameters ask for.

    Args:
        options: of the node.
        node: subscribes to a topic, and warns if a part of a recording cannot be read; its own topic of
            datagrams counts where a bag has several.

    Raises:
        IptmError: the socket, the topic or the recording is not usable.
    """
    if options.cam_topic:
        return _TopicSource(options, node)
    if options.recorded_packets:
        return read_recording(
            Path(options.recorded_packets),
            options.cam_port,
            options.trip_start_timestamp_ms,
            node.resolve_topic_name(Topic.DATAGRAMS.value),
            node.get_logger().warning,
        )
    kind = LockStepSource if options.cam_lock_step else SocketSource
    return kind(options.cam_address, options.cam_port, options.trip_start_timestamp_ms)


class _TopicSource(DatagramSource):
    """Messages of a topic, as the datagrams that they came from; all by the clock of the computer."""

    def __init__(self, options: CamSettings, node: SuiteNode) -> None:
        """Subscribe.

        Raises:
            ParameterError: the type of the messages is not there, or they are asked to come in lock-step.
        """
        super().__init__(options.trip_start_timestamp_ms)
        if options.cam_lock_step or options.recorded_packets:
            raise ParameterError(
                f"cam_topic is {options.cam_topic!r} with cam_lock_step {options.cam_lock_step} and "
                f"recorded_packets {options.recorded_packets!r}; allowed: False and ''"
            )
        self._topic, self._node = options.cam_topic, node
        self._kept: deque[bytes] = deque()
        self._dropped = 0
        from iptm_v2x_bridge.messages.ros_cam import bits_of, message_type  # noqa: PLC0415

        self._bits_of = bits_of
        node.create_subscription(message_type(), options.cam_topic, self.hear, MAX_WAITING)

    def hear(self, message: Any) -> None:
        """Take a message; one that violates the standard is refused and reported."""
        self._node.guard(self._topic, lambda: self._keep(self._bits_of(message)))

    def _keep(self, datagram: bytes) -> None:
        self._kept.append(datagram)
        if len(self._kept) > MAX_KEPT:
            self._kept.popleft()
            self._dropped += 1

    def take(self, after_ns: int | None, until_ns: int) -> tuple[Sequence[Received], int]:  # noqa: ARG002
        taken = [(until_ns, datagram) for datagram in self._kept]
        self._kept.clear()
        dropped, self._dropped = self._dropped, 0
        return taken, dropped

    def report(self) -> dict[str, object]:
        return {"cam_topic": self._topic}


def read_recording(
    path: Path, port: int, start_timestamp_ms: int, topic: str, warn: Callable[[str], None]
) -> RadioRecording:
    """Return the radio traffic in a bag or a capture.

    Args:
        path: bag folder, .mcap file, .pcap or .pcapng.
        port: UDP port whose datagrams count in a capture.
        start_timestamp_ms: TimestampIts at trip time 0; a bag holds its own.
        topic: full name of the topic that counts where a bag has several; "" for any.
        warn: called with a sentence if a part of a capture cannot be read.

    Raises:
        IptmError: there is none, or it cannot be read.
    """
    # Only here: most bridges read none, and what reads bags takes long to import.
    from iptm_v2x_bridge.radio_recording import (  # noqa: PLC0415
        recording_by_time,
        recording_with_marks,
    )

    if path.suffix.lower() in CAPTURE_SUFFIXES:
        extra = extra_for("recorded_packets", str(path))
        captured = extra.read_capture(path, port, warn)
        start_ms = max(start_timestamp_ms, 0)
        marked = recording_with_marks(captured, str(path), start_ms)
        return marked or recording_by_time(captured, start_ms)
    from iptm_ros.recording.bag_reader import BagReader  # noqa: PLC0415

    with BagReader(path) as reader:
        spec = TOPICS[Topic.DATAGRAMS]
        wanted = topic if topic in reader.topics else spec.name
        topic = reader.resolve(wanted, spec.type_name).name
        received = [decode_raw_datagram(found.message) for found in reader.messages([topic])]
    recording = recording_with_marks(received, str(path))
    if recording is None:
        raise BagError(
            f"{path} holds no mark of the end of a tick on {topic}; allowed: a bag recorded with "
            "publish_datagrams of the bridge"
        )
    return recording


WAIT_S = 0.5
"""Wall time for which a tick waits for a measurement at it or later; not again until the sensor measures."""
LOOK_S = 0.05
READ_PERIOD_S = 0.005


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


class _Chained(TickAnswers[Trip]):
    """Answers that the vehicles ahead of the leader can complete."""

    _chain: ReportingBridge | None = None

    def _chained(
        self,
        inner: TickBridge,
        sensor: RangeSensorBridge | None,
        messages: CamBridge | None = None,
        rules: tuple[RoadRules, RoadRules] | None = None,
    ) -> TickBridge:
        """Return a bridge that forecasts the leader by the chain ahead; the same one where none is asked."""
        options = self._options
        if not options.chain_ahead:
            return inner
        self._chain = options.build_chain(inner, options, sensor, messages, rules)
        return self._chain

    def _chain_report(self) -> dict[str, object]:
        return {} if self._chain is None else self._chain.report()


class RangeSensorAnswers(_Chained[RangeSensorBridge]):
    """The leader is what a range sensor measures; a tick is answered with the measurement nearest to it."""

    def __init__(self, context: AnswerContext) -> None:
        super().__init__(context, needs_ego=True)
        self._sensor = _Sensor(context)

    def _start(self, time_ns: int) -> tuple[RangeSensorBridge, TickBridge]:  # noqa: ARG002
        bridge = self._sensor.begin_trip()
        return bridge, self._with_rules(self._chained(bridge, bridge))

    def _awaited(self, trip: RangeSensorBridge, time_ns: int) -> str:  # noqa: ARG002
        return self._sensor.missing(time_ns)

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return self._sensor.report() | self._chain_report()


class CamAnswers(_Chained[CamBridge]):
    """Answers from received messages of the leader.

    A tick is answered when the ego vehicle's position of the same stamp is known and, in lock-step, after the
    sender's end of the tick.
    """

    def __init__(self, context: AnswerContext) -> None:
        """Open the source of the datagrams and listen for the ego vehicle."""
        options, route = context.options, context.route
        # Refused now, if at all.
        self._verifier = options.build_verifier()
        super().__init__(context, needs_ego=True)
        options.build_heard_rules(self._given, route.road_line)
        options.build_predictors(route, self._given)
        self._datagrams = open_source(options, context.node)
        self._publisher = (
            context.node.advertise(Topic.DATAGRAMS) if options.publish_datagrams else None
        )
        # Datagrams of the present are read at once; datagrams in the trip's own time belong to its ticks.
        self._by_wall_clock = options.trip_start_timestamp_ms < 0 and not (
            options.recorded_packets or options.cam_lock_step
        )
        specification()  # compiled now, not at the first tick, which others wait for
        context.node.every(READ_PERIOD_S, self._on_read_timer)

    def _on_read_timer(self) -> None:
        if self._trip is not None and self._by_wall_clock:
            trip, _ = self._trip
            self._read(trip, trip.read_until_ns or 0)
        self._retry()

    def _start(self, time_ns: int) -> tuple[CamBridge, TickBridge]:
        """Start with the first tick, which maps trip time 0 to the time of the messages."""
        start_ms = self._datagrams.begin_trip(time_ns)
        options, route = self._options, self._route
        heard = options.build_heard_rules(self._given, route.road_line)
        bridge = CamBridge(
            options.road_of_messages(route.road_line),
            options,
            predictors=options.build_predictors(route, heard.leader if heard else self._given),
            datagram_offset_bytes=options.datagram_offset_bytes,
            start_timestamp_ms=start_ms,
            roadside=heard,
            verifier=self._verifier,
        )
        joined = self._joined(bridge)
        rules = (heard.leader, heard.ego) if heard else (self._given, self._given)
        chained = self._chained(joined, self._sensor_bridge(), bridge, rules)
        return bridge, self._with_rules(chained, heard.ego if heard else None, start_ms)

    def _joined(self, bridge: CamBridge) -> TickBridge:
        """Return the bridge of the messages, joined with other sources."""
        return bridge

    def _sensor_bridge(self) -> RangeSensorBridge | None:
        """Return the bridge of a range sensor, None without one."""
        return None

    def _awaited(self, trip: CamBridge, time_ns: int) -> str:
        self._read(trip, time_ns)
        return self._datagrams.missing(time_ns)

    def _checked(self, trip: CamBridge, answer: BridgeAnswer) -> BridgeAnswer:
        self._publish(trip, EndOfTick(answer.time_ns, trip.received).encode(), answer.time_ns)
        return answer

    def _read(self, trip: CamBridge, time_ns: int) -> None:
        """Take in what has arrived by a tick; by the computer's clock, by now, however late the tick is."""
        if self._by_wall_clock:
            passed_ms = its_timestamp_ms(time.time_ns()) - trip.start_timestamp_ms
            time_ns = max(passed_ms * NS_PER_MS, time_ns)
        received, dropped = self._datagrams.take(trip.read_until_ns, time_ns)
        trip.read_until_ns = time_ns
        for received_ns, datagram in received:
            trip.receive(datagram, received_ns)
            self._publish(trip, datagram, received_ns)
        trip.decode_waiting(time_ns)
        trip.count_overflow(dropped)

    def _publish(self, trip: CamBridge, datagram: bytes, received_ns: int) -> None:
        if self._publisher is not None:
            its_ns = trip.start_timestamp_ms * NS_PER_MS + received_ns
            self._publisher.publish(encode_raw_datagram(datagram, its_ns))

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        trip = self._trip[0].report() if self._trip else {}
        return self._datagrams.report() | trip | self._chain_report()

    def close(self) -> None:
        """Give the socket back."""
        self._datagrams.close()


class JoinedAnswers(CamAnswers):
    """Gap and speed by the range sensor, the future by messages."""

    def __init__(self, context: AnswerContext) -> None:
        super().__init__(context)
        self._sensor = _Sensor(context)

    def _joined(self, bridge: CamBridge) -> TickBridge:
        return self._sensor.begin_trip(bridge)

    def _sensor_bridge(self) -> RangeSensorBridge | None:
        return self._sensor.bridge

    def _awaited(self, trip: CamBridge, time_ns: int) -> str:
        return super()._awaited(trip, time_ns) or self._sensor.missing(time_ns)

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return super().report() | self._sensor.report()


ANSWERS: dict[LeaderSource, Callable[[AnswerContext], TickAnswers[Any]]] = {
    LeaderSource.CAM: CamAnswers,
    LeaderSource.RANGE_SENSOR: RangeSensorAnswers,
    LeaderSource.RANGE_SENSOR_AND_CAM: JoinedAnswers,
}
