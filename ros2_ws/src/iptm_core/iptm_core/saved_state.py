"""States of a trip in files: dataclasses as JSON, every number back to the last bit.

A file holds what a node needs to go on from a tick as if it had never been stopped, and the settings that
this depends on.
"""

from __future__ import annotations

import json
import os
import types
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from iptm_core.declaration import Scalar
from iptm_core.errors import StateError
from iptm_core.user_input import read_bounded, shown

T = TypeVar("T")
FORMAT = "iptm saved state 1"
_MOST_BYTES = 64 * 2**20
_KEYS = {"format", "kind", "stamp_ns", "settings", "state"}


@dataclass(frozen=True)
class SavedState:
    """What a file holds.

    Attributes:
        stamp_ns: trip time of the state in integer nanoseconds.
        settings: settings that a run must share to continue from it.
        state: the state as plain data; see `from_plain`.
    """

    kind: str
    stamp_ns: int
    settings: Mapping[str, Scalar]
    state: Any


def write_state(path: Path, saved: SavedState) -> None:
    """Write a file, whole or not at all; one of the same name is replaced."""
    text = json.dumps({"format": FORMAT, **vars(saved)}, indent=1)
    draft = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_text(text + "\n", encoding="utf-8")
        draft.replace(path)
    except OSError as error:
        raise StateError(f"state file {path} cannot be written: {error}") from None


def read_state(path: Path, kind: str, settings: Mapping[str, Scalar]) -> SavedState:
    """Read a file; one of another kind, or saved under other settings, is refused."""
    try:
        found = json.loads(read_bounded(path, _MOST_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        raise StateError(f"state file {path} cannot be read: {error}") from None
    if not isinstance(found, dict) or found.get("format") != FORMAT or set(found) != _KEYS:
        raise StateError(
            f"{path} is not a state file; allowed: a file written by a service save_state"
        )
    saved = SavedState(**{key: value for key, value in found.items() if key != "format"})
    if saved.kind != kind:
        raise StateError(
            f"{path} holds the state of {shown(saved.kind)}; allowed: that of {kind!r}"
        )
    if type(saved.stamp_ns) is not int or saved.stamp_ns < 0:
        raise StateError(
            f"{path}: stamp_ns is {shown(saved.stamp_ns)}; allowed: whole numbers from 0"
        )
    known = saved.settings if isinstance(saved.settings, dict) else {}
    for name, value in settings.items():
        if known.get(name) != value:
            raise StateError(
                f"{path} was saved with {name} {shown(known.get(name))}, this node has {shown(value)}; "
                "allowed: the same"
            )
    return saved


def to_plain(value: Any) -> Any:
    """Return a dataclass, or a value inside one, as JSON-compatible data."""
    if is_dataclass(value) and not isinstance(value, type):
        return {entry.name: to_plain(getattr(value, entry.name)) for entry in fields(value)}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple):
        return [to_plain(entry) for entry in value]
    return value


def from_plain(kind: type[T], data: Any) -> T:
    """Return a dataclass from what `to_plain` made of it; a `StateError` refuses other fields or types.

    Args:
        kind: the class, or one whose subclasses are identified by their fields; its fields are dataclasses,
            numbers, texts, enums, arrays or tuples of one type.
    """
    found: T = _convert(kind, data, "state")
    return found


def _convert(kind: Any, data: Any, where: str) -> Any:
    if isinstance(kind, type) and is_dataclass(kind):
        return _dataclass(kind, data, where)
    origin, inside = get_origin(kind), get_args(kind)
    if origin in {Union, types.UnionType}:
        if data is None and type(None) in inside:
            return None
        (kind,) = (each for each in inside if each is not type(None))
        return _convert(kind, data, where)
    if origin is tuple:
        if not isinstance(data, list):
            raise _error(where, data, "a list")
        return tuple(_convert(inside[0], entry, f"{where}[{i}]") for i, entry in enumerate(data))
    if origin is np.ndarray:
        return _array(data, where)
    if isinstance(kind, type) and issubclass(kind, Enum):
        try:
            return kind(data)
        except ValueError:
            raise _error(where, data, ", ".join(str(each.value) for each in kind)) from None
    if type(data) is not kind:
        raise _error(where, data, getattr(kind, "__name__", str(kind)))
    return data


def _dataclass(kind: type[Any], data: Any, where: str) -> Any:
    if not isinstance(data, dict):
        raise _error(where, data, "a mapping")
    for each in (kind, *kind.__subclasses__()):
        names = [entry.name for entry in fields(each)]
        if set(data) == set(names):
            break
    else:
        expected = ", ".join(entry.name for entry in fields(kind))
        raise StateError(f"{where} has the keys {', '.join(map(str, data))}; allowed: {expected}")
    hints = get_type_hints(each)
    return each(**{name: _convert(hints[name], data[name], f"{where}.{name}") for name in names})


def _array(data: Any, where: str) -> Any:
    try:
        return np.array(data, dtype=np.float64)
    except (ValueError, TypeError):
        raise _error(where, data, "numbers in rows of equal length") from None


def _error(where: str, data: object, allowed: str) -> StateError:
    return StateError(f"{where} is {shown(data)}; allowed: {allowed}")
