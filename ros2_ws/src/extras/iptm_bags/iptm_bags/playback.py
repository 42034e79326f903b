"""Playback schedule: the requested part of a bag on its own time axis; free of ROS."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.recorded_topics import QosOverrides, TopicRecord, TopicSelection
from iptm_ros.recording.storage import BagMessage
from iptm_ros.recording.timeline import CLOCK_TOPIC, CLOCK_TYPE

MAX_TIME_S = 1e9
"""Longest time that is waited or skipped (thirty years); a longer one is a mistake."""
LEAST_RATE, MOST_RATE = 1e-6, 1e9
_MOST_CLOCK_HZ = 1e4
_LEAST_DURATION_S = 1e-9


@dataclass(frozen=True)
class PlaybackOptions:
    """What to play, and how.

    Attributes:
        bag: bag folder or file.
        rate: playback speed over recorded speed, positive.
        start_s: offset into the bag at which to begin.
        duration_s: length of the part to play, recorded time; None up to the end.
        selection: topics wanted.
        clock_hz: publish the clock at this rate (of the computer's time) instead of the recorded
            one, under its name; None plays the recorded clock like any other topic.
        wait_for_subscribers: subscriptions, over all topics, to wait for before beginning.
        delay_s: time for subscribers to find the player before it begins.
        is_looping: begin again at the end.
        is_paused: begin paused.
        remap: names under which topics are played, by their names in the bag.
        qos: quality of service requested by the user, by names in the bag.
    """

    bag: Path
    rate: float = 1.0
    start_s: float = 0.0
    duration_s: float | None = None
    selection: TopicSelection = field(default_factory=TopicSelection)
    clock_hz: float | None = None
    wait_for_subscribers: int = 0
    delay_s: float = 1.0
    is_looping: bool = False
    is_paused: bool = False
    remap: Mapping[str, str] = field(default_factory=dict)
    qos: QosOverrides = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check("rate", self.rate, LEAST_RATE, MOST_RATE)
        _check("start", self.start_s, 0.0, MAX_TIME_S, " s")
        if self.duration_s is not None:
            _check("duration", self.duration_s, _LEAST_DURATION_S, MAX_TIME_S, " s")
        if self.clock_hz is not None:
            _check("clock rate", self.clock_hz, LEAST_RATE, _MOST_CLOCK_HZ, " Hz")
        _check("delay", self.delay_s, 0.0, MAX_TIME_S, " s")


class Playback:
    """The part of an opened bag that is to be played.

    Attributes:
        clock_topic: full name of the clock of the bag.
        bag_start_ns: recorded time from which offsets count.
        start_ns: recorded time of the begin of the part.
        end_ns: recorded time of its end.
        topics: the played ones.

    Raises:
        BagError: the bag is empty, a pattern matches no topic, or the part holds no message.
    """

    def __init__(self, reader: BagReader, options: PlaybackOptions) -> None:
        if reader.message_count == 0:
            raise BagError(f"{options.bag} holds no messages: there is nothing to play")
        unused = options.selection.unused(reader.topics)
        unused += [name for name in options.remap if name not in reader.topics]
        if unused:
            raise BagError(
                f"{options.bag} has no topic {', '.join(map(repr, unused))};"
                f" its topics are: {', '.join(sorted(reader.topics))}"
            )
        length_s = reader.duration_s
        if options.start_s > length_s:
            raise BagError(
                f"start is {options.start_s:g} s, but {options.bag} is only {length_s:g} s long"
            )
        self._reader = reader
        self._options = options
        self.bag_start_ns = reader.start_ns
        clocks = [topic.name for topic in reader.topics.values() if topic.type_name == CLOCK_TYPE]
        # With several vehicles the choice of the clock is ambiguous.
        self.clock_topic = clocks[0] if len(clocks) == 1 else CLOCK_TOPIC
        self.start_ns = reader.start_ns + round(options.start_s * 1e9)
        self.end_ns = reader.end_ns
        if options.duration_s is not None:
            self.end_ns = min(self.end_ns, self.start_ns + round(options.duration_s * 1e9))
        if options.is_looping and self.end_ns <= self.start_ns:
            raise BagError(f"the part of {options.bag} is one instant: it cannot be looped")
        self.topics: list[TopicRecord] = [
            topic
            for topic in reader.topics.values()
            if topic.message_count and options.selection.takes(topic.name) and self._is_kept(topic)
        ]
        if not self.topics:
            raise BagError(f"{options.bag} holds no message on the topics asked for")

    @property
    def length_s(self) -> float:
        """Recorded time from begin to end of the part."""
        return (self.end_ns - self.start_ns) * 1e-9

    def due_s(self, log_time_ns: int) -> float:
        """Return how long after the begin something is due, in seconds of the computer's time."""
        return max(0.0, (log_time_ns - self.start_ns) * 1e-9 / self._options.rate)

    def messages(self, from_ns: int | None = None) -> Iterator[BagMessage]:
        """Yield messages in order of their log times.

        Before the first one come the last earlier messages of latched topics: a subscriber that
        joins in the middle of a run has them as well.
        """
        start_ns = self.start_ns if from_ns is None else from_ns
        names = [topic.name for topic in self.topics]
        yield from self._latched_before(start_ns)
        yield from self._reader.raw_messages(names, start_ns, self.end_ns + 1)

    def _latched_before(self, start_ns: int) -> Iterator[BagMessage]:
        latched = [topic.name for topic in self.topics if topic.is_latched]
        if not latched or start_ns <= self._reader.start_ns:
            return
        last: dict[str, BagMessage] = {}
        for message in self._reader.raw_messages(latched, end_ns=start_ns):
            last[message.topic] = message
        yield from last.values()

    def _is_kept(self, topic: TopicRecord) -> bool:
        """Leave out the recorded clock where another one is published."""
        return self._options.clock_hz is None or topic.name != self.clock_topic


def _check(name: str, value: float, least: float, most: float, unit: str = "") -> None:
    if not least <= value <= most:  # NaN is not, either
        raise BagError(f"{name} is {value:g}; allowed: {least:g} to {most:g}{unit}")
