"""Readers that are not the suite's: rosbags, mcap with mcap-ros2-support, and ROS itself.

Nothing of the suite is imported here, so that a foreign program can use it, too.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator
from dataclasses import is_dataclass
from functools import lru_cache
from itertools import zip_longest
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

Entry: TypeAlias = tuple[str, str, int, bytes, Any]
"""Topic, type, log time in ns, bytes and content of a message."""

JAZZY = get_typestore(Stores.ROS2_JAZZY)


def with_rosbags(bag: Path) -> Iterator[Entry]:
    """Yield what `AnyReader` reads; it refuses messages with bytes after their end."""
    with AnyReader([bag], default_typestore=JAZZY) as reader:
        for connection, time_ns, data in reader.messages():
            content = fields(reader.deserialize(data, connection.msgtype))
            yield connection.topic, connection.msgtype, time_ns, bytes(data), content


def with_mcap(bag: Path) -> Iterator[Entry]:
    """Yield what mcap and mcap-ros2-support read, checksums included."""
    for path in sorted(bag.glob("*.mcap")):
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            for schema, channel, message, decoded in reader.iter_decoded_messages():
                assert schema is not None
                content = fields(decoded)
                yield channel.topic, schema.name, message.log_time, message.data, content


def with_ros(type_name: str, data: bytes) -> Any:
    """Return the content that rclpy reads; it passes over bytes after the end."""
    package, _, name = type_name.split("/")
    kind = getattr(importlib.import_module(f"{package}.msg"), name)
    return fields(deserialize_message(data, kind))


def content_of(type_name: str, data: bytes) -> Any:
    """Return the content of a message, on which all readers have to agree."""
    content = fields(JAZZY.deserialize_cdr(data, type_name))
    assert fields(_mcap_decoder(type_name)(data)) == content, type_name
    assert with_ros(type_name, data) == content, type_name
    return content


@lru_cache
def _mcap_decoder(type_name: str) -> Any:
    text, _ = JAZZY.generate_msgdef(type_name, ros_version=2)
    return DecoderFactory().decoder_for("cdr", Schema(1, text.encode(), "ros2msg", type_name))


def fields(value: Any) -> Any:
    """Return a message of any library as nested dictionaries, lists, numbers and texts."""
    if isinstance(value, float):
        return "nan" if math.isnan(value) else value
    if isinstance(value, (int, str)):
        return value
    if isinstance(value, bytes) and len(value) == 1:
        return value[0]  # the type `byte`
    if isinstance(value, np.generic):
        return fields(value.item())
    if hasattr(value, "get_fields_and_field_types"):  # of rclpy
        names = list(value.get_fields_and_field_types())
    elif is_dataclass(value):  # of rosbags, with the constants of the type
        names = [name for name in value.__dataclass_fields__ if name == name.lower()]
        names.remove("__msgtype__")
    elif hasattr(value, "__slots__"):  # of mcap-ros2-support
        names = list(value.__slots__)
    else:
        return [fields(entry) for entry in value]
    return {name: fields(getattr(value, name)) for name in names}


def assert_read_by_all(bag: Path) -> dict[str, int]:
    """Check that all read the same messages, equal in every field; return their number by topic."""
    counts: dict[str, int] = {}
    found = (sorted(read(bag), key=lambda entry: entry[:4]) for read in (with_rosbags, with_mcap))
    for one, other in zip_longest(*found):
        assert one is not None
        topic, type_name, _, data, content = one
        assert other == one, topic
        assert with_ros(type_name, data) == content, topic
        counts[topic] = counts.get(topic, 0) + 1
    return counts
