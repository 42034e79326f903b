"""Message types of a bag: their definitions and hashes, and the decoding of their messages.

A bag explains itself: every type is stored with its definition, followed by the definitions of all
types it contains. Text and hash come from the installed message packages (with the comments, which
hold the units), or from the type store of rosbags when a package is not installed.
"""

from __future__ import annotations

import json
import os
import re
import struct
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from iptm_core.errors import BagError

SCHEMA_ENCODING = "ros2msg"
_SEPARATOR = "=" * 80
_TYPE_NAME = re.compile(r"^(?P<package>[a-zA-Z]\w*)/(?:msg/)?(?P<name>[a-zA-Z]\w*)$")
_ENCAPSULATION_BYTES = 4
_ENCAPSULATIONS = (b"\x00\x00", b"\x00\x01")
MOST_PADDING = 3
_MISFIT = (SerdeError, struct.error, UnicodeDecodeError, ValueError, IndexError)


@dataclass(frozen=True)
class MessageDefinition:
    """Definition of a message type.

    Attributes:
        type_name: full name, `package/msg/Type`.
        text: the definition and the ones of all nested types, concatenated.
        type_hash: RIHS01 hash, or "" when it is unknown.
    """

    type_name: str
    text: str
    type_hash: str


def message_definition(type_name: str) -> MessageDefinition:
    """Return the definition of a message type.

    Args:
        type_name: `package/msg/Type`; `package/Type` is understood as well.

    Raises:
        BagError: the name is malformed, or neither an installed package nor rosbags defines the type.
    """
    match = _TYPE_NAME.match(type_name)
    if match is None:
        raise BagError(f"message type is {type_name!r}; allowed: package/msg/Type")
    full_name = f"{match['package']}/msg/{match['name']}"
    return _cached_definition(full_name, os.environ.get("AMENT_PREFIX_PATH", ""))


@lru_cache(maxsize=256)
def _cached_definition(type_name: str, prefix_path: str) -> MessageDefinition:
    shares = _shares(prefix_path)
    text = _installed_text(type_name, shares)
    store = standard_typestore()
    if not text:
        try:
            text = store.generate_msgdef(type_name, ros_version=2)[0]
        except TypesysError:
            raise BagError(
                f"message type {type_name!r} is unknown: its package is not installed below"
                f" AMENT_PREFIX_PATH ({prefix_path or 'not set'}) and it is not a standard type"
            ) from None
    # rosbags computes another hash than ROS for a few types (std_msgs/msg/Char for one).
    type_hash = _installed_hash(type_name, shares)
    if not type_hash and type_name in store.fielddefs:
        type_hash = store.hash_rihs01(type_name)
    return MessageDefinition(type_name, text, type_hash)


def is_installed(type_name: str) -> bool:
    """Return whether a package below AMENT_PREFIX_PATH, or of this Python, defines a message type."""
    match = _TYPE_NAME.match(type_name)
    shares = _shares(os.environ.get("AMENT_PREFIX_PATH", ""))
    return match is not None and any(
        _find(type_name, suffix, shares) for suffix in (".msg", ".idl")
    )


def known_hashes(type_name: str) -> set[str]:
    """Return the hashes of a type as it is installed here, by ROS and by rosbags; none if it is not known."""
    standard = standard_typestore()
    hashes = {standard.hash_rihs01(type_name)} if type_name in standard.fielddefs else set()
    try:
        hashes.add(message_definition(type_name).type_hash)
    except BagError:
        return hashes
    return hashes - {""}


@lru_cache(maxsize=1)
def standard_typestore() -> Typestore:
    """Return the message types of ROS 2 Jazzy; shared, so never register types in it."""
    return get_typestore(Stores.ROS2_JAZZY)


def _shares(prefix_path: str) -> list[Path]:
    prefixes = [Path(entry) for entry in prefix_path.split(os.pathsep) if entry]
    return [prefix / "share" for prefix in (*prefixes, Path(sys.prefix))]


def _find(type_name: str, suffix: str, shares: list[Path]) -> Path | None:
    package, _, name = type_name.split("/")
    paths = (share / package / "msg" / f"{name}{suffix}" for share in shares)
    return next((path for path in paths if path.is_file()), None)


def _installed_text(type_name: str, shares: list[Path]) -> str:
    """Concatenate the .msg files of a type and of all it contains; "" when one is missing."""
    texts: dict[str, str] = {}
    waiting = [type_name]
    while waiting:
        current = waiting.pop(0)
        if current in texts:
            continue
        path = _find(current, ".msg", shares)
        if path is None:
            return ""
        texts[current] = path.read_text(encoding="utf-8")
        _, fields = get_types_from_msg(texts[current], current)[current]
        waiting.extend(name for _, field in fields for name in _nested_types(field))
    parts = [texts.pop(type_name)]
    for name, text in texts.items():
        parts.append(f"{_SEPARATOR}\nMSG: {name.replace('/msg/', '/')}\n{text}")
    return "\n".join(part.rstrip("\n") for part in parts) + "\n"


def _nested_types(field: FieldDesc) -> Iterator[str]:
    """Yield the name of the message type that a field refers to, if it does."""
    if field[0] is Nodetype.ARRAY or field[0] is Nodetype.SEQUENCE:
        yield from _nested_types(field[1][0])
    elif field[0] is Nodetype.NAME:
        yield field[1]


def _installed_hash(type_name: str, shares: list[Path]) -> str:
    path = _find(type_name, ".json", shares)
    if path is None:
        return ""
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))["type_hashes"]
        return next((e["hash_string"] for e in entries if e["type_name"] == type_name), "")
    except (ValueError, KeyError, TypeError):
        return ""  # the hash is optional; a recording must not fail for it


class Decoder:
    """Decoder of CDR bytes with the definitions that a bag carries.

    A type with the hash of the standard type uses the standard definition; every other
    one is built from the text in the bag, so that bags of other distributions and own types work.
    """

    def __init__(self, definitions: Mapping[str, MessageDefinition]) -> None:
        self._definitions = definitions
        self._stores: dict[str, Typestore] = {}

    def decode(self, data: bytes, type_name: str) -> Any:
        """Return the message.

        Raises:
            BagError: the bytes do not fit the type, or the type is not defined.
        """
        try:
            return self._store(type_name).deserialize_cdr(data, type_name)
        except _MISFIT:
            surplus = len(data) - self.length(data, type_name)
            raise BagError(
                f"{len(data)} bytes are not a {type_name}: {surplus} bytes follow its end;"
                " scripts/iptm recover removes them"
            ) from None

    def length(self, data: bytes, type_name: str) -> int:
        """Return how many of the bytes the message takes, encapsulation included.

        DDS pads every message to a multiple of four bytes, so up to `MOST_PADDING` may follow it.

        Raises:
            BagError: the bytes do not fit the type, or the type is not defined.
        """
        store = self._store(type_name)
        if len(data) < _ENCAPSULATION_BYTES or data[:2] not in _ENCAPSULATIONS:
            raise BagError(f"{len(data)} bytes are not a {type_name}: they are not plain CDR")
        definition = store.get_msgdef(type_name)
        read = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
        try:
            content = memoryview(data)[_ENCAPSULATION_BYTES:]
            end: int = read(content, 0, definition.cls, store)[1]
        except _MISFIT as error:
            raise BagError(f"{len(data)} bytes are not a {type_name}: {error}") from None
        return end + _ENCAPSULATION_BYTES

    def _store(self, type_name: str) -> Typestore:
        store = self._stores.get(type_name)
        if store is None:
            store = self._stores[type_name] = self._store_for(type_name)
        return store

    def _store_for(self, type_name: str) -> Typestore:
        definition = self._definitions.get(type_name)
        text = definition.text if definition else ""
        standard = standard_typestore()
        if type_name in standard.fielddefs and (
            definition is None
            or not text
            or definition.type_hash == standard.hash_rihs01(type_name)
        ):
            return standard
        if not text:
            raise BagError(f"type {type_name} is not standard and the bag does not define it")
        store = get_typestore(Stores.EMPTY)
        try:
            store.register(get_types_from_msg(text, type_name))
            store.get_msgdef(type_name)
        except (TypesysError, KeyError) as error:
            raise BagError(f"definition of {type_name} cannot be understood: {error}") from None
        return store
