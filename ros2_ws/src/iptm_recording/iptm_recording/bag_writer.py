"""Writes a rosbag2 bag folder: ``<name>/metadata.yaml`` and ``<name>/<name>_0.mcap``.

Every message is in the file when ``write`` returns (see ``mcap_file``); ``metadata.yaml`` appears
when the bag is closed. A bag that was never closed is completed by ``recover``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import final

from iptm_core.errors import BagError
from iptm_recording.definitions import SCHEMA_ENCODING, MessageDefinition, message_definition
from iptm_recording.mcap_chunk import COMPRESSIONS
from iptm_recording.mcap_file import DEFAULT_CHUNK_BYTES, McapFileWriter
from iptm_recording.metadata import NO_START_NS, BagMetadata, TopicRecord, write_metadata
from iptm_recording.qos import RecordedQos, dump_profiles
from iptm_recording.run_information import RECORD_NAME

ROSBAG2_RECORD_NAME = "rosbag2"
DEFAULT_DISTRO = "jazzy"


@dataclass(frozen=True)
class _Topic:
    name: str
    definition: MessageDefinition
    offered_qos: tuple[RecordedQos, ...]


@final
class BagWriter:
    """Writer of one bag folder; use it as a context manager or call ``close``.

    Args:
        folder: bag folder to create; refuses an existing one.
        custom_data: texts about the run, by name.
        ros_distro: distribution named in the metadata; the sourced one by default.
        compression: "" (default), "lz4" or "zstd"; a kill loses a whole chunk with compression.
        chunk_bytes: room of a chunk of the file.

    Raises:
        BagError: the folder exists or cannot be created.
    """

    def __init__(
        self,
        folder: Path,
        *,
        custom_data: Mapping[str, str] | None = None,
        ros_distro: str = "",
        compression: str = "",
        chunk_bytes: int = DEFAULT_CHUNK_BYTES,
    ) -> None:
        self.folder = folder.absolute()
        self._custom_data = dict(custom_data or {})
        self._ros_distro = ros_distro or os.environ.get("ROS_DISTRO", "") or DEFAULT_DISTRO
        self._schema_ids: dict[str, int] = {}
        self._topics: dict[int, _Topic] = {}
        self._metadata: BagMetadata | None = None
        if compression not in COMPRESSIONS:
            raise BagError(f"compression {compression!r} is unknown, must be one of {COMPRESSIONS}")
        self._file_name = f"{self.folder.name}_0.mcap"
        try:
            self.folder.mkdir(parents=True)
            self._file = McapFileWriter(
                self.folder / self._file_name, chunk_bytes=chunk_bytes, compression=compression
            )
            if self._custom_data:
                self._file.add_metadata(RECORD_NAME, self._custom_data)
        except FileExistsError:
            raise BagError(f"{folder} exists already; a bag is never overwritten") from None
        except OSError as error:
            raise BagError(f"cannot create the bag {folder}: {error}") from None

    @property
    def message_counts(self) -> dict[str, int]:
        """Messages written so far, by topic name."""
        counts: dict[str, int] = {}
        for topic_id, topic in self._topics.items():
            counts[topic.name] = counts.get(topic.name, 0) + self._file.message_counts[topic_id]
        return counts

    def add_topic(
        self,
        name: str,
        type_name: str,
        *,
        offered_qos: Sequence[RecordedQos] = (),
        definition: MessageDefinition | None = None,
    ) -> int:
        """Announce a topic.

        Args:
            name: fully qualified topic name.
            type_name: ``package/msg/Type``.
            offered_qos: what the publishers offered.
            definition: definition of the type; looked up by default.

        Returns:
            The id with which to write its messages.

        Raises:
            BagError: the name is not absolute or known already, the type is unknown, or the file
                cannot be written.
        """
        if not name.startswith("/"):
            raise BagError(f"topic {name!r} is not fully qualified: it must start with '/'")
        if any(topic.name == name for topic in self._topics.values()):
            raise BagError(f"topic {name!r} has been added already")
        definition = definition or message_definition(type_name)
        topic = _Topic(name, definition, tuple(offered_qos))
        try:
            topic_id = self._announce(topic)
        except OSError as error:
            raise self._unwritable(error) from None
        self._topics[topic_id] = topic
        return topic_id

    def write(
        self, topic_id: int, data: bytes, log_time_ns: int, publish_time_ns: int | None = None
    ) -> None:
        """Append one message.

        Args:
            topic_id: what ``add_topic`` returned.
            data: serialised message (CDR with its 4-byte header).
            log_time_ns: time of reception; orders the bag and times a replay.
            publish_time_ns: time of publication; the time of reception by default.

        Raises:
            BagError: the file cannot be written (disk full).
        """
        published_ns = log_time_ns if publish_time_ns is None else publish_time_ns
        try:
            self._file.add_message(topic_id, data, log_time_ns, published_ns)
        except OSError as error:
            raise self._unwritable(error) from None

    def close(self) -> BagMetadata:
        """Complete the file, write ``metadata.yaml`` and return its content; a second call is free.

        Raises:
            BagError: the disk does not take it.
        """
        if self._metadata is not None:
            return self._metadata
        start_ns, end_ns = self._file.start_ns, self._file.end_ns
        metadata = BagMetadata(
            file_name=self._file_name,
            start_ns=NO_START_NS if start_ns is None else start_ns,
            duration_ns=0 if start_ns is None or end_ns is None else end_ns - start_ns,
            topics=tuple(
                TopicRecord(
                    name=topic.name,
                    type_name=topic.definition.type_name,
                    type_hash=topic.definition.type_hash,
                    offered_qos=topic.offered_qos,
                    message_count=self._file.message_counts[topic_id],
                )
                for topic_id, topic in self._topics.items()
            ),
            custom_data=self._custom_data,
            ros_distro=self._ros_distro,
        )
        try:
            self._file.add_metadata(
                ROSBAG2_RECORD_NAME, {"serialized_metadata": metadata.to_yaml()}
            )
            self._file.finish()
            write_metadata(self.folder, metadata)
        except OSError as error:
            raise BagError(f"cannot complete the bag {self.folder}: {error}") from None
        self._metadata = metadata
        return metadata

    def _announce(self, topic: _Topic) -> int:
        definition = topic.definition
        schema_id = self._schema_ids.get(definition.type_name)
        if schema_id is None:
            text = definition.text.encode()
            schema_id = self._file.add_schema(definition.type_name, SCHEMA_ENCODING, text)
            self._schema_ids[definition.type_name] = schema_id
        return self._file.add_channel(
            topic.name,
            schema_id,
            {
                "offered_qos_profiles": dump_profiles(topic.offered_qos),
                "topic_type_hash": definition.type_hash,
            },
        )

    def _unwritable(self, error: OSError) -> BagError:
        return BagError(f"cannot write to {self.folder / self._file_name}: {error}")

    def __enter__(self) -> BagWriter:
        """Return the writer itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the bag, after an error as well: what was written is sound."""
        self.close()
