"""Makes a sound bag of one whose recording was cut short (kill, crash, full disk).

Every complete message is copied with its times; the source is never changed, and the report lists
what is missing, as far as the source holds its counts.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from mcap.records import Channel, Message, Metadata, Schema
from mcap.well_known import MessageEncoding

from iptm_bags.salvage import SalvageReader
from iptm_core.errors import BagError
from iptm_core.parameters.strict_yaml import MAX_BYTES
from iptm_core.user_input import shown
from iptm_ros.recording.bag_reader import check_exists
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.message_types import (
    MOST_PADDING,
    SCHEMA_ENCODING,
    Decoder,
    MessageDefinition,
)
from iptm_ros.recording.recorded_topics import parse_profiles
from iptm_ros.recording.run_information import RECORD_NAME
from iptm_ros.recording.storage import METADATA_FILE, read_metadata

_UNKNOWN_TOPIC = "unknown topic"
_MOST_TEXT = MAX_BYTES // 2
"""Characters of all texts about a run: they fit into a `metadata.yaml` that can be read."""


@dataclass(frozen=True)
class RecoveryReport:
    """Outcome of a recovery.

    Attributes:
        output: the new bag folder.
        message_counts: recovered messages by topic.
        lost_counts: messages known to be lost, by topic; of unknown topics, under "unknown topic".
        is_loss_exact: True when the source states how many messages it held; if not, more than
            `lost_counts` may be missing.
        total_bytes: size of the source files together.
        dropped_bytes: bytes that belong to no complete message or record.
        was_complete: True when nothing was missing in the first place.
        notes: what was damaged, one sentence each.
    """

    output: Path
    message_counts: dict[str, int]
    lost_counts: dict[str, int]
    is_loss_exact: bool
    total_bytes: int
    dropped_bytes: int
    was_complete: bool
    notes: tuple[str, ...]

    @property
    def message_count(self) -> int:
        """Recovered messages of all topics together."""
        return sum(self.message_counts.values())

    @property
    def lost_count(self) -> int:
        """Messages of all topics together that are known to be lost."""
        return sum(self.lost_counts.values())

    def __str__(self) -> str:
        topics = f"{len(self.message_counts)} topics"
        lines = [
            f"{self.message_count} messages on {topics} recovered to {self.output}",
            *(f"  {count:8d}  {topic}" for topic, count in sorted(self.message_counts.items())),
            self._loss_text(),
            *(f"  {count:8d}  {topic}" for topic, count in sorted(self.lost_counts.items())),
            f"{self.dropped_bytes} of {self.total_bytes} bytes dropped",
            *(f"note: {note}" for note in self.notes),
        ]
        if self.was_complete:
            lines.append("note: the source was complete; its messages were copied")
        return "\n".join(lines)

    def _loss_text(self) -> str:
        if self.is_loss_exact:
            return f"{self.lost_count} messages lost, by the statistics of the source"
        return (
            f"at least {self.lost_count} messages lost: the source does not state how many it held"
            if self.lost_count or self.dropped_bytes
            else "no message of the source lost; what its recorder had not written yet is unknown"
        )


def recover(source: Path, output: Path | None = None) -> RecoveryReport:
    """Write a sound bag with every complete message of a damaged one.

    Args:
        source: bag folder, with or without `metadata.yaml`, or a single .mcap file.
        output: bag folder to create; by default next to the source, `<name>_recovered`.

    Raises:
        BagError: the source is missing, not MCAP, or holds no complete message; the output exists.
    """
    files = _mcap_files(source)
    folder = source if source.is_dir() else source.parent
    if output is None:
        stem = source.absolute().name if source.is_dir() else source.stem
        output = source.absolute().parent / f"{stem}_recovered"
    contents = [_Contents.of(path) for path in files]
    texts, too_long = _bounded_texts(_custom_data(folder, contents))
    writer = BagWriter(output, custom_data=texts)
    copy = _Copy(writer)
    try:
        for content in contents:
            copy.add(content)
        copy.notes += [*copy.cut_bytes(), *too_long]
        writer.close()
    except BagError:
        shutil.rmtree(writer.folder, ignore_errors=True)  # the next try finds its name free
        raise
    if not any(writer.message_counts.values()):
        shutil.rmtree(writer.folder)
        raise BagError(f"{source} holds no complete message: there is nothing to recover")
    readers = [content.reader for content in contents]
    notes = [str(damage) for reader in readers for damage in reader.damages]
    notes += [note for reader in readers for note in reader.notes]
    lost = dict(+copy.lost)  # without topics of which nothing is missing
    return RecoveryReport(
        output=output,
        message_counts=writer.message_counts,
        lost_counts=lost,
        is_loss_exact=all(reader.statistics is not None for reader in readers),
        total_bytes=sum(reader.total_bytes for reader in readers),
        dropped_bytes=sum(reader.dropped_bytes for reader in readers),
        was_complete=all(reader.complete for reader in readers) and not lost and not copy.notes,
        notes=(*notes, *copy.notes),
    )


def _mcap_files(source: Path) -> list[Path]:
    """Return the MCAP files of a bag folder in recording order, or the file itself."""
    check_exists(source)
    if source.is_file():
        return [source]
    found = (path for path in source.glob("*.mcap") if path.is_file())
    files = sorted(found, key=_file_number)
    if not files:
        raise BagError(f"{source} holds no .mcap file")
    was_closed = (source / METADATA_FILE).exists()
    if len(files) > 1 and not was_closed and files[-1].stat().st_size == 0:
        return files[:-1]  # killed between creating a file and its first byte
    return files


def _file_number(path: Path) -> tuple[int, str]:
    """Order split files by their number: `run_10.mcap` comes after `run_9.mcap`."""
    number = path.stem.rpartition("_")[2]
    return (int(number) if number.isdecimal() else 0, path.name)


@dataclass
class _Contents:
    """Content of a file other than messages.

    Attributes:
        reader: the reader, when it has seen the whole file, with its findings.
        schemas: message definitions by their number.
        channels: topics by their number; sound chunks count for more than the summary.
        texts: about the run, None without any.
    """

    reader: SalvageReader
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    texts: dict[str, str] | None = None

    @cached_property
    def decoder(self) -> Decoder:
        """Decoder with the definitions of the file."""
        return Decoder({schema.name: _definition(schema) for schema in self.schemas.values()})

    @classmethod
    def of(cls, path: Path) -> _Contents:
        """Look through a whole file."""
        content = cls(SalvageReader(path))
        for record in content.reader.records():
            if isinstance(record, Schema):
                content.schemas.setdefault(record.id, record)
            elif isinstance(record, Channel):
                content.channels.setdefault(record.id, record)
            elif isinstance(record, Metadata) and record.name == RECORD_NAME:
                content.texts = {**(content.texts or {}), **record.metadata}
        return content

    def topic_of(self, channel_id: int) -> str:
        """Return the name of a topic as the report shows it."""
        channel = self.channels.get(channel_id)
        return _UNKNOWN_TOPIC if channel is None else channel.topic


def _definition(schema: Schema, type_hash: str = "") -> MessageDefinition:
    text = schema.data.decode(errors="replace") if schema.encoding == SCHEMA_ENCODING else ""
    return MessageDefinition(schema.name, text, type_hash)


def _custom_data(folder: Path, contents: Sequence[_Contents]) -> dict[str, str]:
    """Return the texts about the run, from the files themselves or else from the metadata."""
    if any(content.texts is not None for content in contents):
        return {key: value for c in contents for key, value in (c.texts or {}).items()}
    try:
        return {str(k): str(v) for k, v in (read_metadata(folder)["custom_data"] or {}).items()}
    except (BagError, KeyError, AttributeError):
        return {}


def _bounded_texts(texts: Mapping[str, str]) -> tuple[dict[str, str], list[str]]:
    """Return the texts that `metadata.yaml` of a bag can hold, shortest first, and notes on the others."""
    kept: dict[str, str] = {}
    notes = []
    for key, text in sorted(texts.items(), key=lambda item: len(item[1])):
        if sum(map(len, kept.values())) + len(text) > _MOST_TEXT:
            notes.append(
                f"text {shown(key)} about the run left out: with its {len(text)} characters all texts "
                f"have more than {_MOST_TEXT}"
            )
        else:
            kept[key] = text
    return {key: kept[key] for key in texts if key in kept}, notes


class _Copy:
    """Messages on their way into a new bag, file by file.

    Attributes:
        lost: messages by topic that the sources held and that are not in the new bag.
        notes: topics that could not be taken over as they were.
    """

    def __init__(self, writer: BagWriter) -> None:
        self._writer = writer
        self._topic_ids: dict[str, int | None] = {}
        self._cut: dict[str, tuple[int, int]] = {}
        self.lost: Counter[str] = Counter()
        self.notes: list[str] = []

    def cut_bytes(self) -> list[str]:
        """Return what was removed after the ends of messages, one sentence per topic."""
        return [
            f"topic {topic}: {size} bytes after the ends of {count} messages removed"
            for topic, (count, size) in sorted(self._cut.items())
        ]

    def add(self, content: _Contents) -> None:
        """Write every message with a topic into the new bag, and count those that are missing."""
        topics = {
            number: self._topic_id(channel, content.schemas.get(channel.schema_id))
            for number, channel in content.channels.items()
        }
        taken: Counter[int] = Counter()
        orphans: Counter[int] = Counter()
        for record in SalvageReader(content.reader.path).records():
            if isinstance(record, Message):
                topic_id = topics.get(record.channel_id)
                if topic_id is None:
                    orphans[record.channel_id] += 1
                else:
                    data = self._exact(content, record.channel_id, record.data)
                    self._writer.write(topic_id, data, record.log_time, record.publish_time)
                    taken[record.channel_id] += 1
        if content.reader.statistics is not None:
            missing = Counter(content.reader.statistics.channel_message_counts) - taken
        else:
            missing = orphans
            for damage in content.reader.damages:
                missing += damage.message_counts or Counter()
        for number, count in missing.items():
            self.lost[content.topic_of(number)] += count

    def _exact(self, content: _Contents, channel_id: int, data: bytes) -> bytes:
        """Return a message without the bytes that follow its end; of an unreadable one all bytes."""
        channel = content.channels[channel_id]
        try:
            end = content.decoder.length(data, content.schemas[channel.schema_id].name)
        except BagError:
            return data
        surplus = len(data) - end
        if surplus <= MOST_PADDING:
            return data
        messages, total = self._cut.get(channel.topic, (0, 0))
        self._cut[channel.topic] = messages + 1, total + surplus
        return data[:end]

    def _topic_id(self, channel: Channel, schema: Schema | None) -> int | None:
        """Return the number of a topic in the new bag, None if it cannot be taken over."""
        if channel.topic not in self._topic_ids:
            try:
                self._topic_ids[channel.topic] = self._announce(channel, schema)
            except BagError as error:
                self._topic_ids[channel.topic] = None
                self.notes.append(f"topic {channel.topic} is left out: {error}")
        return self._topic_ids[channel.topic]

    def _announce(self, channel: Channel, schema: Schema | None) -> int:
        """Add a topic to the new bag and return its number."""
        is_ros = schema is not None and schema.encoding == SCHEMA_ENCODING
        if schema is None or not is_ros or channel.message_encoding != MessageEncoding.CDR:
            raise BagError("not a ROS 2 message in CDR")
        try:
            offered_qos = parse_profiles(channel.metadata.get("offered_qos_profiles", ""))
        except BagError as error:
            offered_qos = ()
            self.notes.append(f"topic {channel.topic}: {error}; left empty")
        return self._writer.add_topic(
            channel.topic,
            schema.name,
            offered_qos=offered_qos,
            definition=_definition(schema, channel.metadata.get("topic_type_hash", "")),
        )
