"""Publishers of the suite: quality of service, frames of the vehicle, listeners that must miss nothing."""

from __future__ import annotations

import threading
from collections.abc import Collection
from typing import Any

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from iptm_ros.topics import frame_in


def _keep_last(
    depth: int,
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE,
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=reliability, durability=durability
    )


STREAM_QOS = _keep_last(100)
"""State, previews and commands: reliable, volatile, and deep, as foreign messages must not displace due ones
in a subscription, and a listener may be a moment late.
"""
KEPT_STREAM_QOS = _keep_last(100, DurabilityPolicy.TRANSIENT_LOCAL)
"""A stream that late subscribers receive from its beginning, as far as the history is kept."""
LATCHED_QOS = _keep_last(1, DurabilityPolicy.TRANSIENT_LOCAL)
"""Static data: reliable, keep last 1, transient-local (a late subscriber still gets it)."""
RAW_QOS = _keep_last(5000)
"""What comes in bursts and must not be lost: reliable, keep last 5000, volatile."""
SENSOR_QOS = _keep_last(100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Requested of sensors of any origin: best effort, which reliable publishers meet as well, keep last 100."""


def describe_qos(profile: QoSProfile) -> str:
    """Return a profile in words, for tables and error texts, e.g. `reliable, keep last 100`."""
    reliability = profile.reliability.name.lower().replace("_", " ")
    durability = profile.durability.name.lower().replace("_", "-")
    text = f"{reliability}, keep last {profile.depth}"
    return text if durability == "volatile" else f"{text}, {durability}"


_PATIENCE_S = 1.0
_LOOK_PERIOD_S = 0.02
_LONGEST_LOOK = Duration(seconds=0.1)
_MOST_UNHEARD = STREAM_QOS.depth // 2


class FramedPublisher(Publisher):
    """A publisher that prefixes the frames of its messages.

    Codecs use the frames of the topic table only. Serialised bytes are sent unchanged: their encoder
    sets the right frame.

    Attributes:
        frame_prefix: of the vehicle, empty for none.
    """

    frame_prefix = ""

    def publish(self, msg: Any) -> None:
        """Publish a message, or its serialised bytes."""
        if isinstance(msg, bytes):
            handle = self.handle
            with handle:
                handle.publish_raw(msg)
            return
        if self.frame_prefix:
            header = getattr(msg, "header", None)
            if header is not None:
                header.frame_id = frame_in(self.frame_prefix, header.frame_id)
            if hasattr(msg, "child_frame_id"):
                msg.child_frame_id = frame_in(self.frame_prefix, msg.child_frame_id)
        super().publish(msg)


class Listeners:
    """See that every listener has what is published in lock-step, as a recorder must.

    A thread waits for their acknowledgements while the node goes on; the node waits only where half a
    queue is on its way.

    Attributes:
        are_left_behind: whether one did not follow when it was last waited for.
    """

    def __init__(self) -> None:
        self.are_left_behind = False
        self._sent = self._heard = 0
        self._has_heard = threading.Condition()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def let_follow(self, publishers: Collection[Publisher]) -> None:
        """Before a message to each topic, wait until half a queue at most has not reached all listeners.

        A listener that has stopped holds this up once, for a second. It is not waited for again until all
        have followed, or it has left the graph.

        Args:
            publishers: the same at every call.
        """
        if self._thread is None:
            look = (tuple(publishers),)
            self._thread = threading.Thread(target=self._look, args=look, daemon=True)
            self._thread.start()
        self._sent += 1
        if self._sent - self._heard < _MOST_UNHEARD:
            self.are_left_behind = False
            return
        patience_s = 0.0 if self.are_left_behind else _PATIENCE_S
        with self._has_heard:
            self.are_left_behind = not self._has_heard.wait_for(
                lambda: self._sent - self._heard < _MOST_UNHEARD, patience_s
            )

    def end(self) -> None:
        """End the thread; before the publishers are destroyed."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def _look(self, publishers: Collection[Publisher]) -> None:
        """Note, time and again, of how many messages all listeners have acknowledged.

        What is lost on the way is sent again topic by topic, so each is waited for.
        """
        while not self._ended.wait(_LOOK_PERIOD_S):
            sent = self._sent - 1  # the last ones may be yet to come
            if sent > self._heard and all(
                publisher.wait_for_all_acked(_LONGEST_LOOK) for publisher in publishers
            ):
                with self._has_heard:
                    self._heard = sent
                    self._has_heard.notify()
