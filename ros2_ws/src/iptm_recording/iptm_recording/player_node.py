"""The player: publishes the raw bytes of a bag with their recorded timing."""

from __future__ import annotations

import sys
import threading
import time

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock

from iptm_core.errors import BagError
from iptm_interfaces.codecs.time import time_from_ns
from iptm_interfaces.process import EXIT_DEFECT, EXIT_USER_ERROR
from iptm_interfaces.suite_node import SuiteNode
from iptm_recording.bag_reader import BagReader
from iptm_recording.playback import Playback, PlaybackOptions
from iptm_recording.rclpy_types import message_class, to_profile
from iptm_recording.recorded_topics import TopicRecord, offer_for

STARTED_LINE = "player started"
# Fast playback must not push unacknowledged messages out of a short queue.
_LEAST_DEPTH = 100
_CLOCK_DEPTH = 10
_POLL_S = 0.02
_ACKNOWLEDGE_S = 1.0
_PROGRESS_PERIOD_S = 5.0


class PlayerNode(SuiteNode):
    """Plays a part of a bag once, then finishes.

    The waiting and publishing happen in a thread of their own, so that the node stays responsive.

    Args:
        options: what to play.

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
        self._next_clock_s = 0.0
        self._clock_publisher: Publisher | None = None
        if options.clock_hz is not None:
            self._clock_publisher = self.create_publisher(
                Clock, self._playback.clock_topic, _CLOCK_DEPTH
            )
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._play, name="player", daemon=True)
        self._thread.start()

    def destroy_node(self) -> None:
        """End the playback, should it still go on, and destroy the node."""
        self._stop.set()
        self._thread.join()
        self._reader.close()
        super().destroy_node()

    def _advertise_topic(self, topic: TopicRecord) -> None:
        try:
            kind = message_class(topic.type_name)
        except BagError as error:
            self.get_logger().warning(f"topic {topic.name} is not played: {error}")
            return
        qos = offer_for(topic)
        if not topic.is_latched:
            qos = qos._replace(depth=max(qos.depth, _LEAST_DEPTH))
        publisher = self.create_publisher(kind, topic.name, to_profile(qos))
        self._publishers_by_topic[topic.name] = publisher

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
        """Wait as asked for; return False when told to stop meanwhile."""
        wanted = self._options.wait_for_subscribers
        if wanted:
            print(f"waiting for {wanted} subscriptions", flush=True)
        while self._subscription_count() < wanted:
            if self._stop.wait(_POLL_S):
                return False
        return not self._stop.wait(self._options.delay_s)

    def _subscription_count(self) -> int:
        publishers = self._publishers_by_topic.values()
        return sum(publisher.get_subscription_count() for publisher in publishers)

    def _publish_all(self) -> int:
        """Publish every message when it is due; return their number."""
        print(
            f"{STARTED_LINE}: {self._playback.length_s:.1f} s on"
            f" {len(self._publishers_by_topic)} topics at {self._options.rate:g} times the"
            " recorded speed",
            flush=True,
        )
        begin_s = time.monotonic()
        next_progress_s = _PROGRESS_PERIOD_S
        sent = 0
        for message in self._playback.messages():
            publisher = self._publishers_by_topic.get(message.topic)
            if publisher is None:
                continue
            due_s = self._playback.due_s(message.log_time_ns)
            if not self._wait_until(begin_s, due_s):
                break
            publisher.publish(message.data)
            sent += 1
            if due_s >= next_progress_s:
                next_progress_s = due_s + _PROGRESS_PERIOD_S
                at_s = (message.log_time_ns - self._playback.start_ns) * 1e-9
                print(f"at {at_s:.1f} of {self._playback.length_s:.1f} s", flush=True)
        else:
            self._wait_until(begin_s, self._playback.due_s(self._playback.end_ns))
        return sent

    def _wait_until(self, begin_s: float, due_s: float) -> bool:
        """Wait for a time since the begin, publishing the clock; return False when told to stop."""
        while True:
            elapsed_s = time.monotonic() - begin_s
            if self._clock_publisher is None or self._options.clock_hz is None:
                return not self._wait(due_s - elapsed_s)
            if elapsed_s >= self._next_clock_s:
                # Never ahead of a message that is due but not yet published.
                at_ns = self._playback.recorded_ns(min(elapsed_s, due_s))
                self._clock_publisher.publish(Clock(clock=time_from_ns(at_ns)))
                self._next_clock_s = elapsed_s + 1.0 / self._options.clock_hz
            if elapsed_s >= due_s:
                return not self._stop.is_set()
            if self._wait(min(due_s, self._next_clock_s) - elapsed_s):
                return False

    def _wait(self, seconds: float) -> bool:
        """Sleep; return True when told to stop."""
        return self._stop.wait(seconds) if seconds > 0.0 else self._stop.is_set()

    def _wait_until_acknowledged(self) -> None:
        """Give reliable subscribers the time to receive the last messages."""
        deadline_s = time.monotonic() + _ACKNOWLEDGE_S
        for publisher in self._publishers_by_topic.values():
            left_s = deadline_s - time.monotonic()
            if left_s > 0.0 and not self._stop.is_set():
                publisher.wait_for_all_acked(Duration(seconds=left_s))
