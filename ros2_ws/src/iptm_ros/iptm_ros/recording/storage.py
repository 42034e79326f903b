"""Storage of a bag: `metadata.yaml` (version 9, ROS 2 Jazzy), messages, damage, and bounds on unpacking.

A few kilobytes of a packed chunk can stand for gigabytes. A chunk is held in memory, so its size is bounded.
All chunks together may be `LARGEST_RATIO` times as large as the file that they are in, which no recording of
a vehicle comes near.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml
from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]
from mcap.exceptions import McapError
from rosbags.rosbag2.metadata import dump_qos_v9
from zstandard import CONTENTSIZE_UNKNOWN, ZstdError, get_frame_parameters

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


_SafeDumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # five times as fast


class _Dumper(_SafeDumper):
    """Writer that keeps the line breaks of texts of several lines (the parameters of a run)."""


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = "|" if "\n" in text else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _represent_text)


def metadata_text(content: Mapping[str, Any]) -> str:
    """Return metadata as YAML text, as folder and MCAP file carry it."""
    text: str = yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True)
    return text


DAMAGE: Final = (
    McapError,
    ZstdError,
    RuntimeError,  # what lz4 reports, and deep recursion
    ValueError,  # a checksum, or a text that is not UTF-8
    ArithmeticError,
    LookupError,
    EOFError,
    MemoryError,  # a damaged length asks for more than there is
    OSError,
    StopIteration,
    struct.error,
)
"""What mcap, lz4, zstandard and the operating system raise on damaged files."""


@dataclass(frozen=True)
class BagMessage:
    """One message of a bag.

    Attributes:
        topic: fully qualified topic name.
        type_name: `package/msg/Type`.
        log_time_ns: time of reception.
        publish_time_ns: time of publication.
        data: CDR bytes, header included.
        message: it decoded, with the fields of its type, arrays as NumPy arrays; None unless asked for.
    """

    topic: str
    type_name: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes
    message: Any = None


MOST_PART_BYTES = 32 * 2**20
LARGEST_RATIO = 200
MOST_TEXT_BYTES = 2 * 2**20
"""Of a record of texts: those about a run that are larger cannot be read as YAML anyway."""
SMALL_BYTES = 64 * 2**20
"""All parts together may have this size however small their file is."""
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""Start of data packed with zstd; no CDR message begins so."""
FRAME_HEAD_BYTES = 18
"""Longest head of a frame of zstd, which states the size of its content."""
_LARGEST_LZ4_RATIO = 255


class UnpackingBudget:
    """What the parts of a file may still unpack to.

    Args:
        packed_bytes: size of the file.
    """

    def __init__(self, packed_bytes: int) -> None:
        self._most = max(SMALL_BYTES, LARGEST_RATIO * packed_bytes)
        self._taken = 0

    def take(self, size: int) -> None:
        """Count bytes; a ValueError if all so far are too many."""
        self._taken += size
        if self._taken > self._most:
            raise ValueError(f"it unpacks to more than {self._most} bytes; at most these are read")


def check_part(size: int) -> None:
    """Raise a ValueError for a part that is too large to be held in memory."""
    if size > MOST_PART_BYTES:
        raise ValueError(f"a part unpacks to {size} bytes; at most {MOST_PART_BYTES} are read")


def check_chunk(compression: str, stated_bytes: int, data: bytes) -> None:
    """Raise a ValueError for a chunk of MCAP that states, or holds, too much.

    Args:
        data: its packed content; of zstd the first `FRAME_HEAD_BYTES` are enough.
    """
    check_part(stated_bytes)
    if compression == "zstd":
        _check_frame(data)
    elif compression == "lz4" and len(data) * _LARGEST_LZ4_RATIO > MOST_PART_BYTES:
        lz4_part(data)


def lz4_part(data: bytes) -> bytes:
    """Return what a part packed with lz4 holds; a ValueError if that is too much."""
    unpacking = LZ4FrameDecompressor()
    plain: bytes = unpacking.decompress(data, max_length=MOST_PART_BYTES + 1)
    check_part(len(plain))
    if not unpacking.eof:
        raise ValueError("its compressed content has no end")
    return plain


def _check_frame(data: bytes) -> None:
    """Check the size that a zstd frame states; one that states none is limited by its reader."""
    try:
        size = get_frame_parameters(data).content_size
    except ZstdError:
        return  # damage is for the reader to report
    if size != CONTENTSIZE_UNKNOWN:
        check_part(size)
