"""Reads the sound records of an MCAP file from front to back, however the file ends or is damaged.

Ordinary readers start at the footer, which a file cut short does not have. This one walks from
record to record, checks the length of each and the checksum of each chunk, looks
into a last chunk that was cut, and goes on at the next sound chunk behind damage. What it cannot hand
out it lists: where, how many bytes, and the number of messages by topic, as far as the file states it.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

from mcap import records as mcap_records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk, Footer, McapRecord, Message, MessageIndex, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk

from iptm_core.errors import BagError
from iptm_ros.recording.mcap_storage import (
    CHUNK_HEAD,
    DATA_END,
    MAGIC,
    PREFIX,
    check_data_section,
    summary_start,
)
from iptm_ros.recording.storage import DAMAGE, MOST_TEXT_BYTES, UnpackingBudget, check_chunk

_DATA_END_PREFIX = PREFIX.pack(Opcode.DATA_END, 4)
_LONGEST_COMPRESSION_NAME = 32
_FIRST_PRIVATE_OPCODE = 0x80
_KNOWN_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_READERS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    int(opcode): getattr(mcap_records, opcode.name.title().replace("_", "")).read
    for opcode in Opcode
    if opcode is not Opcode.MESSAGE
}
_NS = 1e-9


@dataclass
class Damage:
    """A stretch of a file that is left out.

    Attributes:
        position: its first byte.
        size: bytes.
        reason: what is wrong with it.
        message_counts: messages that it held, by channel; None if unknown.
        span_ns: log times of these messages, None when unknown.
    """

    position: int
    size: int
    reason: str
    message_counts: Counter[int] | None = None
    span_ns: tuple[int, int] | None = None

    def __str__(self) -> str:
        text = f"{self.size} bytes from byte {self.position} on left out: {self.reason}"
        if self.message_counts:
            text += f"; {self.message_counts.total()} messages"
            if self.span_ns is not None:
                text += f" from {self.span_ns[0] * _NS:.3f} s to {self.span_ns[1] * _NS:.3f} s"
        return text


@dataclass
class SalvageReader:
    """Front-to-back reader of one file; iterate over `records` once, then read the findings.

    Args:
        path: MCAP file, whole, cut anywhere or damaged.

    Attributes:
        total_bytes: size of the file.
        complete: True when the file ends with its footer and nothing of it is damaged.
        damages: what was left out.
        notes: what else is not as it should be, one sentence each.
        statistics: statistics record of the file; None if missing or damaged.
    """

    path: Path
    total_bytes: int = field(init=False, default=0)
    complete: bool = field(init=False, default=False)
    damages: list[Damage] = field(init=False, default_factory=list)
    notes: list[str] = field(init=False, default_factory=list)
    statistics: Statistics | None = field(init=False, default=None)
    _chunks: set[tuple[int, int, int]] = field(init=False, default_factory=set, repr=False)
    _budget: UnpackingBudget = field(init=False, repr=False)

    def __post_init__(self) -> None:
        try:
            with self.path.open("rb") as file:
                start = file.read(len(MAGIC))
            self.total_bytes = self.path.stat().st_size
        except OSError as error:
            raise BagError(f"cannot read {self.path}: {error}") from None
        if start != MAGIC:
            raise BagError(
                f"{self.path} is not an MCAP file: it starts with {start!r}; allowed: {MAGIC!r}"
            )

    @property
    def dropped_bytes(self) -> int:
        """Bytes that belong to no complete record."""
        return sum(damage.size for damage in self.damages)

    def records(self) -> Iterator[McapRecord]:
        """Yield the records outside chunks and the content of chunks in file order."""
        with (
            self.path.open("rb") as file,
            mmap.mmap(file.fileno(), self.total_bytes, access=mmap.ACCESS_READ) as data,
        ):
            ends_with_footer = yield from self._walk(data)
            if ends_with_footer:
                self._check_ends(data)
            self.complete = ends_with_footer and not self.damages and not self.notes

    def _walk(self, data: mmap.mmap) -> Generator[McapRecord, None, bool]:
        """Yield the sound records; return whether the footer was reached."""
        self._chunks.clear()
        self._budget = UnpackingBudget(self.total_bytes)
        position = len(MAGIC)
        of_chunk: Damage | None = None  # the damaged chunk to which message indexes may belong
        while position < self.total_bytes:
            try:
                record, end = _read_record(data, position)
            except DAMAGE as error:
                found, position = self._after_damage(data, position, str(error))
                yield from found
                of_chunk = None
                continue
            if isinstance(record, Chunk):
                damages = len(self.damages)
                yield from self._chunk(record, position, end)
                of_chunk = self.damages[-1] if len(self.damages) > damages else None
            elif isinstance(record, MessageIndex) and of_chunk is not None:
                of_chunk.message_counts = of_chunk.message_counts or Counter()
                of_chunk.message_counts[record.channel_id] += len(record.records)
            elif isinstance(record, Footer):
                return True
            elif record is not None:
                if isinstance(record, Statistics):
                    self._take_statistics(record, position)
                if not isinstance(record, MessageIndex):
                    of_chunk = None
                yield record
            position = end
        return False

    def _take_statistics(self, statistics: Statistics, position: int) -> None:
        """Keep the statistics if their counts add up; damaged ones rarely do, and may have no checksum."""
        if statistics.message_count == sum(statistics.channel_message_counts.values()):
            self.statistics = statistics
        else:
            self.notes.append(f"statistics at byte {position} contradict themselves")

    def _chunk(self, chunk: Chunk, position: int, end: int) -> list[McapRecord]:
        """Return the content of a whole chunk; nothing if it does not match its checksum or occurs before."""
        try:
            if chunk.compression:
                check_chunk(chunk.compression, chunk.uncompressed_size, chunk.data)
                self._budget.take(chunk.uncompressed_size)
            content = breakup_chunk(chunk, validate_crc=True)
        except DAMAGE as error:
            reason = f"a damaged chunk ({error or type(error).__name__})"
            span_ns = (chunk.message_start_time, chunk.message_end_time)
            self.damages.append(Damage(position, end - position, reason, span_ns=span_ns))
            return []
        # Its messages hold their times, so that two chunks of a recording are never equal.
        key = chunk.message_start_time, chunk.message_end_time, zlib.crc32(chunk.data)
        if key in self._chunks:
            self.notes.append(f"chunk at byte {position} occurs before and is left out")
            return []
        self._chunks.add(key)
        return content

    def _after_damage(
        self, data: mmap.mmap, position: int, reason: str
    ) -> tuple[list[McapRecord], int]:
        """Return what can be had of a record that cannot be read, and where to go on."""
        further = _next_sound(data, position + 1)
        if further is None and data[position] == Opcode.CHUNK:
            return self._cut_chunk(data, position), self.total_bytes
        end = self.total_bytes if further is None else further
        self.damages.append(Damage(position, end - position, reason or "no record starts there"))
        return [], end

    def _cut_chunk(self, data: mmap.mmap, position: int) -> list[McapRecord]:
        """Return the complete records of a chunk whose end is missing."""
        self.notes.append(f"chunk at byte {position} was never finished")
        body = data[position + PREFIX.size :]
        found: list[McapRecord] = []
        content = b""
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(body)))
            content = b"" if chunk.compression else chunk.data
        except DAMAGE:
            pass  # not even its header is complete
        stream = BytesIO(content)
        end = 0
        try:
            for record in StreamReader(stream, skip_magic=True).records:
                # The reader returns a truncated message shorter than its stated length.
                if stream.tell() - end < PREFIX.size + PREFIX.unpack_from(content, end)[1]:
                    break
                found.append(record)
                end = stream.tell()
        except DAMAGE:
            pass
        dropped = len(content) - end if content else PREFIX.size + len(body)
        if dropped:
            at = self.total_bytes - dropped
            self.damages.append(Damage(at, dropped, "the file ends within a record"))
        return found

    def _check_ends(self, data: mmap.mmap) -> None:
        """Note what is wrong with the summary of a file with a footer, or with texts outside chunks."""
        try:
            summary_start(data)
        except DAMAGE as error:
            self.notes.append(f"{self.path.name}: {error}")
            self.statistics = None
            return
        try:
            if not self.damages:
                check_data_section(data)
        except DAMAGE as error:
            self.notes.append(f"{self.path.name}: {error}")


def _read_record(data: mmap.mmap, position: int) -> tuple[McapRecord | None, int]:
    """Return the record at a position (None for one of a private kind) and where it ends."""
    left = len(data) - position
    if left < PREFIX.size:
        raise ValueError("the file ends within a record")
    opcode, length = PREFIX.unpack_from(data, position)
    if opcode not in _KNOWN_OPCODES and opcode < _FIRST_PRIVATE_OPCODE:
        raise ValueError(f"no record starts there (opcode {opcode:#04x})")
    end = position + PREFIX.size + length
    if end > len(data):
        raise ValueError("the file ends within a record")
    if opcode == Opcode.METADATA and length > MOST_TEXT_BYTES:
        raise ValueError(f"texts of {length} bytes; at most {MOST_TEXT_BYTES} are read")
    body = data[position + PREFIX.size : end]
    if opcode == Opcode.MESSAGE:
        return Message.read(ReadDataStream(BytesIO(body)), length), end
    reader = _READERS.get(opcode)
    if reader is None:
        if end < len(data) and data[end] not in _KNOWN_OPCODES:
            raise ValueError(f"no record starts there (opcode {opcode:#04x})")
        return None, end
    stream = ReadDataStream(BytesIO(body))
    record = reader(stream)
    if stream.count != length:
        raise ValueError(f"a {type(record).__name__} record has a wrong length")
    return record, end


def _next_sound(data: mmap.mmap, position: int) -> int | None:
    """Return the start of the next chunk of correct length, or the end of the data section."""
    last = data.find(_DATA_END_PREFIX, position)
    while last >= 0:
        behind = last + DATA_END.size
        if behind < len(data) and data[behind] in _KNOWN_OPCODES:
            break
        last = data.find(_DATA_END_PREFIX, last + 1)
    limit = last if last >= 0 else len(data)
    mark = bytes([Opcode.CHUNK])
    candidate = data.find(mark, position, limit)
    while candidate >= 0:
        if _is_chunk(data, candidate):
            return candidate
        candidate = data.find(mark, candidate + 1, limit)
    return last if last >= 0 else None


def _is_chunk(data: mmap.mmap, position: int) -> bool:
    """Return whether the three lengths of a chunk record at a position fit together."""
    body = position + PREFIX.size
    if body + CHUNK_HEAD.size > len(data):
        return False
    length = PREFIX.unpack_from(data, position)[1]
    name_length = CHUNK_HEAD.unpack_from(data, body)[-1]
    rest: int = length - CHUNK_HEAD.size - name_length - 8
    if body + length > len(data) or name_length > _LONGEST_COMPRESSION_NAME or rest < 0:
        return False
    size: int = struct.unpack_from("<Q", data, body + CHUNK_HEAD.size + name_length)[0]
    return size == rest
