"""Writes an MCAP file in which a killed process leaves every message it had handed over.

The usual way collects a chunk in memory and writes it when it is full: a kill loses the chunk. Here
the header of a chunk is written first, with the room reserved for it as its provisional length, each
message follows at once, and the header is corrected when the chunk is closed. The result is an
ordinary chunked, indexed file; one cut short is ordinary as well up to its last, unfinished chunk,
whose complete messages ``recover`` (and any reader that bears a short last record) still finds.

With compression a chunk has to be collected in memory, and a kill loses it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.well_known import Profile

from iptm_recording.mcap_chunk import Chunk, compressor, encode

MAGIC = b"\x89MCAP0\r\n"
DEFAULT_CHUNK_BYTES = 64 * 1024
LIBRARY = "iptm_recording"

_MESSAGE_PREFIX = struct.Struct("<BQHIQQ")
_FOOTER_START = struct.Struct("<BQQQ")
_MESSAGE_FIELDS_BYTES = 22


class McapFileWriter:
    """Writer of one MCAP file with profile "ros2"; topics and counting belong to the bag writer.

    Args:
        path: file to create; must not exist.
        chunk_bytes: room of a chunk; a larger message gets a chunk of its own.
        compression: "" (default), "lz4" or "zstd".
    """

    def __init__(
        self, path: Path, *, chunk_bytes: int = DEFAULT_CHUNK_BYTES, compression: str = ""
    ) -> None:
        self._compression = compression
        self._compress = compressor(compression)
        self._chunk_bytes = chunk_bytes
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunk_indexes: list[ChunkIndex] = []
        self._metadata_indexes: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._start_ns: int | None = None
        self._end_ns: int | None = None
        self._chunk: Chunk | None = None
        self._position = 0
        # Unbuffered on purpose: what was written survives the process.
        self._file = path.open("xb", buffering=0)
        self._write(MAGIC + encode(Header(profile=Profile.ROS2, library=LIBRARY)))

    @property
    def message_counts(self) -> Mapping[int, int]:
        """Messages written so far, by channel id."""
        return self._counts

    @property
    def start_ns(self) -> int | None:
        """Earliest log time so far; None without messages."""
        return self._start_ns

    @property
    def end_ns(self) -> int | None:
        """Latest log time so far; None without messages."""
        return self._end_ns

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Store a type definition.

        Returns:
            Its id.
        """
        schema = Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data)
        self._schemas.append(schema)
        self._append(encode(schema))
        return schema.id

    def add_channel(self, topic: str, schema_id: int, metadata: Mapping[str, str]) -> int:
        """Store a topic whose messages are CDR.

        Returns:
            Its id.
        """
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding="cdr",
            metadata=dict(metadata),
            schema_id=schema_id,
        )
        self._channels.append(channel)
        self._counts[channel.id] = 0
        self._append(encode(channel))
        return channel.id

    def add_message(
        self, channel_id: int, data: bytes, log_time_ns: int, publish_time_ns: int
    ) -> None:
        """Append one message; when this returns, a kill of the process no longer loses it.

        Args:
            channel_id: id that ``add_channel`` returned.
            data: CDR bytes.
            log_time_ns: time that orders the file, nanoseconds, not negative.
            publish_time_ns: time of publication, nanoseconds, not negative.
        """
        sequence = self._counts[channel_id] + 1
        record = (
            _MESSAGE_PREFIX.pack(
                Opcode.MESSAGE,
                _MESSAGE_FIELDS_BYTES + len(data),
                channel_id,
                sequence & 0xFFFFFFFF,
                log_time_ns,
                publish_time_ns,
            )
            + data
        )
        chunk = self._append(record)
        chunk.index.setdefault(channel_id, []).append((log_time_ns, chunk.used - len(record)))
        chunk.start_ns = min(chunk.start_ns, log_time_ns)
        chunk.end_ns = max(chunk.end_ns, log_time_ns)
        self._counts[channel_id] = sequence
        self._start_ns = log_time_ns if self._start_ns is None else min(self._start_ns, log_time_ns)
        self._end_ns = log_time_ns if self._end_ns is None else max(self._end_ns, log_time_ns)

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Store named texts beside the messages (closes the chunk in progress)."""
        self._close_chunk()
        record = encode(Metadata(name=name, metadata=dict(data)))
        index = MetadataIndex(offset=self._position, length=len(record), name=name)
        self._metadata_indexes.append(index)
        self._write(record)

    def finish(self) -> None:
        """Close the chunk in progress, write index and footer, close the file."""
        self._close_chunk()
        self._write(encode(DataEnd(0)))
        self._write(self._summary())
        self._file.close()

    def _chunk_for(self, record_bytes: int) -> Chunk:
        chunk = self._chunk
        if chunk is not None and chunk.used + record_bytes > chunk.room:
            self._close_chunk()
            chunk = None
        if chunk is None:
            chunk = Chunk(self._position, max(self._chunk_bytes, record_bytes))
            if not self._compression:
                self._write(chunk.header(chunk.room, ""))
            self._chunk = chunk
        return chunk

    def _append(self, record: bytes) -> Chunk:
        """Add a record to the chunk in progress, or to a new one when it does not fit."""
        chunk = self._chunk_for(len(record))
        if self._compression:
            chunk.collected += record
        else:
            self._write(record)
            chunk.crc = zlib.crc32(record, chunk.crc)
        chunk.used += len(record)
        return chunk

    def _close_chunk(self) -> None:
        chunk, self._chunk = self._chunk, None
        if chunk is None:
            return
        if self._compression:
            stored = self._compress(bytes(chunk.collected))
            chunk.crc = zlib.crc32(chunk.collected)
            self._write(chunk.header(len(stored), self._compression) + stored)
        else:
            self._file.seek(chunk.offset)
            self._file.write(chunk.header(chunk.used, ""))
            self._file.seek(self._position)
        stored_bytes = self._position - chunk.offset
        index_offset = self._position
        offsets: dict[int, int] = {}
        indexes = bytearray()
        for channel_id, entries in chunk.index.items():
            offsets[channel_id] = index_offset + len(indexes)
            indexes += encode(MessageIndex(channel_id=channel_id, records=entries))
        self._write(bytes(indexes))
        self._chunk_indexes.append(
            ChunkIndex(
                message_start_time=chunk.first_ns,
                message_end_time=chunk.end_ns,
                chunk_start_offset=chunk.offset,
                chunk_length=stored_bytes,
                message_index_offsets=offsets,
                message_index_length=len(indexes),
                compression=self._compression,
                compressed_size=stored_bytes - chunk.header_bytes(self._compression),
                uncompressed_size=chunk.used,
            )
        )

    def _summary(self) -> bytes:
        """Encode schemas, channels, counts and indexes, their offsets, the footer and the magic."""
        summary_start = self._position
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunk_indexes),
            message_count=sum(self._counts.values()),
            message_end_time=self._end_ns or 0,
            message_start_time=self._start_ns or 0,
            metadata_count=len(self._metadata_indexes),
            schema_count=len(self._schemas),
        )
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, [*self._schemas]),
            (Opcode.CHANNEL, [*self._channels]),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, [*self._chunk_indexes]),
            (Opcode.METADATA_INDEX, [*self._metadata_indexes]),
        ]
        content = bytearray()
        offsets = bytearray()
        for opcode, records in groups:
            if not records:
                continue
            group = b"".join(encode(record) for record in records)
            start = summary_start + len(content)
            offsets += encode(
                SummaryOffset(group_opcode=opcode, group_start=start, group_length=len(group))
            )
            content += group
        offsets_start = summary_start + len(content)
        content += offsets
        footer_start = _FOOTER_START.pack(Opcode.FOOTER, 20, summary_start, offsets_start)
        footer = Footer(
            summary_start=summary_start,
            summary_offset_start=offsets_start,
            summary_crc=zlib.crc32(footer_start, zlib.crc32(content)),
        )
        return bytes(content) + encode(footer) + MAGIC

    def _write(self, data: bytes) -> None:
        """Append to the file, all or nothing: after an error (disk full) it ends where it did."""
        view = memoryview(data)
        try:
            while view:
                view = view[self._file.write(view) or 0 :]
        except OSError:
            self._file.seek(self._position)
            self._file.truncate()
            raise
        self._position += len(data)
