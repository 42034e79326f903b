"""Writes a rosbag2 bag folder: `<name>/metadata.yaml`, `<name>/<name>_0.mcap`, `<name>/<name>_1.mcap`, ...

A file is completed and the next one begun when it has reached a limit; readers take all as one bag.
`flush` puts every message so far into the file, where a kill of the process does not reach it;
`metadata.yaml` appears when the bag is closed. A bag that was never closed is completed by `recover`.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any, final

from rosbags.interfaces import Qos

from iptm_core.errors import BagError
from iptm_core.user_input import shown
from iptm_ros.recording.mcap_file import COMPRESSIONS, FileLimits, McapFile
from iptm_ros.recording.message_types import MessageDefinition, message_definition
from iptm_ros.recording.recorded_topics import TopicRecord
from iptm_ros.recording.run_information import RECORD_NAME
from iptm_ros.recording.storage import FileRecord, describe_bag, metadata_text, write_metadata

ROSBAG2_RECORD_NAME = "rosbag2"
DEFAULT_DISTRO = "jazzy"
DEFAULT_CHUNK_BYTES = 64 * 1024


@final
class BagWriter(AbstractContextManager["BagWriter"]):
    """Writer of one bag folder; use it as a context manager or call `close`.

    Its methods raise a BagError where the disk does not take what they write.

    Args:
        folder: bag folder to create; refuses an existing one.
        custom_data: texts about the run, by name.
        compression: key of `COMPRESSIONS`; with compression a kill loses a whole chunk.
        chunk_bytes: content after which a chunk of the file is written.
        limits: of one file of the bag.
        in_existing_folder: the folder exists and holds no bag; the caller has created it.

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
        limits: FileLimits | None = None,
        in_existing_folder: bool = False,
    ) -> None:
        self.folder = folder.absolute()
        self._custom_data = dict(custom_data or {})
        self._compression = compression
        self._chunk_bytes = chunk_bytes
        self._limits = limits or FileLimits()
        self._topics: dict[int, TopicRecord] = {}
        self._definitions: dict[int, MessageDefinition] = {}
        self._counts: dict[int, int] = {}
        self._complete: list[FileRecord] = []
        self._is_closed = False
        if compression not in COMPRESSIONS:
            allowed = ", ".join(COMPRESSIONS)
            raise BagError(f"compression is {compression!r}; allowed: {allowed}")
        created = False
        try:
            if not in_existing_folder:
                self.folder.mkdir(parents=True)
                created = True
            self._file = self._next_file()
        except FileExistsError:
            raise BagError(f"{folder} exists already; a bag is never overwritten") from None
        except OSError as error:
            if created:
                shutil.rmtree(self.folder, ignore_errors=True)
            raise BagError(
                f"cannot create the bag {shown(str(folder))}: {error.strerror}"
            ) from None

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
        topic = TopicRecord(
            name, definition.type_name, definition.type_hash, tuple(offered_qos), message_count=0
        )
        topic_id = self._file.add_topic(topic, definition)
        self._topics[topic_id] = topic
        self._definitions[topic_id] = definition
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
        """
        if publish_time_ns is None:
            publish_time_ns = log_time_ns
        self._counts[topic_id] += 1
        try:
            if self._file.is_full(log_time_ns):
                self._complete_file()
                self._file = self._next_file()
            self._file.write(topic_id, data, log_time_ns, publish_time_ns, self._counts[topic_id])
        except (OSError, ValueError) as error:
            raise self._failed(error) from None

    def add_information(self, texts: Mapping[str, str]) -> None:
        """Store further texts about the run, or others in the place of those so far."""
        self._custom_data.update(texts)
        try:
            self._file.add_texts(RECORD_NAME, texts)
        except (OSError, ValueError) as error:
            raise self._failed(error) from None

    def split(self) -> Path:
        """Complete the file in progress and begin the next one.

        Returns:
            The next file.

        Raises:
            BagError: the file in progress holds no message yet, or the disk does not take it.
        """
        if not self._file.counts:
            raise BagError(
                f"{self._file.path.name} holds no message yet; allowed: a split after one"
            )
        try:
            self._complete_file()
            self._file = self._next_file()
        except (OSError, ValueError) as error:
            raise self._failed(error) from None
        return self._file.path

    def flush(self) -> None:
        """Finish the chunk in progress, so that a kill of the process no longer loses its messages."""
        try:
            self._file.flush()
        except (OSError, ValueError) as error:
            raise self._failed(error) from None

    def close(self) -> None:
        """Complete the file and write `metadata.yaml`; a second call is free."""
        if self._is_closed:
            return
        try:
            self._complete_file()
            write_metadata(self.folder, self._description(self._complete, self._counts))
        except (OSError, ValueError) as error:
            raise self._failed(error) from None
        self._is_closed = True

    def _next_file(self) -> McapFile:
        """Begin the next file, which is self-contained: it repeats all topics and the run information."""
        path = self.folder / f"{self.folder.name}_{len(self._complete)}.mcap"
        file = McapFile(path, self._compression, self._chunk_bytes, self._limits)
        if self._custom_data:
            file.add_texts(RECORD_NAME, self._custom_data)
        for topic_id, topic in self._topics.items():
            file.add_topic(topic, self._definitions[topic_id])
        return file

    def _complete_file(self) -> None:
        """Complete the file in progress."""
        record = self._file.record()
        self._file.flush()
        description = self._description([record], self._file.counts)
        texts = {"serialized_metadata": metadata_text(description)}
        self._file.add_texts(ROSBAG2_RECORD_NAME, texts)
        self._file.finish()
        self._complete.append(record)

    def _description(
        self, files: Sequence[FileRecord], counts: Mapping[int, int]
    ) -> dict[str, Any]:
        """Return the metadata of files of the bag with these message counts by topic number."""
        return describe_bag(
            files,
            [
                replace(topic, message_count=counts.get(key, 0))
                for key, topic in self._topics.items()
            ],
            self._custom_data,
            os.environ.get("ROS_DISTRO", "") or DEFAULT_DISTRO,
        )

    def _failed(self, error: Exception) -> BagError:
        """Return the error to raise; nothing more can be written, not even the buffer."""
        self._file.abandon()
        return BagError(f"cannot write to {self._file.path}: {error}")

    def __exit__(self, *error: object) -> None:
        """Close the bag, after an error as well: the written part can be read."""
        self.close()
