"""A chunk of an MCAP file while it is being written, and the encoding of single records."""

from __future__ import annotations

import struct
from collections.abc import Callable

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import McapRecord

COMPRESSIONS = ("", "lz4", "zstd")

_RECORD_PREFIX = struct.Struct("<BQ")
_FIELDS = struct.Struct("<QQQI")
_LENGTH = struct.Struct("<Q")


class Chunk:
    """The chunk in progress.

    Args:
        offset: position of the chunk record in the file.
        room: bytes reserved for its content.

    Attributes:
        used: bytes of content so far.
        crc: checksum of the content so far.
        start_ns: earliest log time so far.
        end_ns: latest log time so far.
        index: log time and offset in the content of every message, by channel id.
        collected: the content, when it has to be compressed before it can be written.
    """

    def __init__(self, offset: int, room: int) -> None:
        self.offset = offset
        self.room = room
        self.used = 0
        self.crc = 0
        self.start_ns = 2**63 - 1
        self.end_ns = 0
        self.index: dict[int, list[tuple[int, int]]] = {}
        self.collected = bytearray()

    @property
    def first_ns(self) -> int:
        """Earliest log time; 0 when the chunk holds no message."""
        return self.start_ns if self.index else 0

    @staticmethod
    def header_bytes(compression: str) -> int:
        """Return the length of the record prefix and the fields before the content."""
        return _RECORD_PREFIX.size + _FIELDS.size + 4 + len(compression) + _LENGTH.size

    def header(self, stored_bytes: int, compression: str) -> bytes:
        """Return the record prefix and the fields before the content."""
        fields = self.header_bytes(compression) - _RECORD_PREFIX.size
        return (
            _RECORD_PREFIX.pack(Opcode.CHUNK, fields + stored_bytes)
            + _FIELDS.pack(self.first_ns, self.end_ns, self.used or stored_bytes, self.crc)
            + struct.pack("<I", len(compression))
            + compression.encode()
            + _LENGTH.pack(stored_bytes)
        )


def encode(record: McapRecord) -> bytes:
    """Return the bytes of a record, opcode and length included."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def compressor(compression: str) -> Callable[[bytes], bytes]:
    """Return the function that compresses the content of a chunk ("" leaves it as it is)."""
    if compression == "lz4":
        import lz4.frame  # type: ignore[import-untyped]  # noqa: PLC0415 - only on request

        return lz4.frame.compress
    if compression == "zstd":
        import zstandard  # noqa: PLC0415 - only on request

        return zstandard.compress
    return bytes
