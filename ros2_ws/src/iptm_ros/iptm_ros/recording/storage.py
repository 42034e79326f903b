"""One file of a bag, in whatever way it is stored: its topics, and its messages as plain CDR."""

from __future__ import annotations

import sqlite3
import struct
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final

from mcap.exceptions import McapError
from rosbags.rosbag1 import ReaderError as Ros1Error
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError
from zstandard import ZstdError

from iptm_core.errors import BagError
from iptm_ros.recording.message_types import MessageDefinition
from iptm_ros.recording.recorded_topics import TopicRecord
from iptm_ros.recording.unpacking import ZSTD_MAGIC, unpacked

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
STORAGE_DAMAGE: Final = (
    *DAMAGE,
    sqlite3.Error,
    Ros1Error,
    SerdeError,
    TypesysError,
    AssertionError,  # how rosbags refuses some malformed records
)
"""What the readers of all storages raise on damaged files."""


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


class StorageFile(ABC):
    """A sound file of a bag, opened for reading.

    Args:
        path: the file to read.
        source: the file given by the user, if `path` was unpacked from it.

    Attributes:
        path: the file given by the user.
        definitions: message definitions by type name.
        topics: recorded topics; one name may occur several times.
        message_count: messages of all topics together.
        start_ns: earliest log time, 0 without messages.
        end_ns: latest log time, 0 without messages.
        counts_topics: the counts of `topics` are those that the file promises.
        remarks: remarks for the user, one sentence each.

    Raises:
        BagError: it cannot be read, is of another kind, damaged, or was cut short.
    """

    kind: ClassVar[str]
    """What such a file is, with its article."""
    magic: ClassVar[bytes]
    """Bytes with which it starts."""
    remedy: ClassVar[str]
    """What a user can do about damage of a file `{path}`."""

    def __init__(self, path: Path, source: Path | None = None) -> None:
        self.path = source or path
        self._is_unpacked = source is not None
        self._opened = ExitStack()
        self.definitions: Mapping[str, MessageDefinition] = {}
        self.topics: Sequence[TopicRecord] = ()
        self.message_count = 0
        self.start_ns = 0
        self.end_ns = 0
        self.counts_topics = True
        self.remarks: Sequence[str] = ()
        try:
            with path.open("rb") as file:
                start = file.read(len(self.magic))
        except OSError as error:
            raise BagError(f"cannot read {self.path}: {error}") from None
        if start != self.magic:
            raise BagError(f"{self.path} is not {self.kind}: it starts with {start!r}")
        try:
            self._open(path)
        except BagError:
            self.close()
            raise
        except STORAGE_DAMAGE as error:
            self.close()
            raise self.damaged(error) from None

    @abstractmethod
    def _open(self, path: Path) -> None:
        """Fill the attributes; what is to be closed goes to `_opened`. Errors as of `_read`, or BagError."""

    @abstractmethod
    def _read(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[BagMessage]:
        """Yield messages as `messages` does, without any check; errors are those of `STORAGE_DAMAGE`."""

    def close(self) -> None:
        """Close the file; a second call is free."""
        self._opened.close()

    def metadata_record(self, name: str) -> dict[str, str] | None:  # noqa: ARG002
        """Return the texts stored under a name (later ones count), None if there are none."""
        return None

    def messages(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[BagMessage]:
        """Yield messages in order of log time, equal times in file order.

        Raises:
            BagError: the file is damaged, or holds fewer messages than stated.
        """
        found: Counter[str] = Counter()
        try:
            for message in self._read(topics, start_ns, end_ns):
                found[message.topic] += 1
                if message.data.startswith(ZSTD_MAGIC):
                    yield replace(message, data=unpacked(message.data))
                else:
                    yield message
        except STORAGE_DAMAGE as error:
            raise self.damaged(error) from None
        from_start = start_ns is None or start_ns <= self.start_ns
        to_end = end_ns is None or end_ns > self.end_ns
        if from_start and to_end and self.counts_topics:
            self._compare_counts(topics, found)

    def verify(self) -> None:
        """Read everything once; errors as of `messages`."""
        for _ in self.messages(None, None, None):
            pass

    def damaged(self, error: Exception | str) -> BagError:
        """Return the error to raise for damage, with the way out."""
        reason = " ".join(str(error).split()) or type(error).__name__
        way_out = self.remedy.format(path=self.path)
        if self._is_unpacked:
            inside = self.remedy.format(path=self.path.with_suffix(""))
            way_out = f"unpack it with: zstd -d {self.path}; then {inside}"
        return BagError(f"{self.path} is damaged ({reason}); {way_out}")

    def _compare_counts(self, topics: Collection[str] | None, found: Counter[str]) -> None:
        """Compare the messages that were read with the statistics of the file."""
        promised: Counter[str] = Counter()
        for topic in self.topics:
            promised[topic.name] += topic.message_count
        for name, count in promised.items():
            if (topics is None or name in topics) and found[name] != count:
                raise self.damaged(
                    f"{found[name]} messages of {name} are found, by its statistics it holds {count}"
                )
