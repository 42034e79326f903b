"""An MCAP file of a bag, opened for reading."""

from __future__ import annotations

import mmap
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import final

from mcap.reader import SeekingReader
from mcap.summary import Summary
from mcap.well_known import Profile

from iptm_core.errors import BagError
from iptm_recording.message_types import SCHEMA_ENCODING, MessageDefinition
from iptm_recording.recorded_topics import TopicRecord, parse_profiles
from iptm_recording.run_information import RECORD_NAME
from iptm_recording.soundness import DAMAGE, FOOTER, MAGIC, check_data_section, summary_start
from iptm_recording.storage import RawMessage, StorageFile


@final
class McapStorage(StorageFile):
    """See `StorageFile`.

    Raises:
        BagError: it cannot be read, is not an MCAP file of ROS 2 messages, or was cut short.
    """

    def __init__(self, path: Path, source: Path | None = None) -> None:
        super().__init__(path, source)
        self._map: mmap.mmap | None = None
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise BagError(f"cannot read {self.path}: {error}") from None
        try:
            self._check_ends()
            summary_start(self._content())
            self._reader = SeekingReader(self._file, validate_crcs=True)
            self._check_profile()
            self._summary = self._reader.get_summary() or Summary()
            self._read_statistics()
        except BagError:
            self.close()
            raise
        except DAMAGE as error:
            self.close()
            raise self.damaged(error) from None

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
            raise self.damaged(error) from None
        return texts

    def verify(self) -> None:
        """Read everything once, texts included."""
        self.metadata_record(RECORD_NAME)
        super().verify()

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
            raise BagError(f"{self.path} is not an MCAP file: it starts with {start!r}")
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

    def _read_statistics(self) -> None:
        statistics = self._summary.statistics
        if statistics is None:
            raise BagError(
                f"{self.path} has no statistics; rewrite it with: scripts/recover_bag {self.path}"
            )
        self.message_count = statistics.message_count
        if self.message_count:
            self.start_ns, self.end_ns = statistics.message_start_time, statistics.message_end_time
        counts = statistics.channel_message_counts
        self.counts_topics = bool(counts)  # some writers count no topics
        self._type_names: dict[int, str] = {}
        topics = []
        for channel in self._summary.channels.values():
            schema = self._summary.schemas.get(channel.schema_id)
            if channel.message_encoding != "cdr" or schema is None:
                raise BagError(
                    f"topic {channel.topic} of {self.path} is encoded as"
                    f" {channel.message_encoding!r}; only cdr with a schema is read"
                )
            self._type_names[channel.id] = schema.name
            topics.append(
                TopicRecord(
                    name=channel.topic,
                    type_name=schema.name,
                    type_hash=channel.metadata.get("topic_type_hash", ""),
                    offered_qos=parse_profiles(channel.metadata.get("offered_qos_profiles", "")),
                    message_count=counts.get(channel.id, 0),
                )
            )
        self.topics = topics

    def _read(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[RawMessage]:
        for _, channel, message in self._reader.iter_messages(
            topics=None if topics is None else list(topics),
            starting_at=start_ns,
            ending_before=end_ns,
        ):
            yield RawMessage(
                topic=channel.topic,
                type_name=self._type_names[channel.id],
                log_time_ns=message.log_time,
                publish_time_ns=message.publish_time,
                data=message.data,
            )

    def _way_out(self, path: Path) -> str:
        return f"save what is whole with: scripts/recover_bag {path}"
