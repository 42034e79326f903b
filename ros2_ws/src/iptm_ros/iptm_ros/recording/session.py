"""Takes received messages and hands them to the bag with their times; free of ROS."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rosbags.interfaces import Qos

from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.message_types import message_definition
from iptm_ros.recording.recorded_topics import is_latched
from iptm_ros.recording.timeline import (
    CLOCK_TOPIC,
    StampKind,
    Timeline,
    TimeSource,
    read_stamp_ns,
    stamp_kind,
)

# Limits of the messages kept in memory until simulated time begins.
MAX_EARLY_MESSAGES = 20_000
MAX_EARLY_BYTES = 16_000_000


@dataclass
class _Channel:
    name: str
    type_name: str
    offered_qos: Callable[[], Sequence[Qos]]
    kind: StampKind
    offer: Sequence[Qos] | None = None
    topic_id: int | None = None

    @property
    def is_latched(self) -> bool:
        return any(map(is_latched, self.offer or ()))


@dataclass
class Pause:
    """A stretch of time that is not recorded.

    Attributes:
        after_ns: time of the last tick before it; -1 if nothing was before.
        until_ns: time of its last tick; None while it lasts.
        passed_over: messages that were not recorded.
    """

    after_ns: int
    until_ns: int | None = None
    passed_over: int = 0

    def covers(self, time_ns: int) -> bool:
        """Return whether a message published at this time is not to be recorded."""
        return time_ns > self.after_ns and (self.until_ns is None or time_ns <= self.until_ns)


class RecordingSession:
    """One recording in progress.

    Attributes:
        message_count: messages received.
        pauses: stretches of time that are not recorded, in their order.
    """

    def __init__(
        self, writer: BagWriter, timeline: Timeline, clock_topic: str = CLOCK_TOPIC
    ) -> None:
        self._writer = writer
        self._clock_topic = clock_topic
        self._timeline = timeline
        self._early: list[tuple[_Channel, bytes, int]] = []
        self._early_bytes = 0
        self._tick_ns = 0
        self._is_closed = False
        self.message_count = 0
        self.pauses: list[Pause] = []

    @property
    def is_ordered_by_reception(self) -> bool:
        """Whether the bag stays in the computer's time."""
        return self._timeline.source is TimeSource.WALL

    @property
    def now_ns(self) -> int | None:
        """Time of the recorder, None when simulated time has not begun."""
        return self._timeline.now_ns

    @property
    def is_paused(self) -> bool:
        """Whether messages are passed over at present."""
        return bool(self.pauses) and self.pauses[-1].until_ns is None

    def pause(self) -> None:
        """Record only latched topics from the next tick on, as late subscribers receive those as well.

        Pauses go by the stamps of messages where they have one: no tick is recorded in part.
        """
        if not self.is_paused:
            now_ns = self.now_ns
            self.pauses.append(Pause(-1 if now_ns is None else now_ns))

    def resume(self) -> None:
        """Record again, from the next tick on."""
        if self.is_paused:
            now_ns = self.now_ns
            self.pauses[-1].until_ns = -1 if now_ns is None else now_ns

    @property
    def message_counts(self) -> dict[str, int]:
        """Messages in the bag, by topic."""
        return self._writer.message_counts

    def channel(
        self, name: str, type_name: str, offered_qos: Callable[[], Sequence[Qos]]
    ) -> Callable[[bytes], None]:
        """Prepare a topic; it enters the bag with its first message.

        Args:
            name: fully qualified name.
            type_name: `package/msg/Type`.
            offered_qos: asked once, when the first message arrives: by then publishers are known.

        Returns:
            The function to call with the bytes of every message.
        """
        definition = message_definition(type_name).text
        kind = stamp_kind(type_name, definition)
        channel = _Channel(name, type_name, offered_qos, kind)

        def take(data: bytes) -> None:
            self._take(channel, data)

        return take

    def flush(self) -> None:
        """Put every message taken so far into the file; call it a few times a second."""
        if not self._is_closed:
            self._writer.flush()

    def stop_waiting(self) -> None:
        """Take the time of reception for good, as no clock has come."""
        self._timeline.source = TimeSource.WALL
        early, self._early = self._early, []
        for channel, data, received_ns in early:
            self._put(channel, data, (received_ns, received_ns))

    def close(self) -> None:
        """Close the bag; if simulated time never began, it is ordered by time of reception."""
        self.stop_waiting()
        self._is_closed = True
        self._writer.close()

    def _take(self, channel: _Channel, data: bytes) -> None:
        if self._is_closed:  # while other recorders of the process go on
            return
        self.message_count += 1
        if (
            channel.offer is None
        ):  # the publisher may be gone by the time that the message is written
            channel.offer = channel.offered_qos()
        times = self._times_ns(channel, data)
        if times is None:
            self._hold(channel, data)
            return
        if self._early:
            self._write_early()
            # Early messages came first, and one may have moved the time on.
            times = self._times_ns(channel, data) or times
        self._write(channel, data, times)

    def _times_ns(self, channel: _Channel, data: bytes) -> tuple[int, int] | None:
        is_other_clock = channel.kind is StampKind.CLOCK and channel.name != self._clock_topic
        return self._timeline.times_ns(data, StampKind.NONE if is_other_clock else channel.kind)

    def _hold(self, channel: _Channel, data: bytes) -> None:
        """Keep a message until simulated time begins."""
        if self.is_paused and not channel.is_latched:
            self.pauses[-1].passed_over += 1
            return
        self._early.append((channel, data, time.time_ns()))
        self._early_bytes += len(data)
        if len(self._early) >= MAX_EARLY_MESSAGES or self._early_bytes >= MAX_EARLY_BYTES:
            self.stop_waiting()

    def _write_early(self) -> None:
        """Write the messages that came before the clock."""
        early, self._early = self._early, []
        stamps = (
            read_stamp_ns(data) for channel, data, _ in early if channel.kind is StampKind.HEADER
        )
        self._timeline.begin_with(stamp for stamp in stamps if stamp is not None)
        for channel, data, _ in early:
            times = self._times_ns(channel, data)
            if times is not None:
                self._put(channel, data, times)

    def _write(self, channel: _Channel, data: bytes, times: tuple[int, int]) -> None:
        """Write a message; in simulated time one tick is kept in memory, the ones before in the file."""
        pause = next((pause for pause in self.pauses if pause.covers(times[1])), None)
        if pause is not None and not channel.is_latched:
            pause.passed_over += 1
            return
        if times[0] != self._tick_ns and self._timeline.source is TimeSource.SIMULATED:
            self._tick_ns = times[0]
            self._writer.flush()
        self._put(channel, data, times)

    def _put(self, channel: _Channel, data: bytes, times: tuple[int, int]) -> None:
        self._writer.write(self._topic_id(channel), data, *times)

    def _topic_id(self, channel: _Channel) -> int:
        if channel.topic_id is None:
            channel.topic_id = self._writer.add_topic(
                channel.name, channel.type_name, offered_qos=channel.offer or ()
            )
        return channel.topic_id
