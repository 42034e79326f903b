"""Builds dataclasses from plain YAML values, strictly: unknown, missing and ill-typed entries are refused."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from iptm_core.errors import ScenarioError

Built = TypeVar("Built")


def build(cls: type[Built], values: object, origin: str) -> Built:
    """Build a dataclass from a mapping.

    Numbers must be finite; whole numbers are welcome where a float is due; lists become tuples.

    Args:
        cls: a dataclass; its fields are of the types str, float, int, bool, tuples and mappings of
            these, or optional.
        values: what the file says.
        origin: where it was written, for the message.

    Returns:
        The object.

    Raises:
        ScenarioError: an entry is unknown, missing or of the wrong type, or the class refuses it.
    """
    entries = mapping(values, origin)
    hints = get_type_hints(cls)
    known = {entry.name: entry for entry in fields(cls) if entry.init}  # type: ignore[arg-type]
    unknown = [str(key) for key in entries if key not in known]
    if unknown:
        raise ScenarioError(f"{origin}: unknown {', '.join(unknown)}; known: {', '.join(known)}")
    missing = [
        name
        for name, entry in known.items()
        if name not in entries and entry.default is MISSING and entry.default_factory is MISSING
    ]
    if missing:
        raise ScenarioError(f"{origin}: missing {', '.join(missing)}")
    checked = {
        key: converted(value, hints[key], f"{origin}: {key}") for key, value in entries.items()
    }
    try:
        return cls(**checked)
    except ValueError as reason:
        raise ScenarioError(f"{origin}: {reason}") from reason


def mapping(value: object, origin: str) -> dict[str, Any]:
    """Take a value as a mapping with text keys.

    Raises:
        ScenarioError: it is something else.
    """
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise ScenarioError(f"{origin}: a mapping with text keys is needed, got {value!r:.80}")
    return dict(value)


def converted(value: object, wanted: Any, origin: str) -> Any:
    """Check one value against a type.

    Raises:
        ScenarioError: it is of another type.
    """
    kind, inner = get_origin(wanted), get_args(wanted)
    if type(None) in inner:
        if value is None:
            return None
        return converted(value, next(part for part in inner if part is not type(None)), origin)
    if kind is tuple:
        if not isinstance(value, list):
            raise ScenarioError(f"{origin}: a list is needed, got {value!r:.80}")
        return tuple(
            converted(part, inner[0], f"{origin}, entry {index}")
            for index, part in enumerate(value, start=1)
        )
    if kind is not None and issubclass(kind, Mapping):
        return {
            key: converted(part, inner[1], f"{origin}: {key}")
            for key, part in mapping(value, origin).items()
        }
    return _scalar(value, wanted, origin)


def _scalar(value: object, wanted: Any, origin: str) -> object:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if wanted is float and is_number and math.isfinite(float(value)):  # type: ignore[arg-type]
        return float(value)  # type: ignore[arg-type]
    if wanted is int and is_number and isinstance(value, int):
        return value
    if wanted in {str, bool} and isinstance(value, wanted):
        return value
    names = {float: "a finite number", int: "a whole number", str: "a text", bool: "true or false"}
    raise ScenarioError(f"{origin}: {names.get(wanted, str(wanted))} is needed, got {value!r:.80}")
