"""What users hand over as files and numbers, read so that no mistake hangs or floods the process."""

from __future__ import annotations

import os
import stat
from pathlib import Path


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file.

    Args:
        path: the file; links are followed.
        most_bytes: largest size that is read.

    Raises:
        OSError: the file does not exist, cannot be read, is not a regular file (a pipe would never end, a
            device neither) or is too large.
    """
    # Non-blocking: opening a pipe would wait for a writer.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise OSError("not a regular file")
        if status.st_size > most_bytes:
            raise OSError(f"{status.st_size} bytes; at most {most_bytes} are read")
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            return file.read(most_bytes)
    finally:
        os.close(descriptor)


def is_path(text: str, suffixes: tuple[str, ...]) -> bool:
    """Return whether a text that may be a name is a path: with a folder in it, or with one of the suffixes.

    Args:
        text: input of the user; a part after ``#`` selects a part of the file.
        suffixes: in small letters.
    """
    lower = text.lower()
    return "/" in text or lower.endswith(suffixes) or lower.partition("#")[0].endswith(suffixes)


def number(text: str) -> float:
    """Read a plain decimal, as any other tool would: Python alone takes ``1_600`` for a number.

    Raises:
        ValueError: it is none.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a plain number")
    return float(text)


def whole_number(text: str) -> int:
    """Read a plain whole number; see `number`.

    Raises:
        ValueError: it is none.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a plain whole number")
    return int(text)
