"""One MCAP file of a bag while it is written, and when it is to make room for the next one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

from mcap.well_known import MessageEncoding, Profile
from mcap.writer import CompressionType, Writer

from iptm_core.errors import BagError
from iptm_core.state import NS_PER_S
from iptm_ros.recording.message_types import SCHEMA_ENCODING, MessageDefinition
from iptm_ros.recording.recorded_topics import TopicRecord, dump_profiles
from iptm_ros.recording.storage import NO_START_NS, FileRecord

COMPRESSIONS: Final = {
    "none": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}
MOST_INDEX_BYTES = 3_000_000
"""Memory that the index of one file may take: it is written, and let go, when the file is completed."""
_SMALLEST_FILE_BYTES = 64 * 1024  # every file repeats the definitions of all messages
# What mcap's writer keeps of a chunk, and of a topic in a chunk (measured with tracemalloc, Python 3.11).
_INDEX_BYTES_PER_CHUNK = 500
_INDEX_BYTES_PER_TOPIC = 70
_MESSAGE_HEAD_BYTES = 31
_SEQUENCE_MASK = 0xFFFFFFFF


@dataclass(frozen=True)
class FileLimits:
    """When a file of a bag is completed and the next one begun; names and 0 as in rosbag2.

    Attributes:
        max_bag_size: bytes, 0 for no such limit.
        max_bag_duration: seconds of log time, 0 for no such limit.
    """

    max_bag_size: int = 0
    max_bag_duration: int = 0

    def __post_init__(self) -> None:
        """Validate the options."""
        if self.max_bag_size != 0 and self.max_bag_size < _SMALLEST_FILE_BYTES:
            raise BagError(
                f"max_bag_size is {self.max_bag_size}; allowed: 0 (no limit), or"
                f" {_SMALLEST_FILE_BYTES} bytes and more"
            )
        if self.max_bag_duration < 0:
            raise BagError(
                f"max_bag_duration is {self.max_bag_duration}; allowed: 0 (no limit), or 1 s and more"
            )


@final
class McapFile:
    """An MCAP file in progress.

    Args:
        path: file to create.
        compression: key of `COMPRESSIONS`.
        chunk_bytes: content after which a chunk is written.
        limits: when the file is full, in addition to `MOST_INDEX_BYTES`.

    Attributes:
        path: the file.
        counts: messages so far, by topic number.
    """

    def __init__(self, path: Path, compression: str, chunk_bytes: int, limits: FileLimits) -> None:
        self.path = path
        self.counts: Counter[int] = Counter()
        self._limits = limits
        self._chunk_bytes = chunk_bytes
        self._schema_ids: dict[str, int] = {}
        self._start_ns = NO_START_NS
        self._end_ns = 0
        self._index_bytes = 0
        self._pending_bytes = 0
        self._pending_topics: set[int] = set()
        self._file = path.open("xb")
        self._writer = Writer(
            self._file,
            chunk_size=chunk_bytes,
            compression=COMPRESSIONS[compression],
            enable_data_crcs=True,  # texts about the run have no other checksum
        )
        self._writer.start(Profile.ROS2, library="iptm_ros")
        self._file.flush()

    def record(self) -> FileRecord:
        """Return the entry of the file in `metadata.yaml`."""
        duration_ns = self._end_ns - self._start_ns if self.counts else 0
        return FileRecord(self.path.name, self._start_ns, duration_ns, self.counts.total())

    def is_full(self, log_time_ns: int) -> bool:
        """Return whether a message of this log time belongs in the next file."""
        limits = self._limits
        return bool(self.counts) and (
            self._index_bytes >= MOST_INDEX_BYTES
            or (limits.max_bag_size > 0 and self._file.tell() >= limits.max_bag_size)
            or (
                limits.max_bag_duration > 0
                and log_time_ns - self._start_ns >= limits.max_bag_duration * NS_PER_S
            )
        )

    def add_topic(self, topic: TopicRecord, definition: MessageDefinition) -> int:
        """Add a topic; files with the same topics in the same order use the same numbers."""
        schema_id = self._schema_ids.get(definition.type_name)
        if schema_id is None:
            text = definition.text.encode()
            schema_id = self._writer.register_schema(definition.type_name, SCHEMA_ENCODING, text)
            self._schema_ids[definition.type_name] = schema_id
        return self._writer.register_channel(
            topic.name,
            MessageEncoding.CDR,
            schema_id,
            {
                "offered_qos_profiles": dump_profiles(topic.offered_qos),
                "topic_type_hash": topic.type_hash,
            },
        )

    def write(
        self, topic_id: int, data: bytes, log_time_ns: int, publish_time_ns: int, sequence: int
    ) -> None:
        """Append a message to the chunk in progress."""
        self.counts[topic_id] += 1
        self._start_ns = min(self._start_ns, log_time_ns)
        self._end_ns = max(self._end_ns, log_time_ns)
        self._pending_topics.add(topic_id)
        self._pending_bytes += _MESSAGE_HEAD_BYTES + len(data)
        sequence &= _SEQUENCE_MASK
        self._writer.add_message(topic_id, log_time_ns, data, publish_time_ns, sequence)
        if self._pending_bytes > self._chunk_bytes:
            self._count_chunk()

    def add_texts(self, name: str, texts: Mapping[str, str]) -> None:
        """Store texts, safe from a kill at once."""
        self._writer.add_metadata(name, dict(texts))
        self._file.flush()

    def flush(self) -> None:
        """Finish the chunk in progress and put it into the file."""
        self._count_chunk()
        self._writer.flush()

    def finish(self) -> None:
        """Write index and footer, and close the file."""
        self._writer.finish()
        self._file.close()

    def abandon(self) -> None:
        """Close a file that cannot be written any more, without the buffer."""
        self._file.raw.close()

    def _count_chunk(self) -> None:
        """Add the index entry of a chunk that was finished to the memory in use."""
        if self._pending_topics:
            self._index_bytes += _INDEX_BYTES_PER_CHUNK
            self._index_bytes += _INDEX_BYTES_PER_TOPIC * len(self._pending_topics)
            self._pending_topics.clear()
            self._pending_bytes = 0
