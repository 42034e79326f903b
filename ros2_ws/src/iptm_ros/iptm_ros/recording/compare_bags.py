"""Did two runs do the same, and where did they first part?

Messages are matched by their header stamps where a topic has them, else by their number, so that a single
lost message is reported as such and not as a thousand differences. Log times do not count: two runs of the
same scenario are never received at the same instants.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from fnmatch import fnmatchcase
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.recorded_topics import TopicSelection
from iptm_ros.recording.storage import BagMessage
from iptm_ros.recording.timeline import StampKind, read_stamp_ns, stamp_kind

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


# What depends on the machine and not on the run.
DEFAULT_EXCLUDED_TOPICS = ("/diagnostics", "/rosout", "/parameter_events")
DEFAULT_IGNORED_FIELDS = ("solve_time_s", "solve_wall_time_s")
_EXACT = NumberTolerance()
_FIELDS_SHOWN = 8

_Key = tuple[int | None, int]
"""Stamp (ns) of a message and its number among equal stamps, or of the topic without one."""
_Content = dict[str, dict[_Key, BagMessage]]


@dataclass(frozen=True)
class TopicComparison:
    """Outcome for one topic.

    Attributes:
        topic: full name.
        counts: messages in the first and in the second bag.
        differing: pairs of messages that differ.
        only_first: messages without counterpart in the second bag.
        only_second: messages without counterpart in the first bag.
        first_place: stamp ("at 12 s") or number ("message 13") of the earliest pair that differs.
        first_fields: the fields in which that pair differs.
        largest: largest distance of every field that differs anywhere, by path.
        remark: why nothing could be compared ("" when it could).
    """

    topic: str
    counts: tuple[int, int]
    differing: int = 0
    only_first: int = 0
    only_second: int = 0
    first_place: str = ""
    first_fields: tuple[FieldDifference, ...] = ()
    largest: Mapping[str, float] = field(default_factory=dict)
    remark: str = ""

    @property
    def agrees(self) -> bool:
        """True when every message has an equal counterpart."""
        return not (self.differing or self.only_first or self.only_second or self.remark)

    def divergence_text(self) -> str:
        """Return where the runs first differ, and by how much, as lines of text; "" if nowhere."""
        if not self.first_fields:
            return ""
        lines = [f"{self.topic} first differs {self.first_place}:"]
        for difference in self.first_fields[:_FIELDS_SHOWN]:
            worst = self.largest.get(difference.path, 0.0)
            lines.append(
                f"  {difference.path}: {difference.first!r} and {difference.second!r}"
                f" (largest difference anywhere: {worst:.3g})"
            )
        hidden = len(self.first_fields) - _FIELDS_SHOWN
        return "\n".join([*lines, f"  and {hidden} more fields"] if hidden > 0 else lines)


def compare_bags(
    first: Path,
    second: Path,
    *,
    selection: TopicSelection | None = None,
    tolerance: NumberTolerance = _EXACT,
    ignored_fields: Sequence[str] = DEFAULT_IGNORED_FIELDS,
) -> list[TopicComparison]:
    """Compare the messages of two bags, by default bit for bit but for what depends on the machine.

    Args:
        first: bag folder or file, the reference.
        second: bag folder or file.
        selection: topics wanted; by default all but diagnostics and logs.
        tolerance: for floating-point numbers.
        ignored_fields: field paths or patterns (`header.stamp.*`) that may differ.

    Raises:
        BagError: a bag cannot be read, or no topic is left to compare.
    """
    chosen = selection or TopicSelection(exclude=DEFAULT_EXCLUDED_TOPICS)
    with BagReader(first) as one, BagReader(second) as two:
        names = [name for name in sorted({*one.topics, *two.topics}) if chosen.takes(name)]
        if not names:
            raise BagError(f"{first} and {second} have no topic left to compare")
        contents = _messages(one, names), _messages(two, names)

        def differing_fields(message: BagMessage, other: BagMessage) -> list[FieldDifference]:
            if other.data == message.data:
                return []
            found = differences(one.decode(message), two.decode(other), tolerance)
            return [
                difference
                for difference in found
                if not any(fnmatchcase(difference.path, pattern) for pattern in ignored_fields)
            ]

        return [_compare_topic(name, (one, two), contents, differing_fields) for name in names]


def _compare_topic(
    name: str,
    readers: tuple[BagReader, BagReader],
    contents: tuple[_Content, _Content],
    differing_fields: Callable[[BagMessage, BagMessage], list[FieldDifference]],
) -> TopicComparison:
    one, two = (reader.topics.get(name) for reader in readers)
    counts = (one.message_count if one else 0, two.message_count if two else 0)
    if one and two and one.type_name != two.type_name:
        remark = f"type {one.type_name} in one, {two.type_name} in the other"
        return TopicComparison(name, counts, remark=remark)
    first, second = (content.get(name, {}) for content in contents)
    differing = {
        key: found
        for key, message in first.items()
        if key in second and (found := differing_fields(message, second[key]))
    }
    largest: dict[str, float] = {}
    for difference in chain.from_iterable(differing.values()):
        before = largest.get(difference.path, 0.0)
        largest[difference.path] = max(before, difference.distance)
    earliest = next(iter(differing), None)
    return TopicComparison(
        topic=name,
        counts=counts,
        differing=len(differing),
        only_first=len(first.keys() - second.keys()),
        only_second=len(second.keys() - first.keys()),
        first_place="" if earliest is None else _place_text(earliest),
        first_fields=() if earliest is None else tuple(differing[earliest]),
        largest=largest,
    )


def _messages(reader: BagReader, names: Collection[str]) -> _Content:
    """Return the messages by topic, and there by the key that matches them with another bag's."""
    kinds = {
        topic.name: stamp_kind(topic.type_name, reader.definition_text(topic.type_name))
        for topic in reader.topics.values()
        if topic.name in names
    }
    content: _Content = {name: {} for name in kinds}
    numbers: Counter[tuple[str, int | None]] = Counter()
    for message in reader.raw_messages(list(kinds)):
        is_stamped = kinds[message.topic] is not StampKind.NONE
        stamp_ns = read_stamp_ns(message.data) if is_stamped else None
        number = numbers[message.topic, stamp_ns]  # equal stamps are matched in their order
        numbers[message.topic, stamp_ns] += 1
        content[message.topic][stamp_ns, number] = message
    return content


def _place_text(key: _Key) -> str:
    stamp_ns, number = key
    return f"message {number + 1}" if stamp_ns is None else f"at {stamp_ns * 1e-9:g} s"


def comparison_table(comparison: Sequence[TopicComparison]) -> Table:
    """Return the outcome as a table, one row per topic."""
    table = Table("topic", title="comparison", title_justify="left")
    for heading in ("first", "second", "differ", "only first", "only second"):
        table.add_column(heading, justify="right")
    table.add_column("outcome")
    for topic in comparison:
        counts = (*topic.counts, topic.differing, topic.only_first, topic.only_second)
        outcome = "agree" if topic.agrees else topic.remark or "DIFFER"
        table.add_row(topic.topic, *map(str, counts), outcome)
    return table


def print_comparison(comparison: Sequence[TopicComparison], console: Console) -> bool:
    """Print the outcome and where topics differ first; returns whether all of them agree."""
    console.print(comparison_table(comparison))
    for topic in comparison:
        if topic.first_fields:
            console.print(topic.divergence_text(), highlight=False, markup=False)
    return all(topic.agrees for topic in comparison)
