"""Reads an MCAP file from front to back as far as it goes, without trusting index or footer.

Ordinary readers start at the footer, which a file cut short does not have. The scanner walks from
record to record, looks into every chunk, also into a last one that was never finished, and hands out
only what is complete.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Message, Metadata, Schema

from iptm_core.errors import BagError
from iptm_recording.mcap_file import MAGIC

Record = Header | Schema | Channel | Message | Metadata

_PREFIX = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK_FIELDS = struct.Struct("<QQQI")
_COMPRESSION_LENGTH = struct.Struct("<I")
_LENGTH = struct.Struct("<Q")
_FIRST_PRIVATE_OPCODE = 0x80
_KNOWN_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_LAST_RECORDS = frozenset({int(Opcode.DATA_END), int(Opcode.FOOTER)})
_DAMAGE = (struct.error, UnicodeDecodeError, McapError, ValueError)


class McapScanner:
    """Front-to-back reader of one file; iterate over ``records`` once, then read the findings.

    Args:
        path: MCAP file, whole or cut anywhere.

    Attributes:
        total_bytes: size of the file.
        dropped_bytes: bytes that belong to no complete record.
        complete: True when the data section ends regularly and the file has its footer.
        notes: what was found to be damaged, one sentence each.

    Raises:
        BagError: the file cannot be read or is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._content = memoryview(path.read_bytes())
        except OSError as error:
            raise BagError(f"cannot read {path}: {error}") from None
        if bytes(self._content[: len(MAGIC)]) != MAGIC:
            raise BagError(
                f"{path} is not an MCAP file: it starts with"
                f" {bytes(self._content[: len(MAGIC)])!r} instead of {MAGIC!r}"
            )
        self.total_bytes = len(self._content)
        self.dropped_bytes = 0
        self.complete = False
        self.notes: list[str] = []

    def records(self) -> Iterator[Record]:
        """Yield header, schemas, channels, messages and metadata in file order."""
        content = self._content
        position = len(MAGIC)
        while position + _PREFIX.size <= len(content):
            opcode, length = _PREFIX.unpack_from(content, position)
            if opcode not in _KNOWN_OPCODES and opcode < _FIRST_PRIVATE_OPCODE:
                self.notes.append(f"no record starts at byte {position} (opcode {opcode:#04x})")
                break
            if opcode in _LAST_RECORDS:
                self.complete = bytes(content[-len(MAGIC) :]) == MAGIC and self._has_footer()
                break
            start = position + _PREFIX.size
            end = start + length
            body = content[start : min(end, len(content))]
            if opcode == Opcode.CHUNK:
                yield from self._chunk(body, position, is_cut=end > len(content))
            elif end > len(content):
                break
            else:
                yield from self._plain(opcode, body, position)
            position = end
        if not self.complete and position < len(content):
            self.dropped_bytes += len(content) - position

    def _has_footer(self) -> bool:
        footer_bytes = _PREFIX.size + 20 + len(MAGIC)
        return self.total_bytes > footer_bytes and self._content[-footer_bytes] == Opcode.FOOTER

    def _chunk(self, body: memoryview, position: int, *, is_cut: bool) -> Iterator[Record]:
        """Yield the complete records of a chunk, of which the end may be missing."""
        try:
            *_, checksum = _CHUNK_FIELDS.unpack_from(body, 0)
            (name_length,) = _COMPRESSION_LENGTH.unpack_from(body, _CHUNK_FIELDS.size)
            name_start = _CHUNK_FIELDS.size + _COMPRESSION_LENGTH.size
            stored_start = name_start + name_length + _LENGTH.size
            if stored_start > len(body):
                raise ValueError("its header is cut")
            compression = bytes(body[name_start : name_start + name_length]).decode()
            stored = body[stored_start:]
            content = stored if not compression else memoryview(_inflate(compression, stored))
        except _DAMAGE as error:
            self.notes.append(f"chunk at byte {position} is unreadable: {error}")
            self.dropped_bytes += _PREFIX.size + len(body)
            return
        if not is_cut and checksum and zlib.crc32(content) != checksum:
            self.notes.append(f"chunk at byte {position} does not match its checksum: left out")
            self.dropped_bytes += _PREFIX.size + len(body)
            return
        inner = 0
        while inner + _PREFIX.size <= len(content):
            opcode, length = _PREFIX.unpack_from(content, inner)
            start = inner + _PREFIX.size
            if start + length > len(content):
                break
            yield from self._plain(opcode, content[start : start + length], position)
            inner = start + length
        if inner < len(content):
            self.dropped_bytes += len(content) - inner
        if is_cut:
            self.notes.append(f"chunk at byte {position} was never finished")

    def _plain(self, opcode: int, body: memoryview, position: int) -> Iterator[Record]:
        """Yield the record itself if it is one of interest."""
        if opcode == Opcode.MESSAGE and len(body) >= _MESSAGE.size:
            channel_id, sequence, log_time, publish_time = _MESSAGE.unpack_from(body, 0)
            data = bytes(body[_MESSAGE.size :])
            yield Message(channel_id, log_time, data, publish_time, sequence)
            return
        stream = ReadDataStream(BytesIO(bytes(body)))
        try:
            if opcode == Opcode.HEADER:
                yield Header.read(stream)
            elif opcode == Opcode.SCHEMA:
                yield Schema.read(stream)
            elif opcode == Opcode.CHANNEL:
                yield Channel.read(stream)
            elif opcode == Opcode.METADATA:
                yield Metadata.read(stream)
        except _DAMAGE as error:
            self.notes.append(f"record in or at byte {position} is unreadable: {error!r}")
            self.dropped_bytes += len(body)


def _inflate(compression: str, stored: memoryview) -> bytes:
    """Decompress as much as there is of a chunk's content.

    Raises:
        ValueError: unknown compression, or damaged data.
    """
    if compression == "zstd":
        import zstandard  # noqa: PLC0415 - only for such files

        try:
            return zstandard.ZstdDecompressor().decompressobj().decompress(stored)
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from None
    if compression == "lz4":
        import lz4.frame  # type: ignore[import-untyped]  # noqa: PLC0415 - only for such files

        try:
            content: bytes = lz4.frame.LZ4FrameDecompressor().decompress(stored)
        except RuntimeError as error:
            raise ValueError(str(error)) from None
        return content
    raise ValueError(f"compression {compression!r} is unknown")
