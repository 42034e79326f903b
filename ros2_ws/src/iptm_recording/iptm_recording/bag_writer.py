"""Writes a rosbag2 bag folder: `<name>/metadata.yaml` and `<name>/<name>_0.mcap`.

`flush` puts every message so far into the file, where a kill of the process does not reach it;
`metadata.yaml` appears when the bag is closed. A bag that was never closed is completed by `recover`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Final, final

from mcap.well_known import MessageEncoding, Profile
from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Qos

from iptm_core.errors import BagError
from iptm_core.strict_mapping import shown
from iptm_recording.message_types import SCHEMA_ENCODING, MessageDefinition, message_definition
from iptm_recording.metadata import NO_START_NS, describe_bag, metadata_text, write_metadata
from iptm_recording.recorded_topics import TopicRecord, dump_profiles
from iptm_recording.run_information import RECORD_NAME

ROSBAG2_RECORD_NAME = "rosbag2"
DEFAULT_DISTRO = "jazzy"
DEFAULT_CHUNK_BYTES = 64 * 1024
COMPRESSIONS: Final = {
    "none": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}
_SEQUENCE_MASK = 0xFFFFFFFF


@final
class BagWriter(AbstractContextManager["BagWriter"]):
    """Writer of one bag folder; use it as a context manager or call `close`.

    Args:
        folder: bag folder to create; refuses an existing one.
        custom_data: texts about the run, by name.
        compression: key of `COMPRESSIONS`; with compression a kill loses a whole chunk.
        chunk_bytes: content after which a chunk of the file is written.

    Raises:
        BagError: the folder exists or cannot be created.
    """

    def __init__(
        self,
        folder: Path,
        *,
        custom_data: Mapping[str, str] | None = None,
        compression: str = "none",
        chunk_bytes: int = DEFAULT_CHUNK_BYTES,
    ) -> None:
        self.folder = folder.absolute()
        self._custom_data = dict(custom_data or {})
        self._is_compressed = compression != "none"
        self._schema_ids: dict[str, int] = {}
        self._topics: dict[int, TopicRecord] = {}
        self._counts: dict[int, int] = {}
        self._start_ns = NO_START_NS
        self._end_ns = 0
        self._is_closed = False
        if compression not in COMPRESSIONS:
            allowed = ", ".join(COMPRESSIONS)
            raise BagError(f"compression is {compression!r}; allowed: {allowed}")
        self._path = self.folder / f"{self.folder.name}_0.mcap"
        try:
            self.folder.mkdir(parents=True)
            self._file = self._path.open("xb")
        except FileExistsError:
            raise BagError(f"{folder} exists already; a bag is never overwritten") from None
        except OSError as error:
            raise BagError(
                f"cannot create the bag {shown(str(folder))}: {error.strerror}"
            ) from None
        self._writer = Writer(
            self._file,
            chunk_size=chunk_bytes,
            compression=COMPRESSIONS[compression],
            enable_data_crcs=True,  # texts about the run have no other checksum
        )
        try:
            self._writer.start(Profile.ROS2, library="iptm_recording")
            if self._custom_data:
                self._writer.add_metadata(RECORD_NAME, self._custom_data)
            self._file.flush()
        except OSError as error:
            raise self._failed(error) from None

    @property
    def message_counts(self) -> dict[str, int]:
        """Messages written so far, by topic name."""
        return {topic.name: self._counts[key] for key, topic in self._topics.items()}

    def add_topic(
        self,
        name: str,
        type_name: str,
        *,
        offered_qos: Sequence[Qos] = (),
        definition: MessageDefinition | None = None,
    ) -> int:
        """Announce a topic.

        Args:
            name: fully qualified topic name.
            type_name: `package/msg/Type`.
            offered_qos: what the publishers offered.
            definition: definition of the type; looked up by default.

        Returns:
            The id with which to write its messages.

        Raises:
            BagError: the name is not absolute or known already, or the type is unknown.
        """
        if not name.startswith("/"):
            raise BagError(f"topic is {name!r}; allowed: a fully qualified name, with '/' in front")
        if any(topic.name == name for topic in self._topics.values()):
            raise BagError(f"topic {name!r} has been added already")
        definition = definition or message_definition(type_name)
        schema_id = self._schema_ids.get(definition.type_name)
        if schema_id is None:
            text = definition.text.encode()
            schema_id = self._writer.register_schema(definition.type_name, SCHEMA_ENCODING, text)
            self._schema_ids[definition.type_name] = schema_id
        topic_id = self._writer.register_channel(
            name,
            MessageEncoding.CDR,
            schema_id,
            {
                "offered_qos_profiles": dump_profiles(offered_qos),
                "topic_type_hash": definition.type_hash,
            },
        )
        self._topics[topic_id] = TopicRecord(
            name, definition.type_name, definition.type_hash, tuple(offered_qos), message_count=0
        )
        self._counts[topic_id] = 0
        return topic_id

    def write(
        self, topic_id: int, data: bytes, log_time_ns: int, publish_time_ns: int | None = None
    ) -> None:
        """Append one message to the chunk in progress.

        Args:
            topic_id: what `add_topic` returned.
            data: serialised message (CDR with its 4-byte header).
            log_time_ns: time of reception; orders the bag and times a replay.
            publish_time_ns: time of publication; the time of reception by default.

        Raises:
            BagError: the file cannot be written (disk full).
        """
        self._counts[topic_id] += 1
        self._start_ns = min(self._start_ns, log_time_ns)
        self._end_ns = max(self._end_ns, log_time_ns)
        try:
            self._writer.add_message(
                topic_id,
                log_time_ns,
                data,
                log_time_ns if publish_time_ns is None else publish_time_ns,
                self._counts[topic_id] & _SEQUENCE_MASK,
            )
        except (OSError, ValueError) as error:
            raise self._failed(error) from None

    def add_information(self, texts: Mapping[str, str]) -> None:
        """Store further texts about the run, or others in the place of those so far.

        Args:
            texts: by name.

        Raises:
            BagError: the file cannot be written (disk full).
        """
        self._custom_data.update(texts)
        try:
            self._writer.add_metadata(RECORD_NAME, dict(texts))
            self._file.flush()
        except (OSError, ValueError) as error:
            raise self._failed(error) from None

    def flush(self) -> None:
        """Finish the chunk in progress, so that a kill of the process no longer loses its messages.

        With compression a chunk stays open until it is full: small ones hardly compress.

        Raises:
            BagError: the file cannot be written (disk full).
        """
        if self._is_compressed:
            return
        try:
            self._writer.flush()
        except (OSError, ValueError) as error:
            raise self._failed(error) from None

    def close(self) -> None:
        """Complete the file and write `metadata.yaml`; a second call is free.

        Raises:
            BagError: the disk does not take it.
        """
        if self._is_closed:
            return
        information = describe_bag(
            self._path.name,
            self._start_ns,
            self._end_ns - self._start_ns if self._start_ns != NO_START_NS else 0,
            [
                replace(topic, message_count=self._counts[key])
                for key, topic in self._topics.items()
            ],
            self._custom_data,
            os.environ.get("ROS_DISTRO", "") or DEFAULT_DISTRO,
        )
        try:
            self._writer.flush()
            texts = {"serialized_metadata": metadata_text(information)}
            self._writer.add_metadata(ROSBAG2_RECORD_NAME, texts)
            self._writer.finish()
            self._file.close()
            write_metadata(self.folder, information)
        except (OSError, ValueError) as error:
            raise self._failed(error) from None
        self._is_closed = True

    def _failed(self, error: Exception) -> BagError:
        """Return the error to raise; nothing more can be written, not even what is buffered."""
        self._file.raw.close()
        return BagError(f"cannot write to {self._path}: {error}")

    def __exit__(self, *error: object) -> None:
        """Close the bag, after an error as well: what was written is sound."""
        self.close()
