"""Exact comparison of two bags: whether they agree, and where they first diverge.

Messages are matched by their header stamps where a topic has them, else by their number, so that a single
lost message is reported as such and not as a thousand differences. Log times do not count: two runs of the
same scenario are never received at the same instants.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from fnmatch import fnmatchcase
from heapq import merge
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

_Key = tuple[str, int | None, int]
"""Topic, stamp (ns) and number among equal stamps, or of the topic without one."""


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

        def differing_fields(message: BagMessage, other: BagMessage) -> list[FieldDifference]:
            if other.data == message.data:
                return []
            found = differences(one.decode(message), two.decode(other), tolerance)
            return [
                difference
                for difference in found
                if not any(fnmatchcase(difference.path, pattern) for pattern in ignored_fields)
            ]

        return _compared(names, (one, two), differing_fields)


def _compared(
    names: Sequence[str],
    readers: tuple[BagReader, BagReader],
    differing_fields: Callable[[BagMessage, BagMessage], list[FieldDifference]],
) -> list[TopicComparison]:
    """Compare while reading both bags side by side: only messages without a counterpart so far are kept."""
    topics = {name: tuple(reader.topics.get(name) for reader in readers) for name in names}
    types = {name: {each.type_name for each in both if each} for name, both in topics.items()}
    compared = [name for name in names if len(types[name]) == 1]
    found = {name: _Differences() for name in compared}
    waiting: tuple[dict[_Key, tuple[int, BagMessage]], ...] = ({}, {})
    streams = (_keyed(side, reader, compared) for side, reader in enumerate(readers))
    for side, place, key, message in merge(*streams, key=lambda each: each[3].log_time_ns):
        other = waiting[1 - side].pop(key, None)
        if other is None:
            waiting[side][key] = place, message
        elif side:
            found[key[0]].add(other[0], key, differing_fields(other[1], message))
        else:
            found[key[0]].add(place, key, differing_fields(message, other[1]))
    only = [Counter(name for name, *_ in side) for side in waiting]
    outcome = []
    for name, (one, two) in topics.items():
        counts = (one.message_count if one else 0, two.message_count if two else 0)
        if one and two and name not in found:
            remark = f"type {one.type_name} in one, {two.type_name} in the other"
            outcome.append(TopicComparison(name, counts, remark=remark))
            continue
        differing, largest, first = found[name].differing, found[name].largest, found[name].first
        where, fields_ = ("", ()) if first is None else (_place_text(first[1]), tuple(first[2]))
        more = only[0][name], only[1][name], where, fields_, largest
        outcome.append(TopicComparison(name, counts, differing, *more))
    return outcome


@dataclass
class _Differences:
    """Differences of a topic so far; of the earliest pair in the first bag its place, key and fields."""

    differing: int = 0
    largest: dict[str, float] = field(default_factory=dict)
    first: tuple[int, _Key, Sequence[FieldDifference]] | None = None

    def add(self, place: int, key: _Key, fields_: Sequence[FieldDifference]) -> None:
        if not fields_:
            return
        self.differing += 1
        for each in fields_:
            self.largest[each.path] = max(self.largest.get(each.path, 0.0), each.distance)
        if self.first is None or place < self.first[0]:
            self.first = place, key, fields_


def _keyed(
    side: int, reader: BagReader, names: Collection[str]
) -> Iterator[tuple[int, int, _Key, BagMessage]]:
    """Yield messages with their place and the key that matches them with another bag's."""
    kinds = {
        topic.name: stamp_kind(topic.type_name, reader.definition_text(topic.type_name))
        for topic in reader.topics.values()
        if topic.name in names
    }
    increasing = {name: array("q") for name in kinds}
    others: Counter[tuple[str, int | None]] = Counter()
    for place, message in enumerate(reader.raw_messages(list(kinds)) if kinds else ()):
        topic, stamps = message.topic, increasing[message.topic]
        is_stamped = kinds[topic] is not StampKind.NONE
        stamp_ns = read_stamp_ns(message.data) if is_stamped else None
        number = 0  # equal stamps are matched in their order
        if stamp_ns is not None and not (stamps and stamp_ns <= stamps[-1]):
            stamps.append(stamp_ns)
        else:
            at = 0 if stamp_ns is None else bisect_left(stamps, stamp_ns)
            number = others[topic, stamp_ns]
            others[topic, stamp_ns] += 1
            number += stamp_ns is not None and stamps[at] == stamp_ns
        yield side, place, (topic, stamp_ns, number), message


def _place_text(key: _Key) -> str:
    _, stamp_ns, number = key
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
