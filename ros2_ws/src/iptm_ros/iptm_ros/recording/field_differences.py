"""Compares two decoded messages field by field."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

_ABSENT = "(absent)"
_NAMED_VALUES = "sensor_msgs/msg/JointState"
_TABLE = "sensor_msgs/msg/PointCloud2"
_FLOAT64 = 8
_CONSTANT_PREFIX = "__"


@dataclass(frozen=True)
class NumberTolerance:
    """How far two numbers may be apart: `absolute + relative * max(abs(a), abs(b))`."""

    absolute: float = 0.0
    relative: float = 0.0

    def accepts(self, first: float, second: float) -> bool:
        """Return whether two numbers agree; NaN agrees with NaN."""
        if first == second or (math.isnan(first) and math.isnan(second)):
            return True
        if not (math.isfinite(first) and math.isfinite(second)):
            return False
        allowed = self.absolute + self.relative * max(abs(first), abs(second))
        return abs(first - second) <= allowed


@dataclass(frozen=True)
class FieldDifference:
    """One field in which two messages differ.

    Attributes:
        path: dotted path of the field; named values by their name, array elements by index.
        first: value in the first message.
        second: value in the second message.
    """

    path: str
    first: object
    second: object

    @property
    def distance(self) -> float:
        """How far apart the values are; infinite where they are not both finite numbers."""
        if isinstance(self.first, (int, float)) and isinstance(self.second, (int, float)):
            distance = abs(self.first - self.second)
            return distance if math.isfinite(distance) else math.inf
        return math.inf


def differences(first: Any, second: Any, tolerance: NumberTolerance) -> list[FieldDifference]:
    """Return the fields in which two messages of the same type differ."""
    left, right = dict(flatten(first)), dict(flatten(second))
    found = []
    for path in dict.fromkeys((*left, *right)):
        a, b = left.get(path, _ABSENT), right.get(path, _ABSENT)
        if isinstance(a, float) and isinstance(b, float):
            if not tolerance.accepts(a, b):
                found.append(FieldDifference(path, a, b))
        elif a != b:
            found.append(FieldDifference(path, a, b))
    return found


def flatten(message: Any, prefix: str = "") -> Iterator[tuple[str, object]]:
    """Yield every scalar of a message with its dotted path.

    Named values (a `JointState` with one position per name) are called by their names, so that
    their order does not matter. The float64 columns of a table (a `PointCloud2`) are `<column>.<row>`.
    """
    if getattr(type(message), "__msgtype__", "") == _TABLE:
        yield from flatten(message.header, f"{prefix}header.")
        yield f"{prefix}rows", int(message.width) * int(message.height)
        for name, column in _columns(message).items():
            yield from ((f"{prefix}{name}.{row}", float(v)) for row, v in enumerate(column))
        return
    if _is_named_values(message):
        yield from flatten(message.header, f"{prefix}header.")
        for name, value in zip(message.name, message.position, strict=True):
            yield f"{prefix}{name}", float(value)
        for rest in ("velocity", "effort"):
            yield from _flatten_value(getattr(message, rest), f"{prefix}{rest}")
        return
    for entry in fields(message):
        if not entry.name.startswith(_CONSTANT_PREFIX):
            yield from _flatten_value(getattr(message, entry.name), f"{prefix}{entry.name}")


def _columns(message: Any) -> dict[str, Any]:
    """Return the float64 fields of a table whose sizes fit, in the order of the fields."""
    step, data = int(message.point_step), np.asarray(message.data, np.uint8).tobytes()
    count = len(data) // step if step else 0
    order = ">" if message.is_bigendian else "<"
    return {
        field.name: np.ndarray((count,), f"{order}f8", data, int(field.offset), (step,))
        for field in message.fields
        if field.datatype == _FLOAT64 and 0 <= field.offset <= step - 8
    }


def _flatten_value(value: Any, path: str) -> Iterator[tuple[str, object]]:
    if is_dataclass(value):
        yield from flatten(value, f"{path}.")
    elif isinstance(value, (list, tuple, np.ndarray)):
        yield f"{path}.length", len(value)
        for index, element in enumerate(value):
            yield from _flatten_value(element, f"{path}.{index}")
    elif isinstance(value, np.generic):
        yield path, value.item()
    else:
        yield path, value


def _is_named_values(message: Any) -> bool:
    return (
        getattr(type(message), "__msgtype__", "") == _NAMED_VALUES
        and len(message.name) > 0
        and len(message.name) == len(message.position)
        and len(set(message.name)) == len(message.name)
    )
