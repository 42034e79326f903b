"""Where the node's datagrams come from: a socket, or a recording."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from iptm_core.errors import BagError, ParameterError
from iptm_ros.codecs import decode_raw_datagram
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import TOPICS, Topic
from iptm_v2x_bridge.datagrams import (
    MAX_KEPT,
    DatagramSource,
    LockStepSource,
    Received,
    SocketSource,
)
from iptm_v2x_bridge.settings import CamSettings

if TYPE_CHECKING:
    from iptm_v2x_bridge.captures import RadioRecording

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
    from iptm_v2x_bridge.captures import (  # noqa: PLC0415
        CAPTURE_SUFFIXES,
        read_capture,
        recording_by_time,
        recording_with_marks,
    )

    if path.suffix.lower() in CAPTURE_SUFFIXES:
        captured = read_capture(path, port, warn)
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
