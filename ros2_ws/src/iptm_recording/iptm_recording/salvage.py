"""Reads the complete records of an MCAP file from front to back, however the file ends.

Ordinary readers start at the footer, which a file cut short does not have. This one walks from
record to record with mcap's stream reader, checks every chunk, also looks into a last chunk that was
cut, and hands out only what is complete.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from iptm_core.errors import BagError

MAGIC = b"\x89MCAP0\r\n"

_PREFIX = struct.Struct("<BQ")
_FIRST_PRIVATE_OPCODE = 0x80
_KNOWN_OPCODES = frozenset(int(opcode) for opcode in Opcode)
# lz4 reports damage as RuntimeError, a checksum that does not match is a ValueError.
_DAMAGE = (McapError, ZstdError, RuntimeError, ValueError, struct.error)


class SalvageReader:
    """Front-to-back reader of one file; iterate over `records` once, then read the findings.

    Args:
        path: MCAP file, whole or cut anywhere.

    Attributes:
        total_bytes: size of the file.
        dropped_bytes: bytes that belong to no complete record.
        complete: True when the file ends with its footer.
        notes: what was found to be damaged, one sentence each.

    Raises:
        BagError: the file cannot be read or is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            with path.open("rb") as file:
                start = file.read(len(MAGIC))
            self.total_bytes = path.stat().st_size
        except OSError as error:
            raise BagError(f"cannot read {path}: {error}") from None
        if start != MAGIC:
            raise BagError(f"{path} is no MCAP file: it starts with {start!r}; allowed: {MAGIC!r}")
        self.dropped_bytes = 0
        self.complete = False
        self.notes: list[str] = []

    def records(self) -> Iterator[McapRecord]:
        """Yield the records outside chunks and the content of chunks in file order."""
        position: int | None = len(MAGIC)
        with self._path.open("rb") as file:
            while position is not None:
                file.seek(position)
                try:
                    reader = StreamReader(
                        file,
                        skip_magic=True,
                        emit_chunks=True,
                        record_size_limit=self.total_bytes,
                    )
                    for record in reader.records:
                        end = file.tell()
                        if isinstance(record, Chunk):
                            file.seek(position)
                            yield from self._chunk(file.read(end - position), position)
                        else:
                            yield record
                        position = end
                except _DAMAGE as error:
                    found, position = self._after_damage(file, position, error)
                    yield from found
                else:
                    self.complete = True
                    position = None

    def _chunk(self, raw: bytes, position: int) -> list[McapRecord]:
        """Return the content of a whole chunk; nothing if it does not match its checksum."""
        stream = StreamReader(BytesIO(raw), skip_magic=True, validate_crcs=True)
        found: list[McapRecord] = []
        try:
            found.extend(stream.records)
        except EndOfFile:
            pass  # the chunk is all that this stream holds
        except _DAMAGE as error:
            self.notes.append(f"chunk at byte {position} is damaged and left out: {error}")
            self.dropped_bytes += len(raw)
        return found

    def _after_damage(
        self, file: BinaryIO, position: int, error: Exception
    ) -> tuple[list[McapRecord], int | None]:
        """Return what is complete of a record that cannot be read, and where to go on, if at all."""
        file.seek(position)
        prefix = file.read(_PREFIX.size)
        left = self.total_bytes - position
        if len(prefix) < _PREFIX.size:
            self.dropped_bytes += left
            return [], None
        opcode, length = _PREFIX.unpack(prefix)
        if opcode not in _KNOWN_OPCODES and opcode < _FIRST_PRIVATE_OPCODE:
            self.notes.append(f"no record starts at byte {position} (opcode {opcode:#04x})")
            self.dropped_bytes += left
            return [], None
        whole = _PREFIX.size + length
        if whole <= left:
            self.notes.append(f"record at byte {position} is unreadable: {error!r}")
            self.dropped_bytes += whole
            return [], position + whole
        if opcode == Opcode.CHUNK:
            self.notes.append(f"chunk at byte {position} was never finished")
            return self._cut_chunk(file.read()), None
        self.dropped_bytes += left
        return [], None

    def _cut_chunk(self, body: bytes) -> list[McapRecord]:
        """Return the complete records of a chunk whose end is missing.

        Args:
            body: the fields of the chunk record as far as they go.
        """
        found: list[McapRecord] = []
        content = b""
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(body)))
            content = b"" if chunk.compression else chunk.data
        except _DAMAGE:
            pass  # not even its header is complete
        stream = BytesIO(content)
        end = 0
        try:
            for record in StreamReader(stream, skip_magic=True).records:
                found.append(record)
                end = stream.tell()
        except _DAMAGE:
            pass
        self.dropped_bytes += len(content) - end if content else _PREFIX.size + len(body)
        return found
