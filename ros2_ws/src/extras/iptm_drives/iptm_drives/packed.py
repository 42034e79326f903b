"""Compressed files and archives: gzip, bzip2 and xz, and the one drive in a zip."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import re
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from iptm_core.errors import RouteError
from iptm_core.user_input import read_file

SUFFIXES = (".gz", ".bz2", ".xz")
_OPENERS: Mapping[bytes, Callable[..., Any]] = {
    b"\x1f\x8b": gzip.open,
    b"BZh": bz2.open,
    b"\xfd7zXZ": lzma.open,
}
_OFFICE = re.compile(rb"xl/|\[Content_Types\]|docProps")
_READABLE = (
    ".csv", ".txt", ".tsv", ".gpx", ".tcx", ".kml", ".nmea", ".fit", ".xlsx", ".json", ".vbo", ".xml",
    ".parquet", ".mcap",
)  # fmt: skip


def read_content(path: Path, most_bytes: int) -> bytes:
    """Return the content of a file, decompressed if it is of gzip, bzip2 or xz."""
    raw = read_file(path, most_bytes, RouteError)
    opener = next((each for magic, each in _OPENERS.items() if raw.startswith(magic)), None)
    if opener is None:
        return raw
    try:
        with opener(io.BytesIO(raw)) as packed:
            content: bytes = packed.read(most_bytes + 1)
    except (OSError, EOFError, zlib.error, lzma.LZMAError) as reason:
        raise RouteError(
            f"{path}: cannot be decompressed ({reason}); was it cut short?"
        ) from reason
    if len(content) > most_bytes:
        raise RouteError(f"{path}: more than {most_bytes} bytes; at most {most_bytes} are read")
    return content


def is_archive(content: bytes) -> bool:
    """Return whether a content is a zip archive and no workbook, which is one, too."""
    return content.startswith(b"PK\x03\x04") and not _OFFICE.search(content[:4096])


@contextmanager
def only_drive(path: Path, content: bytes, most_bytes: int) -> Iterator[Path]:
    """Unpack the one drive in a zip into a folder of its own while it is read.

    Raises:
        RouteError: the archive is damaged, or holds no drive or several; the message names them.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            drives = [each for each in archive.infolist() if _is_drive(each.filename)]
            if len(drives) != 1 or drives[0].file_size > most_bytes:
                names = ", ".join(each.filename for each in drives[:8]) or "none"
                raise RouteError(
                    f"{path} is a zip archive with the drives {names}; allowed: one of up to"
                    f" {most_bytes} bytes, or unpack it"
                )
            unpacked = archive.read(drives[0])
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, zlib.error, EOFError) as reason:
        raise RouteError(f"{path} is a zip archive, and cannot be read ({reason})") from reason
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / Path(drives[0].filename).name
        file.write_bytes(unpacked)
        try:
            yield file
        except RouteError as reason:
            raise RouteError(str(reason).replace(str(file), f"{path} ({file.name})")) from reason


def _is_drive(name: str) -> bool:
    plain = name.lower()
    hidden = plain.startswith("__macosx/") or Path(plain).name.startswith(".")
    return plain.endswith(_READABLE) and not hidden
