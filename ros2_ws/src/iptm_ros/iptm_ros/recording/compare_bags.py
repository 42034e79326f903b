"""Did two runs do the same, and where did they first part?

Messages are matched by their header stamps where a topic has them, else by their number, so that a
single lost message is reported as such and not as a thousand differences. Log times do not count:
two runs of the same scenario are never received at the same instants.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import chain
from pathlib import Path

from rich.console import Console
from rich.table import Table

from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.field_differences import FieldDifference, NumberTolerance, differences
from iptm_ros.recording.recorded_topics import TopicSelection
from iptm_ros.recording.storage import BagMessage
from iptm_ros.recording.timeline import StampKind, read_stamp_ns, stamp_kind

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
