"""The ``metadata.yaml`` of a bag folder, version 9 (ROS 2 Jazzy), written and read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from iptm_core.errors import BagError
from iptm_recording.qos import RecordedQos

METADATA_FILE = "metadata.yaml"
METADATA_VERSION = 9
_ROOT_KEY = "rosbag2_bagfile_information"
# What rosbag2 writes as the start of a bag without messages.
NO_START_NS = 2**63 - 1


@dataclass(frozen=True)
class TopicRecord:
    """One recorded topic.

    Attributes:
        name: fully qualified topic name.
        type_name: ``package/msg/Type``.
        type_hash: RIHS01 hash of the type, "" when unknown.
        offered_qos: what the publishers offered.
        message_count: recorded messages.
    """

    name: str
    type_name: str
    type_hash: str
    offered_qos: tuple[RecordedQos, ...]
    message_count: int


@dataclass(frozen=True)
class BagMetadata:
    """Content of ``metadata.yaml`` of a bag with a single MCAP file.

    Attributes:
        file_name: name of the MCAP file inside the folder.
        start_ns: earliest log time; ``NO_START_NS`` without messages.
        duration_ns: latest minus earliest log time.
        topics: recorded topics.
        custom_data: free texts by name (what the run depended on).
        ros_distro: ROS distribution that recorded.
    """

    file_name: str
    start_ns: int
    duration_ns: int
    topics: tuple[TopicRecord, ...]
    custom_data: Mapping[str, str] = field(default_factory=dict)
    ros_distro: str = ""

    @property
    def message_count(self) -> int:
        """Messages of all topics together."""
        return sum(topic.message_count for topic in self.topics)

    def to_mapping(self) -> dict[str, Any]:
        """Return the content below ``rosbag2_bagfile_information``."""
        start = {"nanoseconds_since_epoch": self.start_ns}
        duration = {"nanoseconds": self.duration_ns}
        return {
            "version": METADATA_VERSION,
            "storage_identifier": "mcap",
            "duration": dict(duration),
            "starting_time": dict(start),
            "message_count": self.message_count,
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic.name,
                        "type": topic.type_name,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": [q.to_mapping() for q in topic.offered_qos],
                        "type_description_hash": topic.type_hash,
                    },
                    "message_count": topic.message_count,
                }
                for topic in self.topics
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self.file_name],
            "files": [
                {
                    "path": self.file_name,
                    "starting_time": dict(start),
                    "duration": dict(duration),
                    "message_count": self.message_count,
                }
            ],
            "custom_data": dict(self.custom_data),
            "ros_distro": self.ros_distro,
        }

    def to_yaml(self) -> str:
        """Return the inner mapping as text, as the MCAP file carries it."""
        return _dump(self.to_mapping())


def write_metadata(folder: Path, metadata: BagMetadata) -> Path:
    """Write ``metadata.yaml`` in one step: readers see the whole file or none.

    Returns:
        The path of the file.
    """
    path = folder / METADATA_FILE
    temporary = folder / f"{METADATA_FILE}.partial"
    temporary.write_text(_dump({_ROOT_KEY: metadata.to_mapping()}), encoding="utf-8")
    temporary.replace(path)
    return path


def read_metadata(folder: Path) -> dict[str, Any]:
    """Read the content below ``rosbag2_bagfile_information`` of a bag folder, of any version.

    Raises:
        BagError: the file is missing, unreadable or not the metadata of a bag.
    """
    path = folder / METADATA_FILE
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise BagError(f"cannot read {path}: {error}") from None
    except yaml.YAMLError as error:
        raise BagError(f"{path} is not YAML: {error}") from None
    if not isinstance(content, dict) or not isinstance(content.get(_ROOT_KEY), dict):
        raise BagError(f"{path} has no entry {_ROOT_KEY!r}: it does not describe a bag")
    information: dict[str, Any] = content[_ROOT_KEY]
    return information


class _Dumper(yaml.SafeDumper):
    """Writes texts of several lines (the parameters of a run) as such, so that people can read them."""


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = "|" if "\n" in text else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _represent_text)


def _dump(content: Mapping[str, Any]) -> str:
    text: str = yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True)
    return text
