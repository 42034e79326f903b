"""The player: publishes the raw bytes of a bag with their recorded timing."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Sequence

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rich.console import Console
from rosgraph_msgs.msg import Clock

from iptm_bags.playback import LEAST_RATE, MOST_RATE, Playback, PlaybackOptions
from iptm_bags.playback_control import PlaybackControl, PlaybackProgress, WaitOutcome
from iptm_core.errors import BagError
from iptm_core.program import EXIT_USER_ERROR
from iptm_ros.codecs.cdr import time_from_ns
from iptm_ros.process import EXIT_DEFECT
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.rclpy_types import recorded_class, to_profile
from iptm_ros.recording.recorded_topics import TopicRecord, offer_for, overridden
from iptm_ros.services import Service
from iptm_ros.suite_node import SuiteNode

STARTED_LINE = "player started"
RATE, SEEK = "rate", "seek_s"
"""Parameters that may be set while it plays."""
# Fast playback must not push unacknowledged messages out of a short queue.
_LEAST_DEPTH = 100
_CLOCK_DEPTH = 10
_POLL_S = 0.02
_ACKNOWLEDGE_S = 1.0
_SHOW_PERIOD_S = 0.2


class PlayerNode(SuiteNode):
    """Plays a part of a bag once, or again and again, then finishes.

    The waiting and publishing happen in a thread of their own, so that the node stays responsive. Its
    services and the parameters `rate` and `seek_s` change what that thread waits for.

    Raises:
        BagError: the bag cannot be opened, or holds nothing of what was asked for.
    """

    def __init__(self, options: PlaybackOptions) -> None:
        self._reader = BagReader(options.bag)
        try:
            self._playback = Playback(self._reader, options)
        except BagError:
            self._reader.close()
            raise
        super().__init__("player")
        self._options = options
        self._publishers_by_topic: dict[str, Publisher] = {}
        for topic in self._playback.topics:
            self._advertise_topic(topic)
        if not self._publishers_by_topic:
            raise BagError(f"no topic of {options.bag} can be published here")
        for name in options.qos.keys() - self._publishers_by_topic.keys():
            self.get_logger().warning(f"quality of service of {name} is not used: it is not played")
        self._next_clock_s = 0.0
        self._clock_publisher: Publisher | None = None
        if options.clock_hz is not None:
            name = self._playback.clock_topic
            self._clock_publisher = self.create_publisher(
                Clock, options.remap.get(name, name), _CLOCK_DEPTH
            )
        self._control = PlaybackControl(
            self._playback.start_ns, options.rate, is_paused=options.is_paused
        )
        self._declare_settable()
        for service, action in (
            (Service.PLAYER_PAUSE, self._pause),
            (Service.PLAYER_RESUME, self._resume),
            (Service.PLAYER_TOGGLE_PAUSED, self._toggle_paused),
            (Service.PLAYER_PLAY_NEXT, self._play_next),
        ):
            self.serve(service, action)
        self._progress: PlaybackProgress | None = None
        self.every(_SHOW_PERIOD_S, self._show)
        self._thread = threading.Thread(target=self._play, name="player", daemon=True)
        self._thread.start()

    def destroy_node(self) -> None:
        """End the playback, should it still go on, and destroy the node."""
        self._control.stop()
        self._thread.join()
        if self._progress is not None:
            self._progress.close()
        self._reader.close()
        super().destroy_node()

    def _advertise_topic(self, topic: TopicRecord) -> None:
        try:
            kind = recorded_class(topic)
        except BagError as error:
            self.get_logger().warning(f"topic {topic.name} is not played: {error}")
            return
        qos = offer_for(topic)
        if not topic.is_latched:
            qos = qos._replace(depth=max(qos.depth, _LEAST_DEPTH))
        self._publishers_by_topic[topic.name] = self.create_publisher(
            kind,
            self._options.remap.get(topic.name, topic.name),
            to_profile(overridden(qos, topic.name, self._options.qos)),
        )

    def _declare_settable(self) -> None:
        first_s, last_s = (
            self._offset_s(self._playback.start_ns),
            self._offset_s(self._playback.end_ns),
        )
        for name, value, description, low, high in (
            (RATE, self._control.rate, "times the recorded speed", LEAST_RATE, MOST_RATE),
            (
                SEEK,
                first_s,
                "seconds into the bag; set it to go on from there [s]",
                first_s,
                last_s,
            ),
        ):
            bounds = FloatingPointRange(from_value=float(low), to_value=float(high), step=0.0)
            descriptor = ParameterDescriptor(
                description=description, floating_point_range=[bounds] if low < high else []
            )
            parameter = Parameter(name, value=self.declare_parameter(name, value, descriptor).value)
            verdict = _refuse_not_finite([parameter])
            if not verdict.successful:
                raise BagError(f"parameter {verdict.reason}")
            if parameter.value != value:
                self._take_parameters([parameter])
        self.add_on_set_parameters_callback(_refuse_not_finite)
        self.add_post_set_parameters_callback(self._take_parameters)

    def _offset_s(self, recorded_ns: int) -> float:
        """Return a recorded time as seconds into the bag."""
        return (recorded_ns - self._playback.bag_start_ns) * 1e-9

    def _take_parameters(self, parameters: Sequence[Parameter]) -> None:
        for parameter in parameters:
            if parameter.name == RATE:
                self._control.set_rate(parameter.value)
                self._tell(f"{parameter.value:g} times the recorded speed")
            elif parameter.name == SEEK:
                offset_ns = round(parameter.value * 1e9)
                self._control.seek(self._playback.bag_start_ns + offset_ns)

    def _pause(self) -> str:
        self._control.pause(is_paused=True)
        return self._tell("paused")

    def _resume(self) -> str:
        self._control.pause(is_paused=False)
        return self._tell("playing")

    def _toggle_paused(self) -> str:
        return self._resume() if self._control.is_paused else self._pause()

    def _play_next(self) -> str:
        if not self._control.step():
            raise BagError("the player is playing; allowed: while paused")
        return "next message"

    def _show(self) -> None:
        if self._progress is not None:
            control = self._control
            at_s = self._offset_s(control.position_ns)
            self._progress.show(at_s, control.rate, is_paused=control.is_paused)

    def _tell(self, what: str) -> str:
        """Print a line with the position, and return it."""
        text = f"{what} at {self._offset_s(self._control.position_ns):.1f} s of the bag"
        print(text, flush=True)
        return text

    def _play(self) -> None:
        try:
            if self._wait_for_subscribers():
                sent = self._publish_all()
                self._wait_until_acknowledged()
                print(f"played {sent} messages", flush=True)
        except BagError as error:
            print(f"play: {error}", file=sys.stderr, flush=True)
            self.finish(EXIT_USER_ERROR)
        except Exception as error:  # noqa: BLE001  a thread that dies in silence would leave the node waiting
            print(f"play: unexpected {type(error).__name__}: {error}", file=sys.stderr, flush=True)
            self.finish(EXIT_DEFECT)
        else:
            self.finish()

    def _wait_for_subscribers(self) -> bool:
        """Wait for the requested subscribers; return False when stopped."""
        wanted = self._options.wait_for_subscribers
        if wanted:
            print(f"waiting for {wanted} subscriptions", flush=True)
        while self._subscription_count() < wanted:
            if self._control.sleep(_POLL_S):
                return False
        return not self._control.sleep(self._options.delay_s)

    def _subscription_count(self) -> int:
        publishers = self._publishers_by_topic.values()
        return sum(publisher.get_subscription_count() for publisher in publishers)

    def _publish_all(self) -> int:
        """Publish every message when it is due, as often as asked for; return their number."""
        print(
            f"{STARTED_LINE}: {self._playback.length_s:.1f} s on"
            f" {len(self._publishers_by_topic)} topics at {self._control.rate:g} times the"
            f" recorded speed{', paused' if self._control.is_paused else ''}",
            flush=True,
        )
        self._progress = PlaybackProgress(
            Console(),
            self._offset_s(self._playback.start_ns),
            self._offset_s(self._playback.end_ns),
        )
        sent = 0
        from_ns = self._playback.start_ns
        while True:
            self._control.begin(from_ns)
            count, verdict = self._publish_from(from_ns)
            sent += count
            sought_ns = self._control.take_sought()
            if verdict is WaitOutcome.STOPPED:
                return sent
            if verdict is WaitOutcome.SOUGHT and sought_ns is not None:
                from_ns = sought_ns
                self._control.begin(from_ns)
                self._tell("going on")
            elif not self._options.is_looping:
                return sent
            else:
                from_ns = self._playback.start_ns

    def _publish_from(self, from_ns: int) -> tuple[int, WaitOutcome]:
        """Publish the messages from a position on; return their number and why it ended."""
        sent = 0
        for message in self._playback.messages(from_ns):
            publisher = self._publishers_by_topic.get(message.topic)
            if publisher is None:
                continue
            if message.log_time_ns >= from_ns:  # latched ones of before are sent at once
                verdict = self._wait_for(message.log_time_ns)
                if verdict is not WaitOutcome.DUE:
                    return sent, verdict
            publisher.publish(message.data)
            sent += 1
        return sent, self._wait_for(self._playback.end_ns)

    def _wait_for(self, due_ns: int) -> WaitOutcome:
        """Wait for a recorded time, publishing the clock meanwhile."""
        while True:
            if self._clock_publisher is None or self._options.clock_hz is None:
                return self._control.wait(due_ns)
            now_s = time.monotonic()
            if now_s >= self._next_clock_s:
                # Never ahead of a message that is due but not yet published.
                at_ns = min(self._control.position_ns, due_ns)
                self._clock_publisher.publish(Clock(clock=time_from_ns(at_ns)))
                self._next_clock_s = now_s + 1.0 / self._options.clock_hz
            verdict = self._control.wait(due_ns, self._next_clock_s - now_s)
            if verdict is not WaitOutcome.EARLY:
                return verdict

    def _wait_until_acknowledged(self) -> None:
        """Give reliable subscribers the time to receive the last messages."""
        deadline_s = time.monotonic() + _ACKNOWLEDGE_S
        for publisher in self._publishers_by_topic.values():
            left_s = deadline_s - time.monotonic()
            if left_s > 0.0 and not self._control.is_stopped:
                publisher.wait_for_all_acked(Duration(seconds=left_s))


def _refuse_not_finite(parameters: Sequence[Parameter]) -> SetParametersResult:
    """Refuse what ROS takes for numbers within a range."""
    for parameter in parameters:
        if isinstance(parameter.value, float) and not math.isfinite(parameter.value):
            reason = f"{parameter.name} is {parameter.value}; allowed: a finite number"
            return SetParametersResult(successful=False, reason=reason)
    return SetParametersResult(successful=True)
