"""The MCAP files of a bag: which they are, and one of them opened for reading."""

from __future__ import annotations

import mmap
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from mcap.reader import SeekingReader
from mcap.records import Channel, Message, Statistics
from mcap.summary import Summary
from mcap.well_known import Profile

from iptm_core.errors import BagError
from iptm_core.strict_mapping import shown
from iptm_recording.message_types import SCHEMA_ENCODING, MessageDefinition
from iptm_recording.soundness import DAMAGE, FOOTER, MAGIC, check_data_section, summary_start

_COMPRESSED_SUFFIXES = (".zstd", ".lz4")
_ONLY_INSIDE = "only the compression inside MCAP files is read"


def find_files(path: Path, metadata: Mapping[str, Any]) -> list[Path]:
    """Return the MCAP files of a bag in recording order.

    Args:
        path: bag folder or .mcap file.
        metadata: content of the folder's `metadata.yaml`; empty when there is none.

    Raises:
        BagError: there is no such bag, or it is stored in another way.
    """
    if path.is_file():
        if path.suffix == ".db3":
            raise BagError(f"{path} is an SQLite bag; only MCAP is read ({_conversion_hint()})")
        if path.suffix == ".bag":
            raise BagError(
                f"{path} is a ROS 1 bag; only MCAP is read"
                f" ({_conversion_hint(' --dst-typestore ros2_jazzy')})"
            )
        if path.suffix in _COMPRESSED_SUFFIXES:
            raise BagError(
                f"{path} is compressed by rosbag2; {_ONLY_INSIDE} ({_conversion_hint()})"
            )
        return [path]
    if not metadata:
        if any(path.glob("*.mcap")):
            raise BagError(
                f"{path} has no metadata.yaml: its recording was cut short;"
                f" repair it with: scripts/recover_bag {path}"
            )
        raise BagError(f"{path} is no bag: it holds neither metadata.yaml nor an .mcap file")
    return _listed_files(path, metadata)


def check_exists(path: Path) -> None:
    """Refuse a bag that is not there.

    Raises:
        BagError: it is not, or nothing can have such a name.
    """
    try:
        exists = path.exists()
    except OSError as error:
        raise BagError(f"bag {shown(str(path))}: {error.strerror}") from None
    if not exists:
        raise BagError(f"{path} does not exist")


def _listed_files(folder: Path, metadata: Mapping[str, Any]) -> list[Path]:
    storage = metadata.get("storage_identifier")
    if storage != "mcap":
        raise BagError(
            f"{folder} is stored as {storage!r}; only mcap is read ({_conversion_hint()})"
        )
    if metadata.get("compression_mode"):
        raise BagError(
            f"{folder} is compressed by rosbag2 (mode {metadata['compression_mode']!r});"
            f" {_ONLY_INSIDE} ({_conversion_hint()})"
        )
    names = metadata.get("relative_file_paths")
    if not isinstance(names, list) or not names:
        raise BagError(f"{folder / 'metadata.yaml'} names no file in relative_file_paths")
    files = [folder / Path(str(name)).name for name in names]
    for file in files:
        if not file.is_file():
            raise BagError(f"{file} is missing, though metadata.yaml of its bag names it")
    return files


def _conversion_hint(options: str = "") -> str:
    command = f"rosbags-convert --src <bag> --dst <new bag> --dst-storage mcap{options}"
    return f"convert it with: {command}"


class BagFile:
    """One sound MCAP file with ROS 2 messages, opened for reading.

    Args:
        path: the file.

    Attributes:
        path: the file.
        statistics: number of messages, in all and by channel; earliest and latest log time (ns).

    Raises:
        BagError: it cannot be read, is no MCAP file of ROS 2 messages, or was cut short.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._map: mmap.mmap | None = None
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise BagError(f"cannot read {path}: {error}") from None
        try:
            self._check_ends()
            summary_start(self._content())
            self._reader = SeekingReader(self._file, validate_crcs=True)
            self._check_profile()
            self._summary = self._reader.get_summary() or Summary()
            self.statistics = self._required_statistics()
        except BagError:
            self.close()
            raise
        except DAMAGE as error:
            self.close()
            raise self._damaged(error) from None

    def channels(self) -> Iterator[tuple[Channel, str, int]]:
        """Yield every topic with its type name and its number of messages.

        Raises:
            BagError: a topic holds no CDR messages.
        """
        counts = self.statistics.channel_message_counts
        for channel in self._summary.channels.values():
            schema = self._summary.schemas.get(channel.schema_id)
            if channel.message_encoding != "cdr" or schema is None:
                raise BagError(
                    f"topic {channel.topic} of {self.path} is encoded as"
                    f" {channel.message_encoding!r}; only cdr with a schema is read"
                )
            yield channel, schema.name, counts.get(channel.id, 0)

    def definitions(self) -> dict[str, MessageDefinition]:
        """Return the message definitions by type name."""
        hashes = {
            channel.schema_id: channel.metadata.get("topic_type_hash", "")
            for channel in self._summary.channels.values()
        }
        return {
            schema.name: MessageDefinition(
                schema.name,
                schema.data.decode(errors="replace") if schema.encoding == SCHEMA_ENCODING else "",
                hashes.get(schema.id, ""),
            )
            for schema in self._summary.schemas.values()
        }

    def metadata_record(self, name: str) -> dict[str, str] | None:
        """Return the texts stored under a name (later ones count), None if there are none.

        Raises:
            BagError: the file is damaged; texts have no checksum of their own, so all of it is checked.
        """
        texts: dict[str, str] | None = None
        try:
            check_data_section(self._content())
            for record in self._reader.iter_metadata():
                if record.name == name:
                    texts = {**(texts or {}), **record.metadata}
        except DAMAGE as error:
            raise self._damaged(error) from None
        return texts

    def messages(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[tuple[Channel, Message]]:
        """Yield messages in order of log time, equal times in file order.

        Raises:
            BagError: the file is damaged, or holds fewer messages than it says.
        """
        found: Counter[int] = Counter()
        try:
            for _, channel, message in self._reader.iter_messages(
                topics=None if topics is None else list(topics),
                starting_at=start_ns,
                ending_before=end_ns,
            ):
                found[channel.id] += 1
                yield channel, message
        except DAMAGE as error:
            raise self._damaged(error) from None
        from_start = start_ns is None or start_ns <= self.statistics.message_start_time
        to_end = end_ns is None or end_ns > self.statistics.message_end_time
        if from_start and to_end:
            self._compare_counts(topics, found)

    def _compare_counts(self, topics: Collection[str] | None, found: Counter[int]) -> None:
        """Compare the messages that were read with the statistics of the file."""
        if not self.statistics.channel_message_counts:
            return  # some writers count no topics
        for channel, _, count in self.channels():
            if (topics is None or channel.topic in topics) and found[channel.id] != count:
                raise self._damaged(
                    ValueError(
                        f"{found[channel.id]} messages of {channel.topic} are found,"
                        f" by its statistics it holds {count}"
                    )
                )

    def close(self) -> None:
        """Close the file."""
        if self._map is not None:
            self._map.close()
        self._file.close()

    def _content(self) -> mmap.mmap:
        """Return the bytes of the file."""
        if self._map is None:
            self._map = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
        return self._map

    def _check_ends(self) -> None:
        start = self._file.read(len(MAGIC))
        if start != MAGIC:
            raise BagError(f"{self.path} is no MCAP file: it starts with {start!r}")
        size = self._file.seek(0, 2)
        self._file.seek(max(0, size - len(MAGIC)))
        if size < 2 * len(MAGIC) + FOOTER.size or self._file.read() != MAGIC:
            raise BagError(
                f"{self.path} ends without its footer: its recording was cut short;"
                f" repair it with: scripts/recover_bag {self.path}"
            )
        self._file.seek(0)

    def _check_profile(self) -> None:
        profile = self._reader.get_header().profile
        if profile != Profile.ROS2:
            raise BagError(f"{self.path} has the profile {profile!r}; only 'ros2' is read")

    def _required_statistics(self) -> Statistics:
        if self._summary.statistics is None:
            raise BagError(
                f"{self.path} has no statistics; rewrite it with: scripts/recover_bag {self.path}"
            )
        return self._summary.statistics

    def _damaged(self, error: Exception) -> BagError:
        return BagError(
            f"{self.path} is damaged ({error or type(error).__name__});"
            f" save what is whole with: scripts/recover_bag {self.path}"
        )
