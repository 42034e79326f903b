"""Statistics and checksums of a whole MCAP file, checked against its bytes."""

from __future__ import annotations

import mmap
import struct
import zlib
from typing import Final

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from zstandard import ZstdError

MAGIC = b"\x89MCAP0\r\n"
DAMAGE: Final = (
    McapError,
    ZstdError,
    RuntimeError,  # what lz4 reports, and deep recursion
    ValueError,  # a checksum, or a text that is not UTF-8
    ArithmeticError,
    LookupError,
    EOFError,
    MemoryError,  # a damaged length asks for more than there is
    OSError,
    StopIteration,
    struct.error,
)
"""What mcap, lz4, zstandard and the operating system raise on damaged files."""

PREFIX = struct.Struct("<BQ")
"""Opcode and length in front of every record."""
DATA_END = struct.Struct("<BQI")
FOOTER = struct.Struct("<BQQQI")
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
        checksum = zlib.crc32(data[at : min(at + _BLOCK_BYTES, end)], checksum)
    return checksum
