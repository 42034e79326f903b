"""Makes a sound bag of one whose recording was cut short (kill, crash, full disk).

Every complete message is taken over with its times; the source is never changed.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Channel, Message, Metadata, Schema
from mcap.well_known import MessageEncoding

from iptm_core.errors import BagError, IptmError
from iptm_recording.bag_writer import BagWriter
from iptm_recording.message_types import SCHEMA_ENCODING, MessageDefinition
from iptm_recording.metadata import read_metadata
from iptm_recording.recorded_topics import parse_profiles
from iptm_recording.run_information import RECORD_NAME
from iptm_recording.salvage import SalvageReader


@dataclass(frozen=True)
class RecoveryReport:
    """Outcome of a recovery.

    Attributes:
        output: the new bag folder.
        message_counts: recovered messages by topic.
        total_bytes: size of the source files together.
        dropped_bytes: bytes that belong to no complete message or record.
        was_complete: True when nothing was missing in the first place.
        notes: what was damaged, one sentence each.
    """

    output: Path
    message_counts: dict[str, int]
    total_bytes: int
    dropped_bytes: int
    was_complete: bool
    notes: tuple[str, ...]

    @property
    def message_count(self) -> int:
        """Recovered messages of all topics together."""
        return sum(self.message_counts.values())

    def __str__(self) -> str:
        topics = f"{len(self.message_counts)} topics"
        lines = [
            f"{self.message_count} messages on {topics} recovered to {self.output}",
            *(f"  {count:8d}  {topic}" for topic, count in sorted(self.message_counts.items())),
            f"{self.dropped_bytes} of {self.total_bytes} bytes dropped",
            *(f"note: {note}" for note in self.notes),
        ]
        if self.was_complete:
            lines.append("note: the source was complete; its messages were copied")
        return "\n".join(lines)


def recover(source: Path, output: Path | None = None) -> RecoveryReport:
    """Write a sound bag with every complete message of a damaged one.

    Args:
        source: bag folder, with or without `metadata.yaml`, or a single .mcap file.
        output: bag folder to create; by default beside the source, `<name>_recovered`.

    Raises:
        BagError: the source is missing, not MCAP, or holds no complete message; the output exists.
    """
    files = _mcap_files(source)
    folder = source if source.is_dir() else source.parent
    if output is None:
        stem = source.absolute().name if source.is_dir() else source.stem
        output = source.absolute().parent / f"{stem}_recovered"
    readers = [SalvageReader(path) for path in files]
    writer = BagWriter(output, custom_data=_custom_data(folder, files))
    notes = _copy(readers, writer)
    writer.close()
    if not any(writer.message_counts.values()):
        shutil.rmtree(writer.folder)
        raise BagError(f"{source} holds no complete message: there is nothing to recover")
    return RecoveryReport(
        output=output,
        message_counts=writer.message_counts,
        total_bytes=sum(reader.total_bytes for reader in readers),
        dropped_bytes=sum(reader.dropped_bytes for reader in readers),
        was_complete=all(reader.complete for reader in readers),
        notes=(*(note for reader in readers for note in reader.notes), *notes),
    )


def _mcap_files(source: Path) -> list[Path]:
    """Return the MCAP files of a bag folder in recording order, or the file itself."""
    if not source.exists():
        raise BagError(f"{source} does not exist")
    if source.is_file():
        return [source]
    files = sorted(source.glob("*.mcap"), key=_file_number)
    if not files:
        raise BagError(f"{source} holds no .mcap file")
    return files


def _file_number(path: Path) -> tuple[int, str]:
    """Order split files by their number: `run_10.mcap` comes after `run_9.mcap`."""
    number = path.stem.rpartition("_")[2]
    return (int(number) if number.isdecimal() else 0, path.name)


def _custom_data(folder: Path, files: Sequence[Path]) -> dict[str, str]:
    """Return the texts about the run, from the files themselves or else from the metadata."""
    for path in files:
        for record in SalvageReader(path).records():
            if isinstance(record, Metadata) and record.name == RECORD_NAME:
                return dict(record.metadata)
            if isinstance(record, Message):
                break  # the writer puts them before the first message
    try:
        return {str(k): str(v) for k, v in (read_metadata(folder)["custom_data"] or {}).items()}
    except (BagError, KeyError, AttributeError):
        return {}


def _copy(readers: Sequence[SalvageReader], writer: BagWriter) -> list[str]:
    """Write every message with a topic into a new bag; return what could not be taken over."""
    topic_ids: dict[str, int | None] = {}
    orphans = 0
    for reader in readers:
        schemas: dict[int, Schema] = {}
        topics: dict[int, int | None] = {}
        for record in reader.records():
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                if record.topic not in topic_ids:
                    schema = schemas.get(record.schema_id)
                    topic_ids[record.topic] = _announce(writer, record, schema)
                topics[record.id] = topic_ids[record.topic]
            elif isinstance(record, Message):
                topic_id = topics.get(record.channel_id)
                if topic_id is not None:
                    writer.write(topic_id, record.data, record.log_time, record.publish_time)
                elif record.channel_id not in topics:
                    orphans += 1
    skipped = sorted(name for name, topic_id in topic_ids.items() if topic_id is None)
    notes = [f"topic {name}: not a ROS 2 message in CDR" for name in skipped]
    return [*notes, f"{orphans} messages without a topic were left out"] if orphans else notes


def _announce(writer: BagWriter, channel: Channel, schema: Schema | None) -> int | None:
    """Add a topic to the new bag; return its id, or None if it carries no ROS 2 messages."""
    is_ros = schema is not None and schema.encoding == SCHEMA_ENCODING
    if schema is None or not is_ros or channel.message_encoding != MessageEncoding.CDR:
        return None
    return writer.add_topic(
        channel.topic,
        schema.name,
        offered_qos=parse_profiles(channel.metadata.get("offered_qos_profiles", "")),
        definition=MessageDefinition(
            schema.name,
            schema.data.decode(errors="replace"),
            channel.metadata.get("topic_type_hash", ""),
        ),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command `recover_bag`.

    Returns:
        0 on success, 1 when nothing could be recovered.
    """
    parser = argparse.ArgumentParser(
        prog="recover_bag",
        description="Make a sound bag of one whose recording was killed or cut short.",
    )
    parser.add_argument("source", type=Path, help="bag folder or .mcap file; it is not changed")
    parser.add_argument(
        "-o", "--output", type=Path, help="bag folder to create (default: <source>_recovered)"
    )
    options = parser.parse_args(arguments)
    try:
        report = recover(options.source, options.output)
    except IptmError as error:
        print(f"recover_bag: {error}", file=sys.stderr)
        return 1
    print(report)
    return 0


if __name__ == "__main__":
    sys.exit(main())
