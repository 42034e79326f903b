"""One file of a bag, in whatever way it is stored: its topics, and its messages as plain CDR."""

from __future__ import annotations

import sqlite3
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from rosbags.rosbag1 import ReaderError as Ros1Error
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError
from zstandard import ZstdDecompressor

from iptm_core.errors import BagError
from iptm_recording.message_types import MessageDefinition
from iptm_recording.recorded_topics import TopicRecord
from iptm_recording.soundness import DAMAGE

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""Start of data packed with zstd; no CDR message begins so."""
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
class RawMessage:
    """One message as it was recorded.

    Attributes:
        topic: fully qualified topic name.
        type_name: `package/msg/Type`.
        log_time_ns: time of reception.
        publish_time_ns: time of publication.
        data: CDR bytes, header included.
    """

    topic: str
    type_name: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes


def unpacked(data: bytes) -> bytes:
    """Return the bytes of a message that rosbag2 may have packed with zstd, one by one.

    Raises:
        ZstdError: it has, and they are damaged.
    """
    return ZstdDecompressor().decompress(data) if data.startswith(ZSTD_MAGIC) else data


class StorageFile(ABC):
    """A sound file of a bag, opened for reading.

    Args:
        path: the file to read.
        source: the file given by the user, if `path` was unpacked from it.

    Attributes:
        path: the file given by the user.
        topics: recorded topics; one name may occur several times.
        message_count: messages of all topics together.
        start_ns: earliest log time, 0 without messages.
        end_ns: latest log time, 0 without messages.
        counts_topics: the counts of `topics` are those that the file promises.
        remarks: remarks for the user, one sentence each.
    """

    def __init__(self, path: Path, source: Path | None = None) -> None:
        self.path = source or path
        self._is_unpacked = source is not None
        self.topics: Sequence[TopicRecord] = ()
        self.message_count = 0
        self.start_ns = 0
        self.end_ns = 0
        self.counts_topics = True
        self.remarks: Sequence[str] = ()

    @abstractmethod
    def definitions(self) -> dict[str, MessageDefinition]:
        """Return the message definitions by type name."""

    @abstractmethod
    def close(self) -> None:
        """Close the file; a second call is free."""

    @abstractmethod
    def _read(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[RawMessage]:
        """Yield messages as `messages` does, without any check; errors are those of `STORAGE_DAMAGE`."""

    @abstractmethod
    def _way_out(self, path: Path) -> str:
        """Return what a user can do about damage of a file."""

    def metadata_record(self, name: str) -> dict[str, str] | None:  # noqa: ARG002
        """Return the texts stored under a name (later ones count), None if there are none.

        Raises:
            BagError: the file is damaged.
        """
        return None

    def messages(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[RawMessage]:
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
        """Read everything once.

        Raises:
            BagError: the file is damaged, or holds fewer messages than stated.
        """
        for _ in self.messages(None, None, None):
            pass

    def damaged(self, error: Exception | str) -> BagError:
        """Return the error to raise for damage, with the way out."""
        reason = " ".join(str(error).split()) or type(error).__name__
        way_out = self._way_out(self.path)
        if self._is_unpacked:
            inside = self._way_out(self.path.with_suffix(""))
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
