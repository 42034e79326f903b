"""Where the node's datagrams come from: a socket, or a recording."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from iptm_core.errors import BagError, ParameterError
from iptm_core.state import NS_PER_MS
from iptm_interfaces.codecs import decode_raw_datagram
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import TOPICS, Topic
from iptm_v2x_bridge.captures import CAPTURE_SUFFIXES, read_capture
from iptm_v2x_bridge.datagrams import MAX_KEPT, DatagramReader, EndOfTick, Reception
from iptm_v2x_bridge.messages.its_time import its_timestamp_ms
from iptm_v2x_bridge.messages.ros_cam import bits_of, message_type
from iptm_v2x_bridge.node_parameters import CamSettings
from iptm_v2x_bridge.radio_recording import (
    RadioRecording,
    recording_by_time,
    recording_with_marks,
)

MAX_WAITING = 1000
"""Messages of a topic that the middleware keeps."""


class DatagramSource:
    """Provides, tick by tick, what was received; this one never has anything."""

    def __init__(self, start_timestamp_ms: int) -> None:
        self._given_start_ms = start_timestamp_ms

    def begin_trip(self, time_ns: int) -> int:
        """Begin a trip with its first tick; return the TimestampIts of trip time 0 in ms.

        A negative one in the parameters stands for the clock of the computer.
        """
        if self._given_start_ms >= 0:
            return self._given_start_ms
        return its_timestamp_ms(time.time_ns()) - time_ns // NS_PER_MS

    def take(self, after_ns: int | None, until_ns: int) -> tuple[Sequence[Reception], int]:  # noqa: ARG002
        """Return what was received after one tick (None: from the beginning) up to another.

        Returns:
            The datagrams, and how many more had to be dropped unread meanwhile.
        """
        return (), 0

    def missing(self, time_ns: int) -> str:  # noqa: ARG002
        """Return what is waited for before a tick can be answered, empty if nothing is."""
        return ""

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return {}

    def close(self) -> None:
        """Give back what is held."""


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
        return _RecordedSource(
            read_recording(
                Path(options.recorded_packets),
                options.cam_port,
                options.trip_start_timestamp_ms,
                node.resolve_topic_name(Topic.DATAGRAMS.value),
                node.get_logger().warning,
            )
        )
    return (_LockStepSource if options.cam_lock_step else _SocketSource)(options)


class _SocketSource(DatagramSource):
    """Datagrams of a socket, all at once."""

    def __init__(self, options: CamSettings) -> None:
        super().__init__(options.trip_start_timestamp_ms)
        self._reader = DatagramReader(options.cam_address, options.cam_port)
        self._dropped = 0

    def take(self, after_ns: int | None, until_ns: int) -> tuple[Sequence[Reception], int]:  # noqa: ARG002
        taken = [Reception(until_ns, until_ns, datagram) for datagram in self._arrived(until_ns)]
        dropped = self._reader.dropped - self._dropped
        self._dropped += dropped
        return taken, dropped

    def _arrived(self, until_ns: int) -> list[bytes]:  # noqa: ARG002
        return self._reader.take()

    def report(self) -> dict[str, object]:
        return {"port": self._reader.port}

    def close(self) -> None:
        self._reader.close()


class _LockStepSource(_SocketSource):
    """Datagrams up to the mark of a tick count for it; those of a sender that is ahead wait for theirs."""

    def __init__(self, options: CamSettings) -> None:
        super().__init__(options)
        self._waiting: deque[bytes] = deque()
        self._marks: deque[EndOfTick] = deque()
        """Those in what waits, in the same order."""
        self._ended_ns: int | None = None
        self._heard = self._lost_on_the_way = 0

    def _arrived(self, until_ns: int) -> list[bytes]:
        self._listen()
        taken: list[bytes] = []
        while self._marks and self._marks[0].time_ns <= until_ns:
            taken += self._pass_mark()
        return taken

    def _listen(self) -> None:
        """Let what has arrived wait for the mark behind it; too much of it is left to the reader to drop."""
        if len(self._waiting) >= MAX_KEPT:
            return
        for datagram in self._reader.take():
            self._waiting.append(datagram)
            mark = EndOfTick.decode(datagram)
            if mark is None:
                continue
            while self._marks and mark.time_ns < self._marks[-1].time_ns:
                self._pass_mark()  # the sender began a new trip
            self._marks.append(mark)

    def _pass_mark(self) -> list[bytes]:
        """Return what came before the first mark that waits, and take note of it."""
        mark, before = self._marks.popleft(), []
        while EndOfTick.decode(datagram := self._waiting.popleft()) is None:
            before.append(datagram)
        if self._ended_ns is not None and mark.time_ns < self._ended_ns:
            self._heard = mark.sent - len(before)  # the sender began a new trip
        self._heard += len(before)
        self._ended_ns = mark.time_ns
        self._lost_on_the_way = mark.sent - self._heard
        return before

    def missing(self, time_ns: int) -> str:
        if self._ended_ns == time_ns:
            return ""
        before = self._ended_ns is not None and self._ended_ns < time_ns
        if before and self._marks and self._marks[0].time_ns > time_ns:
            return ""  # the sender skipped this tick, as it had no decision
        return "waiting for the sender's end of the tick"

    def report(self) -> dict[str, object]:
        return super().report() | {"lost_between_sender_and_bridge": self._lost_on_the_way}


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
        node.create_subscription(message_type(), options.cam_topic, self.hear, MAX_WAITING)

    def hear(self, message: Any) -> None:
        """Take a message; one that violates the standard is refused and reported."""
        self._node.guard(self._topic, lambda: self._keep(bits_of(message)))

    def _keep(self, datagram: bytes) -> None:
        self._kept.append(datagram)
        if len(self._kept) > MAX_KEPT:
            self._kept.popleft()
            self._dropped += 1

    def take(self, after_ns: int | None, until_ns: int) -> tuple[Sequence[Reception], int]:  # noqa: ARG002
        taken = [Reception(until_ns, until_ns, datagram) for datagram in self._kept]
        self._kept.clear()
        dropped, self._dropped = self._dropped, 0
        return taken, dropped

    def report(self) -> dict[str, object]:
        return {"cam_topic": self._topic}


class _RecordedSource(DatagramSource):
    """Datagrams of a recording, which restarts with every trip."""

    def __init__(self, recording: RadioRecording) -> None:
        super().__init__(recording.start_timestamp_ms)
        self._recording = recording

    def take(self, after_ns: int | None, until_ns: int) -> tuple[Sequence[Reception], int]:
        return self._recording.received(after_ns, until_ns)

    def report(self) -> dict[str, object]:
        return {
            "recorded_datagrams": len(self._recording.receptions),
            "recorded_until_s": self._recording.ends_ns * 1e-9,
        }


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
    if path.suffix.lower() in CAPTURE_SUFFIXES:
        captured = read_capture(path, port, warn)
        start_ms = max(start_timestamp_ms, 0)
        marked = recording_with_marks(captured, str(path), start_ms)
        return marked or recording_by_time(captured, start_ms)
    # Only here: reading bags takes long to import, and most bridges never read one.
    from iptm_recording.bag_reader import BagReader  # noqa: PLC0415

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
