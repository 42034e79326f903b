"""Text and hash of a message type, as they are stored beside the messages of a bag.

A bag explains itself: every type is stored with its definition, followed by the definitions of all
types it contains. The text comes from the installed message packages, comments included, and from
the type store of rosbags when a package is not installed.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from rosbags.typesys import Stores, TypesysError, get_typestore
from rosbags.typesys.store import Typestore

from iptm_core.errors import BagError

SCHEMA_ENCODING = "ros2msg"
_SEPARATOR = "=" * 80
_TYPE_NAME = re.compile(r"^(?P<package>[a-zA-Z]\w*)/(?:msg/)?(?P<name>[a-zA-Z]\w*)$")
_FIELD_TYPE = re.compile(r"^(?P<type>[a-zA-Z][\w/]*)(?:<=\d+)?(?:\[(?:<=)?\d*\])?\s+[a-zA-Z]")
_PRIMITIVE = re.compile(r"^(bool|byte|char|w?string|float(32|64)|u?int(8|16|32|64))$")


@dataclass(frozen=True)
class MessageDefinition:
    """Definition of a message type.

    Attributes:
        type_name: full name, ``package/msg/Type``.
        text: the definition and those of all nested types, concatenated.
        type_hash: RIHS01 hash, or "" when it is unknown.
    """

    type_name: str
    text: str
    type_hash: str


def message_definition(type_name: str) -> MessageDefinition:
    """Look up the definition of a message type.

    Args:
        type_name: ``package/msg/Type``; ``package/Type`` is understood as well.

    Raises:
        BagError: the name is malformed, or neither an installed package nor rosbags knows the type.
    """
    match = _TYPE_NAME.match(type_name)
    if match is None:
        raise BagError(f"message type {type_name!r} is not of the form package/msg/Type")
    full_name = f"{match['package']}/msg/{match['name']}"
    return _cached_definition(full_name, os.environ.get("AMENT_PREFIX_PATH", ""))


@lru_cache(maxsize=256)
def _cached_definition(type_name: str, prefix_path: str) -> MessageDefinition:
    shares = _share_folders(prefix_path)
    text = _installed_text(type_name, shares)
    store = standard_typestore()
    if text is None:
        try:
            text = store.generate_msgdef(type_name, ros_version=2)[0]
        except TypesysError:
            raise BagError(
                f"message type {type_name!r} is unknown: its package is not installed below"
                f" AMENT_PREFIX_PATH ({prefix_path or 'not set'}) and it is no standard type"
            ) from None
    type_hash = _installed_hash(type_name, shares)
    if not type_hash and type_name in store.fielddefs:
        type_hash = store.hash_rihs01(type_name)
    return MessageDefinition(type_name, text, type_hash)


@lru_cache(maxsize=1)
def standard_typestore() -> Typestore:
    """Return the message types of ROS 2 Jazzy; shared, so never register types in it."""
    return get_typestore(Stores.ROS2_JAZZY)


def _share_folders(prefix_path: str) -> list[Path]:
    prefixes = [Path(entry) for entry in prefix_path.split(os.pathsep) if entry]
    return [prefix / "share" for prefix in (*prefixes, Path(sys.prefix))]


def _find(type_name: str, suffix: str, shares: list[Path]) -> Path | None:
    package, _, name = type_name.split("/")
    for share in shares:
        path = share / package / "msg" / f"{name}{suffix}"
        if path.is_file():
            return path
    return None


def _installed_text(type_name: str, shares: list[Path]) -> str | None:
    """Concatenate the .msg files of a type and of all it contains; None when one is missing."""
    texts: dict[str, str] = {}
    waiting = [type_name]
    while waiting:
        current = waiting.pop(0)
        if current in texts:
            continue
        path = _find(current, ".msg", shares)
        if path is None:
            return None
        texts[current] = path.read_text(encoding="utf-8")
        waiting.extend(nested_types(texts[current], current.split("/")[0]))
    parts = [texts.pop(type_name)]
    for name, text in texts.items():
        package, _, short_name = name.split("/")
        parts.append(f"{_SEPARATOR}\nMSG: {package}/{short_name}\n{text}")
    return "\n".join(part.rstrip("\n") for part in parts) + "\n"


def nested_types(text: str, package: str) -> Iterator[str]:
    """Yield the full names of the message types that the fields of a definition refer to.

    Args:
        text: content of one .msg file.
        package: package of the file, to which bare type names belong.
    """
    for line in text.splitlines():
        match = _FIELD_TYPE.match(line.split("#", maxsplit=1)[0].strip())
        if match is None or _PRIMITIVE.match(match["type"]):
            continue
        *prefix, name = match["type"].split("/")
        yield f"{prefix[0] if prefix else package}/msg/{name}"


def _installed_hash(type_name: str, shares: list[Path]) -> str:
    path = _find(type_name, ".json", shares)
    if path is None:
        return ""
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))["type_hashes"]
        return next((e["hash_string"] for e in entries if e["type_name"] == type_name), "")
    except (ValueError, KeyError, TypeError):
        return ""  # the hash is a courtesy to readers, never worth losing a recording
