"""What the readers of a bag have in common: its messages, and the errors of damaged files."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, Final

from mcap.exceptions import McapError
from zstandard import ZstdError

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


@dataclass(frozen=True)
class BagMessage:
    """One message of a bag.

    Attributes:
        topic: fully qualified topic name.
        type_name: `package/msg/Type`.
        log_time_ns: time of reception.
        publish_time_ns: time of publication.
        data: CDR bytes, header included.
        message: it decoded, with the fields of its type, arrays as NumPy arrays; None unless asked for.
    """

    topic: str
    type_name: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes
    message: Any = None
