"""Compares two bags topic by topic: did two runs do the same, and where did they first part?

Messages are matched by their header stamps where a topic has them, else by their number, so that a
single lost message is reported as such and not as a thousand differences. Log times do not count:
two runs of the same scenario are never received at the same instants.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

from iptm_core.errors import BagError
from iptm_recording.bag_reader import BagReader, RawMessage
from iptm_recording.field_differences import FieldDifference, NumberTolerance, differences
from iptm_recording.recorded_topics import TopicSelection
from iptm_recording.timeline import StampKind, read_stamp_ns, stamp_kind

# What depends on the machine and not on the run.
DEFAULT_EXCLUDED_TOPICS = ("/diagnostics", "/rosout", "/parameter_events")
DEFAULT_IGNORED_FIELDS = ("solve_time_s",)


_Content = dict[str, dict[Hashable, RawMessage]]


@dataclass(frozen=True)
class CompareOptions:
    """What to compare, and how strictly.

    Attributes:
        selection: topics wanted.
        tolerance: for floating-point numbers.
        ignored_fields: field paths or patterns (`header.stamp.*`) that may differ.
    """

    selection: TopicSelection = field(
        default_factory=lambda: TopicSelection(exclude=DEFAULT_EXCLUDED_TOPICS)
    )
    tolerance: NumberTolerance = field(default_factory=NumberTolerance)
    ignored_fields: tuple[str, ...] = DEFAULT_IGNORED_FIELDS


@dataclass(frozen=True)
class Divergence:
    """Where two runs first differ on a topic.

    Attributes:
        where: stamp ("at 12 s") or number ("message 13") of the message.
        fields: the fields that differ.
    """

    where: str
    fields: tuple[FieldDifference, ...]


@dataclass(frozen=True)
class TopicComparison:
    """Outcome for one topic.

    Attributes:
        topic: full name.
        first_count: messages in the first bag.
        second_count: messages in the second bag.
        differing: pairs of messages that differ.
        only_first: messages without counterpart in the second bag.
        only_second: messages without counterpart in the first bag.
        first_divergence: the earliest pair that differs.
        largest: largest distance of every field that differs anywhere, by path.
        remark: why nothing could be compared ("" when it could).
    """

    topic: str
    first_count: int
    second_count: int
    differing: int = 0
    only_first: int = 0
    only_second: int = 0
    first_divergence: Divergence | None = None
    largest: Mapping[str, float] = field(default_factory=dict)
    remark: str = ""

    @property
    def agrees(self) -> bool:
        """True when every message has an equal counterpart."""
        return not (self.differing or self.only_first or self.only_second or self.remark)


@dataclass(frozen=True)
class BagComparison:
    """Outcome for two bags: one entry per topic that either of them holds."""

    first: Path
    second: Path
    topics: tuple[TopicComparison, ...]

    @property
    def agrees(self) -> bool:
        """True when all topics agree."""
        return all(topic.agrees for topic in self.topics)


def compare_bags(first: Path, second: Path, options: CompareOptions | None = None) -> BagComparison:
    """Compare the messages of two bags.

    Args:
        first: bag folder or .mcap file, the reference.
        second: bag folder or .mcap file.
        options: what to compare, and how strictly; bit for bit by default, without what depends on
            the machine (diagnostics, logs, solve times).

    Raises:
        BagError: a bag cannot be read, or no topic is left to compare.
    """
    options = options or CompareOptions()
    with BagReader(first) as one, BagReader(second) as two:
        names = [n for n in sorted({*one.topics, *two.topics}) if options.selection.takes(n)]
        if not names:
            raise BagError(f"{first} and {second} have no topic left to compare")
        contents = _messages(one, names), _messages(two, names)
        topics = tuple(_compare_topic(name, one, two, contents, options) for name in names)
    return BagComparison(first, second, topics)


def _compare_topic(
    name: str,
    one: BagReader,
    two: BagReader,
    contents: tuple[_Content, _Content],
    options: CompareOptions,
) -> TopicComparison:
    topics = [reader.topics.get(name) for reader in (one, two)]
    counts = [topic.message_count if topic else 0 for topic in topics]
    types = [topic.type_name for topic in topics if topic]
    if len(types) == 2 and types[0] != types[1]:
        remark = f"type {types[0]} in one, {types[1]} in the other"
        return TopicComparison(name, counts[0], counts[1], remark=remark)
    first, second = (content.get(name, {}) for content in contents)
    differing = 0
    earliest: Divergence | None = None
    largest: dict[str, float] = {}
    for key, message in first.items():
        other = second.get(key)
        if other is None or other.data == message.data:
            continue
        found = [
            difference
            for difference in differences(one.decode(message), two.decode(other), options.tolerance)
            if not any(fnmatchcase(difference.path, p) for p in options.ignored_fields)
        ]
        if not found:
            continue
        differing += 1
        earliest = earliest or Divergence(_describe(key), tuple(found))
        for difference in found:
            before = largest.get(difference.path, 0.0)
            largest[difference.path] = max(before, difference.distance)
    return TopicComparison(
        topic=name,
        first_count=counts[0],
        second_count=counts[1],
        differing=differing,
        only_first=len(first.keys() - second.keys()),
        only_second=len(second.keys() - first.keys()),
        first_divergence=earliest,
        largest=largest,
    )


def _messages(reader: BagReader, names: Collection[str]) -> _Content:
    """Return the messages by topic, and there by the key that matches them with another bag's."""
    kinds = {
        topic.name: stamp_kind(topic.name, topic.type_name, reader.definition_text(topic.type_name))
        for topic in reader.topics.values()
        if topic.name in names
    }
    content: _Content = {name: {} for name in kinds}
    for message in reader.raw_messages(list(kinds)):
        found = content[message.topic]
        stamp_ns = None
        if kinds[message.topic] is not StampKind.NONE:
            stamp_ns = read_stamp_ns(message.data)
        key: Hashable = ("message", len(found)) if stamp_ns is None else ("stamp", stamp_ns)
        repetition = 0
        while key in found:  # several messages of one stamp are matched in their order
            repetition += 1
            key = ("stamp", stamp_ns, repetition)
        found[key] = message
    return content


def _describe(key: Hashable) -> str:
    if isinstance(key, tuple) and key[0] == "stamp":
        return f"at {key[1] * 1e-9:g} s"
    return f"message {key[1] + 1}" if isinstance(key, tuple) else str(key)
