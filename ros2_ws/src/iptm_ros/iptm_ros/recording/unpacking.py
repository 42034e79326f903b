"""Bounds on what the packed parts of a bag unpack to: a few kilobytes can stand for gigabytes.

A chunk is held in memory, so its size is bounded. All chunks together may
be `LARGEST_RATIO` times as large as the file that they are in, which no recording of a vehicle comes near.
"""

from __future__ import annotations

from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]
from zstandard import CONTENTSIZE_UNKNOWN, ZstdError, get_frame_parameters

MOST_PART_BYTES = 32 * 2**20
LARGEST_RATIO = 200
MOST_TEXT_BYTES = 2 * 2**20
"""Of a record of texts: those about a run that are larger cannot be read as YAML anyway."""
SMALL_BYTES = 64 * 2**20
"""All parts together may have this size however small their file is."""
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""Start of data packed with zstd; no CDR message begins so."""
FRAME_HEAD_BYTES = 18
"""Longest head of a frame of zstd, which states the size of its content."""
_LARGEST_LZ4_RATIO = 255


class UnpackingBudget:
    """What the parts of a file may still unpack to.

    Args:
        packed_bytes: size of the file.
    """

    def __init__(self, packed_bytes: int) -> None:
        self._most = max(SMALL_BYTES, LARGEST_RATIO * packed_bytes)
        self._taken = 0

    def take(self, size: int) -> None:
        """Count bytes; a ValueError if all so far are too many."""
        self._taken += size
        if self._taken > self._most:
            raise ValueError(f"it unpacks to more than {self._most} bytes; at most these are read")


def check_part(size: int) -> None:
    """Raise a ValueError for a part that is too large to be held in memory."""
    if size > MOST_PART_BYTES:
        raise ValueError(f"a part unpacks to {size} bytes; at most {MOST_PART_BYTES} are read")


def check_chunk(compression: str, stated_bytes: int, data: bytes) -> None:
    """Raise a ValueError for a chunk of MCAP that states, or holds, too much.

    Args:
        data: its packed content; of zstd the first `FRAME_HEAD_BYTES` are enough.
    """
    check_part(stated_bytes)
    if compression == "zstd":
        _check_frame(data)
    elif compression == "lz4" and len(data) * _LARGEST_LZ4_RATIO > MOST_PART_BYTES:
        lz4_part(data)


def lz4_part(data: bytes) -> bytes:
    """Return what a part packed with lz4 holds; a ValueError if that is too much."""
    unpacking = LZ4FrameDecompressor()
    plain: bytes = unpacking.decompress(data, max_length=MOST_PART_BYTES + 1)
    check_part(len(plain))
    if not unpacking.eof:
        raise ValueError("its compressed content has no end")
    return plain


def _check_frame(data: bytes) -> None:
    """Check the size that a zstd frame states; one that states none is limited by its reader."""
    try:
        size = get_frame_parameters(data).content_size
    except ZstdError:
        return  # damage is for the reader to report
    if size != CONTENTSIZE_UNKNOWN:
        check_part(size)
