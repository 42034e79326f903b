"""The base of every node of the suite: topics by key, callbacks that cannot end it, and an orderly end."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from functools import partial
from itertools import cycle
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.service import Service as RclpyService
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer
from std_srvs.srv import Trigger

from iptm_core.errors import IptmError, ParameterError
from iptm_core.settings import MOST_PREVIEW_STEPS
from iptm_core.user_input import suggestion
from iptm_ros.codecs import numbers_of, road_of, table_of
from iptm_ros.connections import LOOK_PERIOD_S, ConnectionsReport
from iptm_ros.node_health import AwakeClock, Heartbeat, NodeHealth
from iptm_ros.publishers import PatientPublisher
from iptm_ros.services import Service
from iptm_ros.topics import TOPICS, Topic, frame_in, topic_of

_MESSAGE_BYTES = 64 * 1024
"""Largest serialised message taken from a topic, unless it is named below."""
_LARGER_BYTES = {
    # 48 bytes a node; a preview of a minute has 3 kB.
    Topic.LEADER_PREVIEW: 48 * (MOST_PREVIEW_STEPS + 1) + 1024,
    Topic.SLOPE: 4 * 2**20,
    Topic.PLAN: 2**20,
    Topic.DIAGNOSTICS: 2**20,
}

_LOG_THROTTLE_S = 5.0
_KNOWN_DEFECTS = 20
_GRAPH_PERIOD_S = 1.0
_QOS_OVERRIDES = "qos_overrides."
_ROS_PARAMETERS = ("use_sim_time", _QOS_OVERRIDES, "start_type_description_service")
# Topics of ROS itself, which files of parameters that were dumped may name.
_OVERRIDABLE = (f"{_QOS_OVERRIDES}/clock.", f"{_QOS_OVERRIDES}/parameter_events.")


class SuiteNode(Node):
    """A node that takes names, types and QoS from the topic table.

    Run it with `iptm_ros.process.run_node`, which watches `ended`.

    Messages are looked at before they are decoded, and an exception of a callback is logged, counted and
    reported on the diagnostics instead of ending the node.

    Attributes:
        ended: done when the node has asked for its end.
        exit_code: what the process shall return.
        health: what the node survived.
        connections: reports which nodes hear this one, and which it hears.
        awake: steady time without the stretches in which the process did not run.
        frame_prefix: of the frames of this vehicle: its namespace unless set by `use_frame_prefix`.
    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.ended = Future()
        self.exit_code = 0
        self.health = NodeHealth()
        self.awake = AwakeClock()
        self.frame_prefix = self.get_namespace().strip("/")
        # rclpy warns from 8 timers of one clock on, so timers take turns.
        self._steady_clocks = cycle([Clock(clock_type=ClockType.STEADY_TIME) for _ in range(2)])
        self._known_defects: set[str] = set()
        self._sole: dict[Topic, str] = {}
        self._heartbeat: Heartbeat | None = None
        self.create_timer(AwakeClock.PERIOD_S, self.awake.tick, clock=next(self._steady_clocks))
        self.connections = ConnectionsReport(self)
        self.every(LOOK_PERIOD_S, self.connections.look)

    def advertise(self, topic: Topic) -> PatientPublisher:
        """Return a publisher for a topic of the table."""
        spec = TOPICS[topic]
        return self.create_publisher(
            spec.message_type, spec.name, spec.offered_qos, publisher_class=PatientPublisher
        )

    def use_frame_prefix(self, prefix: str) -> None:
        """Take the prefix of frames that a user asks for; empty keeps the namespace, `/` is none."""
        if prefix:
            self.frame_prefix = prefix.strip("/")

    def frame(self, name: str) -> str:
        """Return the name in the graph of a frame of the topic table."""
        return frame_in(self.frame_prefix, name)

    def listen(
        self,
        topic: Topic,
        callback: Callable[[Any], None],
        *,
        raw: bool = False,
        qos: QoSProfile | None = None,
        vehicle: str = "",
    ) -> Subscription:
        """Return a subscription to a topic of the table.

        Args:
            topic: key of the topic.
            callback: called with the message, or with its serialised bytes if `raw`.
            raw: leave out the conversion to a message object.
            qos: of the subscription; None takes the table's. A deeper queue is for a listener that must not
                miss a message of a publisher that does not wait for it.
            vehicle: namespace of another vehicle whose topic is meant, from its beginning on.
        """
        spec = TOPICS[topic]
        name = topic_of(vehicle, topic) if vehicle else spec.name
        decode = None if raw else partial(_decoded, topic, spec.message_type)
        allowed = _LARGER_BYTES.get(topic, _MESSAGE_BYTES)
        take = partial(self._let_in, topic.value, allowed, decode, callback)
        wanted = qos or (spec.offered_qos if vehicle else spec.qos)
        return self.create_subscription(spec.message_type, name, take, wanted, raw=True)

    def serve(self, service: Service, action: Callable[[], str]) -> RclpyService:
        """Return a server of a service of the table."""

        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.message = "an internal error was caught, see the log"
            response.success = False
            self.guard(service.value, act, response)
            return response

        def act(response: Trigger.Response) -> None:
            try:
                response.message = action()
                response.success = True
                self.get_logger().info(f"{service.value}: {response.message}")
            except IptmError as error:
                response.message = " ".join(str(error).split())

        return self.create_service(Trigger, service.private_name, answer)

    def _let_in(
        self,
        name: str,
        allowed: int,
        decode: Callable[[bytes], Any] | None,
        callback: Callable[[Any], None],
        data: bytes,
    ) -> None:
        """Decode the message of a topic, unless it has more than the allowed bytes, and hand it over."""
        if len(data) > allowed:
            self.refuse(f"{name}: {len(data)} bytes; allowed: up to {allowed}")
            return
        try:
            message = data if decode is None else decode(data)
        except Exception as error:  # noqa: BLE001  the binding raises error types of its own
            self.refuse(f"{name}: {len(data)} bytes cannot be decoded: {error}")
            return
        self.guard(name, callback, message)

    def refuse(self, what: str) -> None:
        """Count and log a message that is not taken; `what` names topic, value and rule."""
        self.health.note_refusal(what)
        self.get_logger().warning(what, throttle_duration_sec=_LOG_THROTTLE_S)

    def guard(self, name: str, callback: Callable[..., None], *arguments: Any) -> None:
        """Call a callback; exceptions are logged, counted and reported, not raised.

        A message that violates its specification is refused. Anything else is a defect: the first
        of its kind is logged with its traceback, all of them in a line.
        """
        try:
            callback(*arguments)
        except IptmError as error:
            self.refuse(f"{name}: {error}")
        except Exception as error:  # noqa: BLE001  the last line of defence of the node
            *_, place = traceback.extract_tb(error.__traceback__)
            what = f"{type(error).__name__} in {place.name}, line {place.lineno}: {error}"
            self.health.note_defect(f"{name}: {what}")
            if what not in self._known_defects and len(self._known_defects) < _KNOWN_DEFECTS:
                self._known_defects.add(what)
                self.get_logger().error(f"callback of {name} failed:\n{traceback.format_exc()}")
            else:
                text = f"callback of {name} failed again: {what}"
                self.get_logger().error(text, throttle_duration_sec=_LOG_THROTTLE_S)

    def every(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """Return a timer on a steady clock, which trip time cannot stop or speed up."""
        name = f"the timer of {getattr(callback, '__name__', 'a callback')}"
        guarded = partial(self.guard, name, callback)
        return self.create_timer(period_s, guarded, clock=next(self._steady_clocks))

    def show_life(self) -> None:
        """Publish signs of life until the node is destroyed."""
        self._heartbeat = Heartbeat(self)

    def destroy_node(self) -> None:
        """End the signs of life, too."""
        if self._heartbeat is not None:
            self._heartbeat.end()
        super().destroy_node()

    def watch_peers(self, *topics: Topic) -> None:
        """Look every second whether topics that one node of the graph publishes have several publishers.

        Nodes of one name count, too: the topics of a second one may be remapped, as faults do.
        """
        self._sole = {topic: TOPICS[topic].publisher for topic in topics}
        self.every(_GRAPH_PERIOD_S, self._count_publishers)

    def _count_publishers(self) -> None:
        nodes = self.get_node_names_and_namespaces()
        for topic, who in self._sole.items():
            name = self.resolve_topic_name(TOPICS[topic].name)
            named = nodes.count((who, self.get_namespace()))
            self.health.note_publishers(who, max(named, int(self.count_publishers(name))))

    def reject_unknown_parameters(self) -> None:
        """Refuse overrides that no one declared: ROS ignores them, and with them every typo.

        Raises:
            ParameterError: an unknown name, with the closest known one.
        """
        # rclpy has no public way to list overrides without declaring them untyped.
        overrides: dict[str, Any] = getattr(self, "_parameter_overrides", {})
        for name in overrides:
            if name.startswith(_QOS_OVERRIDES) and not name.startswith(_OVERRIDABLE):
                raise ParameterError(
                    f"parameter {name} is given to {self.get_name()}; allowed: none, as the QoS of its "
                    "topics is fixed"
                )
            if self.has_parameter(name) or name.startswith(_ROS_PARAMETERS):
                continue
            own = [known for known in self._parameters if not known.startswith(_ROS_PARAMETERS)]
            hint = suggestion(name, sorted(own))
            raise ParameterError(f"parameter {name} is unknown to {self.get_name()}; {hint}")

    def stop(self) -> None:
        """Answer a request to stop (SIGINT, SIGTERM); repeated until the node has finished.

        A node with work left overrides this and finishes later.
        """
        self.finish(self.exit_code)

    def finish(self, exit_code: int = 0) -> None:
        """Ask for the end of the process; the current callback still completes."""
        self.exit_code = exit_code
        self.ended.set_result(None)


def _decoded(topic: Topic, kind: type[Any], data: bytes) -> Any:
    found = numbers_of(topic, data) or table_of(topic, data) or road_of(topic, data)
    return found or deserialize_message(data, kind)
