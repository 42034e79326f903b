"""Takes received messages and hands them to the bag with their times; free of ROS."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rosbags.interfaces import Qos, QosDurability

from iptm_recording.bag_writer import BagWriter
from iptm_recording.message_types import message_definition
from iptm_recording.timeline import (
    CLOCK_TOPIC,
    StampKind,
    Timeline,
    TimeSource,
    read_stamp_ns,
    stamp_kind,
)

# Messages kept in memory while simulated time has not begun; a graph without /clock reaches it.
MAX_HELD_MESSAGES = 20_000


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
        return any(qos.durability is QosDurability.TRANSIENT_LOCAL for qos in self.offer or ())


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
        """Tell whether a message that was published then is not to be recorded."""
        return time_ns > self.after_ns and (self.until_ns is None or time_ns <= self.until_ns)


class RecordingSession:
    """One recording in progress.

    Args:
        writer: the bag.
        timeline: source of the times.
        clock_topic: full name of the clock that counts.

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
        self._held: list[tuple[_Channel, bytes]] = []
        self._tick_ns = 0
        self.message_count = 0
        self.pauses: list[Pause] = []

    @property
    def held_count(self) -> int:
        """Messages that wait in memory for simulated time to begin."""
        return len(self._held)

    @property
    def now_ns(self) -> int | None:
        """Time of the recorder, None when simulated time has not begun."""
        return self._timeline.now_ns

    @property
    def is_paused(self) -> bool:
        """Whether messages are passed over at present."""
        return bool(self.pauses) and self.pauses[-1].until_ns is None

    def pause(self) -> None:
        """Record nothing from the next tick on but latched topics, which whoever joins later gets as well.

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

        Raises:
            BagError: the type is unknown.
        """
        definition = message_definition(type_name).text
        kind = stamp_kind(name, type_name, definition, self._clock_topic)
        channel = _Channel(name, type_name, offered_qos, kind)

        def take(data: bytes) -> None:
            self._take(channel, data)

        return take

    def flush(self) -> None:
        """Put every message taken so far into the file; call it a few times a second.

        Raises:
            BagError: the file cannot be written (disk full).
        """
        self._writer.flush()

    def close(self) -> None:
        """Write what is still held (in wall time, as simulated time never began); close the bag."""
        if self._held:
            self._timeline.source = TimeSource.WALL
            self._release()
        self._writer.close()

    def _take(self, channel: _Channel, data: bytes) -> None:
        self.message_count += 1
        if (
            channel.offer is None
        ):  # the publisher may be gone by the time that the message is written
            channel.offer = channel.offered_qos()
        times = self._timeline.times_ns(data, channel.kind)
        if times is None:
            self._held.append((channel, data))
            if len(self._held) >= MAX_HELD_MESSAGES:
                self._timeline.source = TimeSource.WALL
                self._release()
            return
        if self._held:
            self._release()
            # The held messages came first, and one may have moved the time on.
            times = self._timeline.times_ns(data, channel.kind) or times
        self._write(channel, data, times)

    def _release(self) -> None:
        held, self._held = self._held, []
        stamps = (read_stamp_ns(data) for channel, data in held if channel.kind is StampKind.HEADER)
        self._timeline.begin_with(stamp for stamp in stamps if stamp is not None)
        for channel, data in held:
            times = self._timeline.times_ns(data, channel.kind)
            if times is not None:
                self._write(channel, data, times)

    def _write(self, channel: _Channel, data: bytes, times: tuple[int, int]) -> None:
        """Write a message; in simulated time one tick is kept in memory, the ones before in the file."""
        pause = next((pause for pause in self.pauses if pause.covers(times[1])), None)
        if pause is not None and not channel.is_latched:
            pause.passed_over += 1
            return
        if times[0] != self._tick_ns and self._timeline.source is TimeSource.SIMULATED:
            self._tick_ns = times[0]
            self._writer.flush()
        if channel.topic_id is None:
            channel.topic_id = self._writer.add_topic(
                channel.name, channel.type_name, offered_qos=channel.offer or ()
            )
        self._writer.write(channel.topic_id, data, *times)
