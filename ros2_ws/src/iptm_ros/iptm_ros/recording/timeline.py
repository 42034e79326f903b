"""Gives every recorded message its two times.

A bag of a simulated run must play back, plot and join in simulated time, whatever the speed of the
machine that recorded it. The log time of a message is therefore the recorder's node time, taken from
the latest `/clock`. Within a tick the plant publishes its state before the clock that announces
it; so that this state is not logged one tick early, a header stamp that is a little ahead of the
clock moves the time on. Log times never decrease unless the clock itself is set back. A clock of 0
begins another trip, whose times follow the trip before: the bag stays in order.

The publication time is the header stamp where a message has a plausible one, else the log time.
"""

from __future__ import annotations

import re
import struct
import time
from collections.abc import Iterable
from enum import Enum

from iptm_core.errors import BagError
from iptm_core.state import NS_PER_S
from iptm_ros.recording.recorded_topics import TopicSelection


def with_clock(selection: TopicSelection, clock_topic: str) -> TopicSelection:
    """Return the topics wanted with the clock among them."""
    include = (*selection.include, clock_topic) if selection.include else ()
    wanted = TopicSelection(include, selection.exclude)
    if not wanted.takes(clock_topic):
        raise BagError(
            f"{clock_topic} is excluded, but the times of the bag come from it;"
            " use --time wall to record without it"
        )
    return wanted


CLOCK_TOPIC = "/clock"
"""Name of the clock outside of any namespace, before remapping."""
CLOCK_TYPE = "rosgraph_msgs/msg/Clock"
# Stamps further ahead of the clock than this come from another clock (wall time, another run).
MAX_LEAD_NS = 10 * NS_PER_S

_HEADER_FIELD = re.compile(r"^\s*std_msgs/(?:msg/)?Header\s+\w+")
_LITTLE_ENDIAN = struct.Struct("<4xiI")
_BIG_ENDIAN = struct.Struct(">4xiI")
_BIG_ENDIAN_MARK = 0


class StampKind(Enum):
    """Where the first eight bytes of a message's content put it in time."""

    CLOCK = "the message is the clock"
    HEADER = "the message starts with a stamped header"
    NONE = "the message carries no time of its own"


class TimeSource(Enum):
    """Which time orders the bag."""

    SIMULATED = "sim"
    WALL = "wall"


def stamp_kind(type_name: str, definition: str) -> StampKind:
    """Return how the messages of a type are stamped."""
    if type_name == CLOCK_TYPE:
        return StampKind.CLOCK
    for line in definition.splitlines():
        content = line.split("#", maxsplit=1)[0].strip()
        if content and "=" not in content:
            return StampKind.HEADER if _HEADER_FIELD.match(content) else StampKind.NONE
    return StampKind.NONE


def read_stamp_ns(data: bytes) -> int | None:
    """Return the time at the start of a CDR message, None when there is none or it is negative."""
    if len(data) < _LITTLE_ENDIAN.size:
        return None
    layout = _BIG_ENDIAN if data[1] == _BIG_ENDIAN_MARK else _LITTLE_ENDIAN
    seconds, nanoseconds = layout.unpack_from(data)
    stamp_ns: int = seconds * NS_PER_S + nanoseconds
    return stamp_ns if stamp_ns >= 0 else None


class Timeline:
    """Current time of the recorder.

    Args:
        source: simulated time from `/clock`, or wall time; set it to give up waiting for a clock.
    """

    def __init__(self, source: TimeSource) -> None:
        self.source = source
        self._now_ns: int | None = None
        self._clock_ns = 0
        self._trip_began_ns = 0
        self._trip_before_ns: tuple[int, int] | None = None

    @property
    def now_ns(self) -> int | None:
        """Current time; None in simulated time before the first clock."""
        return time.time_ns() if self.source is TimeSource.WALL else self._now_ns

    def begin_with(self, stamps_ns: Iterable[int]) -> None:
        """Set the time back to where messages that came before the first clock begin.

        Should the very first clock have been missed, they are a tick older than the one that came.

        Args:
            stamps_ns: header stamps of these messages, in any order; stamps of other clocks are
                passed over.
        """
        if self.source is TimeSource.SIMULATED and self._now_ns is not None:
            now_ns = self._now_ns
            plausible = [ns for ns in stamps_ns if now_ns - MAX_LEAD_NS <= ns <= now_ns]
            self._now_ns = min(plausible, default=now_ns)

    def times_ns(self, data: bytes, kind: StampKind) -> tuple[int, int] | None:
        """Return log time and publication time of a message that has just been received.

        Args:
            data: CDR bytes.
            kind: result of `stamp_kind` for its topic.

        Returns:
            Both times in nanoseconds; None when simulated time has not begun: ask again later.
        """
        stamp_ns = None if kind is StampKind.NONE else read_stamp_ns(data)
        if self.source is TimeSource.WALL:
            return self._wall_times_ns(stamp_ns)
        if kind is StampKind.CLOCK:
            if stamp_ns is not None:
                self._follow_clock(stamp_ns)
        elif stamp_ns is not None and self._now_ns is not None:
            lead_ns = self._trip_began_ns + stamp_ns - self._now_ns
            self._now_ns += lead_ns if 0 < lead_ns <= MAX_LEAD_NS else 0
        if self._now_ns is None:
            return None
        if stamp_ns is None:
            return self._now_ns, self._now_ns
        published_ns = self._trip_began_ns + stamp_ns
        return self._now_ns, min(published_ns, self._now_ns)

    def _follow_clock(self, clock_ns: int) -> None:
        """Take a clock over; a trip of nothing but its beginning is none if the one before goes on."""
        before = self._trip_before_ns
        if clock_ns == 0 and self._clock_ns > 0 and self._now_ns is not None:
            self._trip_before_ns = (self._trip_began_ns, self._clock_ns)
            self._trip_began_ns = self._now_ns
        elif before is not None and self._clock_ns == 0:
            began_ns, last_ns = before
            if clock_ns > MAX_LEAD_NS and last_ns <= clock_ns <= last_ns + MAX_LEAD_NS:
                self._trip_began_ns = began_ns
        self._clock_ns = clock_ns
        self._now_ns = self._trip_began_ns + clock_ns

    @staticmethod
    def _wall_times_ns(stamp_ns: int | None) -> tuple[int, int]:
        now_ns = time.time_ns()
        # A stamp of simulated time has no meaning on the wall clock.
        is_wall = stamp_ns is not None and abs(stamp_ns - now_ns) <= MAX_LEAD_NS
        return now_ns, stamp_ns if is_wall and stamp_ns is not None else now_ns
