"""An MCAP file of a bag, opened for reading: its messages and texts, its checksums and statistics.

Own code on the records of `mcap`: the readers of rosbags give no publication times, and check neither the
summary nor the data section against their checksums, and that of `mcap` makes an object of every message: it
takes three times as long, 4 s for each pass through a drive of ten hours, of which `iptm info` makes four.
"""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from bisect import bisect_left
from collections import Counter
from collections.abc import Collection, Container, Iterator, Mapping, Sequence
from contextlib import ExitStack
from operator import attrgetter
from pathlib import Path
from typing import final

from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Chunk, ChunkIndex
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary
from mcap.well_known import Profile

from iptm_core.errors import BagError
from iptm_core.user_input import shown
from iptm_ros.recording.message_types import SCHEMA_ENCODING, MessageDefinition
from iptm_ros.recording.recorded_topics import TopicRecord, parse_profiles
from iptm_ros.recording.run_information import RECORD_NAME
from iptm_ros.recording.storage import (
    DAMAGE,
    FRAME_HEAD_BYTES,
    MOST_TEXT_BYTES,
    ZSTD_MAGIC,
    BagMessage,
    UnpackingBudget,
    check_chunk,
)

MAGIC = b"\x89MCAP0\r\n"
_OTHER_MAGIC = (b"SQLite format 3\0", b"#ROSBAG V2.0\n", ZSTD_MAGIC)
CONVERT = (
    "{path} is no plain MCAP bag; convert it with: "
    "rosbags-convert --src {source} --dst DIR --dst-storage mcap"
)
"""Refusal of a bag of SQLite or ROS 1, or one packed by rosbag2 as a whole or message by message."""
PREFIX = struct.Struct("<BQ")
"""Opcode and length in front of every record."""
CHUNK_HEAD = struct.Struct("<QQQII")
"""Of a chunk: times, size unpacked, checksum, length of the name of its compression, which follows."""
DATA_END = struct.Struct("<BQI")
FOOTER = struct.Struct("<BQQQI")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_Found = tuple[int, int, int, int, int, bytes]
"""Log time, place of its chunk, place in it, time of publication, channel, content."""
_BLOCK_BYTES = 2**20


def summary_start(data: bytes | mmap.mmap) -> int:
    """Return where the summary of a whole file starts, 0 without one.

    Raises:
        ValueError: the footer is damaged, or the summary does not match its checksum.
    """
    at = len(data) - len(MAGIC) - FOOTER.size
    opcode, length, start, _, checksum = FOOTER.unpack_from(data, max(0, at))
    if opcode != Opcode.FOOTER or length != FOOTER.size - PREFIX.size or not 0 <= start <= at:
        raise ValueError("its footer is unreadable")
    if start and checksum and _checksum(data, start, at + FOOTER.size - 4) != checksum:
        raise ValueError("its summary does not match its checksum")
    return int(start)


def check_data_section(data: bytes | mmap.mmap) -> None:
    """Compare everything before the summary with the checksum of the file, if it has one.

    Raises:
        ValueError: they do not agree, or the end of the data section is damaged.
    """
    end = (summary_start(data) or len(data) - len(MAGIC) - FOOTER.size) - DATA_END.size
    opcode, length, checksum = DATA_END.unpack_from(data, max(0, end))
    if (opcode, length) != (Opcode.DATA_END, 4):
        raise ValueError("the end of its data is unreadable")
    if checksum and _checksum(data, 0, end) != checksum:
        raise ValueError("its data do not match their checksum")


def _checksum(data: bytes | mmap.mmap, start: int, end: int) -> int:
    """Return the CRC-32 of a part, without a copy of all of it."""
    checksum = 0
    for at in range(start, end, _BLOCK_BYTES):
        size = min(_BLOCK_BYTES, end - at)
        checksum = zlib.crc32(data[at : at + size], checksum)
        if isinstance(data, mmap.mmap) and at % _BLOCK_BYTES == 0:
            data.madvise(mmap.MADV_DONTNEED, at, size)  # not needed any more
    return checksum


@final
class BagFile:
    """A sound MCAP file of ROS 2 messages, opened for reading.

    Attributes:
        path: the file.
        definitions: message definitions by type name.
        topics: recorded topics; one name may occur several times.
        message_count: messages of all topics together.
        start_ns: earliest log time, 0 without messages.
        end_ns: latest log time, 0 without messages.

    Raises:
        BagError: it cannot be read, is of another kind, damaged, or was cut short.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._opened = ExitStack()
        self.definitions: Mapping[str, MessageDefinition] = {}
        self.topics: Sequence[TopicRecord] = ()
        self.message_count = 0
        self.start_ns = 0
        self.end_ns = 0
        self._counts_topics = True
        try:
            with path.open("rb") as file:
                start = file.read(max(map(len, _OTHER_MAGIC)))
        except OSError as error:
            raise BagError(f"cannot read {path}: {error}") from None
        if start.startswith(_OTHER_MAGIC):
            raise BagError(CONVERT.format(path=path, source=path))
        if not start.startswith(MAGIC):
            raise BagError(f"{path} is not an MCAP file: it starts with {start[: len(MAGIC)]!r}")
        try:
            self._open(path)
        except BagError:
            self.close()
            raise
        except DAMAGE as error:
            self.close()
            raise self.damaged(error) from None

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._opened.close()

    def messages(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[BagMessage]:
        """Yield messages in order of log time, equal times in file order.

        Raises:
            BagError: the file is damaged, or holds fewer messages than stated.
        """
        found: Counter[str] = Counter()
        try:
            for message in self._read(topics, start_ns, end_ns):
                found[message.topic] += 1
                if message.data.startswith(ZSTD_MAGIC):
                    raise BagError(CONVERT.format(path=self.path, source=self.path))
                yield message
        except DAMAGE as error:
            raise self.damaged(error) from None
        is_whole = (start_ns or 0) <= self.start_ns and (end_ns is None or end_ns > self.end_ns)
        if is_whole and self._counts_topics:
            self._compare_counts(topics, found)

    def damaged(self, error: Exception | str) -> BagError:
        """Return the error to raise for damage, with the way out."""
        reason = " ".join(str(error).split()) or type(error).__name__
        return BagError(
            f"{self.path} is damaged ({reason}); save the intact part with: scripts/iptm recover {self.path}"
        )

    def _compare_counts(self, topics: Collection[str] | None, found: Counter[str]) -> None:
        promised: Counter[str] = Counter()
        for topic in self.topics:
            promised[topic.name] += topic.message_count
        for name, count in promised.items():
            if (topics is None or name in topics) and found[name] != count:
                raise self.damaged(
                    f"{found[name]} messages of {name} are found, by its statistics it holds {count}"
                )

    def _open(self, path: Path) -> None:
        file = self._opened.enter_context(path.open("rb"))
        self._content = self._opened.enter_context(
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        )
        ends_whole = self._content[-len(MAGIC) :] == MAGIC
        if not ends_whole or len(self._content) < 2 * len(MAGIC) + FOOTER.size:
            raise BagError(
                f"{self.path} ends without its footer: its recording was cut short;"
                f" repair it with: scripts/iptm recover {self.path}"
            )
        summary_start(self._content)
        self._file = file
        self._reader = SeekingReader(file, validate_crcs=True)
        profile = self._reader.get_header().profile
        if profile != Profile.ROS2:
            raise BagError(f"{self.path} has the profile {profile!r}; only 'ros2' is read")
        summary = self._reader.get_summary() or Summary()
        self._check_chunks(summary)
        for texts in summary.metadata_indexes:
            if texts.length > MOST_TEXT_BYTES:
                raise ValueError(
                    f"its texts {shown(texts.name)} have {texts.length} bytes; "
                    f"at most {MOST_TEXT_BYTES} are read"
                )
        self._read_statistics(summary)
        hashes = {
            channel.schema_id: channel.metadata.get("topic_type_hash", "")
            for channel in summary.channels.values()
        }
        self.definitions = {
            schema.name: MessageDefinition(
                schema.name,
                schema.data.decode(errors="replace") if schema.encoding == SCHEMA_ENCODING else "",
                hashes.get(schema.id, ""),
            )
            for schema in summary.schemas.values()
        }

    def metadata_record(self, name: str) -> dict[str, str] | None:
        """Return the texts stored under a name (later ones count), None if there are none.

        Texts have no checksum of their own, so all of the file is checked.
        """
        texts: dict[str, str] | None = None
        try:
            check_data_section(self._content)
            for record in self._reader.iter_metadata():
                if record.name == name:
                    texts = {**(texts or {}), **record.metadata}
        except DAMAGE as error:
            raise self.damaged(error) from None
        return texts

    def verify(self) -> None:
        """Read everything once, texts included; errors as of `messages`."""
        self.metadata_record(RECORD_NAME)
        for _ in self.messages(None, None, None):
            pass

    def _check_chunks(self, summary: Summary) -> None:
        """Refuse chunks that unpack to too much, by what they state and by what they are."""
        budget = UnpackingBudget(len(self._content))
        channels: dict[tuple[int, ...], dict[int, int]] = {}
        for index in summary.chunk_indexes:
            offsets = index.message_index_offsets  # only its keys are used, and they repeat
            index.message_index_offsets = channels.setdefault(tuple(offsets), offsets)
            if not index.compression:
                continue
            start = index.chunk_start_offset + PREFIX.size
            *_, stated, _, name_bytes = CHUNK_HEAD.unpack_from(self._content, start)
            start += CHUNK_HEAD.size
            compression = self._content[start : start + name_bytes].decode()
            start += name_bytes + 8  # and the packed size
            packed = FRAME_HEAD_BYTES if compression == "zstd" else index.compressed_size
            check_chunk(compression, stated, self._content[start : start + packed])
            budget.take(stated)

    def _read_statistics(self, summary: Summary) -> None:
        if (statistics := summary.statistics) is None:
            rewrite = f"rewrite it with: scripts/iptm recover {self.path}"
            raise BagError(f"{self.path} has no statistics; {rewrite}")
        self.message_count = statistics.message_count
        if self.message_count:
            self.start_ns, self.end_ns = statistics.message_start_time, statistics.message_end_time
        counts = statistics.channel_message_counts
        self._counts_topics = bool(counts)  # some writers count no topics
        self._type_names: dict[int, str] = {}
        topics = []
        for channel in summary.channels.values():
            schema = summary.schemas.get(channel.schema_id)
            if channel.message_encoding != "cdr" or schema is None:
                raise BagError(
                    f"topic {channel.topic} of {self.path} is encoded as"
                    f" {channel.message_encoding!r}; only cdr with a schema is read"
                )
            self._type_names[channel.id] = schema.name
            topics.append(
                TopicRecord(
                    name=channel.topic,
                    type_name=schema.name,
                    type_hash=channel.metadata.get("topic_type_hash", ""),
                    offered_qos=parse_profiles(channel.metadata.get("offered_qos_profiles", "")),
                    message_count=counts.get(channel.id, 0),
                )
            )
        self.topics = topics

    def _read(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[BagMessage]:
        summary = self._reader.get_summary() or Summary()
        wanted = {
            number: channel.topic
            for number, channel in summary.channels.items()
            if topics is None or channel.topic in topics
        }
        chunks = sorted(
            (
                index
                for index in summary.chunk_indexes
                if (start_ns is None or index.message_end_time >= start_ns)
                and (end_ns is None or index.message_start_time < end_ns)
                and not wanted.keys().isdisjoint(index.message_index_offsets or wanted)
            ),
            key=attrgetter("message_start_time", "chunk_start_offset"),
        )
        held: list[_Found] = []
        for index, later in zip(chunks, [*chunks[1:], None], strict=False):
            held += _messages_of(self._records(index), index.chunk_start_offset, wanted)
            held.sort()
            ready = len(held) if later is None else bisect_left(held, (later.message_start_time,))
            for log_ns, _, _, publish_ns, channel, data in held[:ready]:
                if (start_ns is None or log_ns >= start_ns) and (end_ns is None or log_ns < end_ns):
                    topic, kind = wanted[channel], self._type_names[channel]
                    yield BagMessage(topic, kind, log_ns, publish_ns, data)
            del held[:ready]

    def _records(self, index: ChunkIndex) -> bytes:
        # In one read, and not from the map, whose pages would count as memory of the process.
        record = os.pread(self._file.fileno(), index.chunk_length, index.chunk_start_offset)
        start_ns, end_ns, size, checksum, name_bytes = CHUNK_HEAD.unpack_from(record, PREFIX.size)
        at = PREFIX.size + CHUNK_HEAD.size + name_bytes
        compression, content = record[at - name_bytes : at].decode(), record[at + 8 :]
        if not compression and checksum in {0, zlib.crc32(content)}:
            return content
        chunk = Chunk(compression, content, end_ns, start_ns, checksum, size)
        return (opened := get_chunk_data_stream(chunk, validate_crc=True))[0].read(opened[1])


def _messages_of(records: bytes, chunk: int, wanted: Container[int]) -> Iterator[_Found]:
    at, end = 0, len(records)
    while at < end:
        opcode, length = PREFIX.unpack_from(records, at)
        at += PREFIX.size
        if length > end - at:
            raise ValueError(f"a record of {length} bytes does not fit into its chunk")
        if opcode == Opcode.MESSAGE:
            channel, _, log_ns, publish_ns = _MESSAGE_HEAD.unpack_from(records, at)
            if channel in wanted:
                content = records[at + _MESSAGE_HEAD.size : at + length]
                yield log_ns, chunk, at, publish_ns, channel, content
        at += length
