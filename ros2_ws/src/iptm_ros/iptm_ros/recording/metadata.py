"""The `metadata.yaml` of a bag folder, version 9 (ROS 2 Jazzy), written and read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from rosbags.rosbag2.metadata import dump_qos_v9

from iptm_core.errors import BagError
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_ros.recording.recorded_topics import TopicRecord

METADATA_FILE = "metadata.yaml"
METADATA_VERSION = 9
# What rosbag2 writes as the start of a bag without messages.
NO_START_NS = 2**63 - 1
_ROOT_KEY = "rosbag2_bagfile_information"


@dataclass(frozen=True)
class FileRecord:
    """Entry of one MCAP file in the `metadata.yaml` of a bag.

    Attributes:
        name: name inside the folder.
        start_ns: earliest log time; `NO_START_NS` without messages.
        duration_ns: latest minus earliest log time.
        message_count: messages of all topics together.
    """

    name: str
    start_ns: int
    duration_ns: int
    message_count: int

    @property
    def end_ns(self) -> int:
        """Latest log time."""
        return self.start_ns + self.duration_ns


def describe_bag(
    files: Sequence[FileRecord],
    topics: Sequence[TopicRecord],
    custom_data: Mapping[str, str],
    ros_distro: str,
) -> dict[str, Any]:
    """Return the metadata of a bag."""
    start_ns = min(file.start_ns for file in files)
    end_ns = max((file.end_ns for file in files if file.message_count), default=start_ns)
    return {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": end_ns - start_ns},
        "starting_time": {"nanoseconds_since_epoch": start_ns},
        "message_count": sum(file.message_count for file in files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": dump_qos_v9(list(topic.offered_qos)),
                    "type_description_hash": topic.type_hash,
                },
                "message_count": topic.message_count,
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [
            {
                "path": file.name,
                "starting_time": {"nanoseconds_since_epoch": file.start_ns},
                "duration": {"nanoseconds": file.duration_ns},
                "message_count": file.message_count,
            }
            for file in files
        ],
        "custom_data": dict(custom_data),
        "ros_distro": ros_distro,
    }


def write_metadata(folder: Path, information: Mapping[str, Any]) -> None:
    """Write `metadata.yaml` in one step: readers see the whole file or none."""
    temporary = folder / f"{METADATA_FILE}.partial"
    temporary.write_text(metadata_text({_ROOT_KEY: information}), encoding="utf-8")
    temporary.replace(folder / METADATA_FILE)


def read_metadata(folder: Path) -> dict[str, Any]:
    """Return the content below `rosbag2_bagfile_information` of a bag folder, of any version."""
    path = folder / METADATA_FILE
    content = read_yaml(path, BagError)
    if not isinstance(content, dict) or not isinstance(content.get(_ROOT_KEY), dict):
        raise BagError(f"{path} has no entry {_ROOT_KEY!r}: it does not describe a bag")
    information: dict[str, Any] = content[_ROOT_KEY]
    return information


class _Dumper(yaml.SafeDumper):
    """Writer that keeps the line breaks of texts of several lines (the parameters of a run)."""


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = "|" if "\n" in text else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _represent_text)


def metadata_text(content: Mapping[str, Any]) -> str:
    """Return metadata as YAML text, as folder and MCAP file carry it."""
    text: str = yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True)
    return text
