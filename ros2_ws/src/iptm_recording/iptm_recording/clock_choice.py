"""Which clock orders a recording, chosen among those of the graph; free of ROS."""

from __future__ import annotations

from collections.abc import Collection

from iptm_core.errors import BagError
from iptm_recording.recorded_topics import TopicSelection
from iptm_recording.timeline import CLOCK_TOPIC

GRACE_S = 0.5
"""Discovery may find a clock this much later than other topics of its node."""


class ClockChoice:
    """Chooses once: the clock of the recorder's own namespace, or the only one of the graph, or none.

    Another clock is considered when data arrive without one's own: until then, its vehicle may yet start.

    Args:
        own: full name of the clock as the recorder's arguments make it.
        selection: topics wanted; a clock that is excluded is not followed.

    Attributes:
        clock: the clock to follow, None while or because there is none.
        is_final: the choice will not change.
    """

    def __init__(self, own: str, selection: TopicSelection) -> None:
        self.clock: str | None = None
        self.is_final = False
        self._own = own
        self._selection = selection
        self._data_since_s: float | None = None
        self._others_since_s: float | None = None
        self._has_warned = False

    def look(self, now_s: float, clocks: Collection[str], *, has_data: bool) -> str:
        """Consider the graph; call it a few times a second until the choice is final.

        Args:
            now_s: steady time.
            clocks: full names of the published topics of type Clock.
            has_data: messages of a trip have arrived.

        Returns:
            A warning that is new, "" for none.
        """
        if self._own in clocks:
            self._choose(self._own)
            return ""
        others = sorted(name for name in clocks if not self._selection.excludes(name))
        if not has_data:
            return self._remark_others(now_s, others)
        if self._data_since_s is None:
            self._data_since_s = now_s
        if now_s - self._data_since_s < GRACE_S:
            return ""
        self._choose(others[0] if len(others) == 1 else None)
        if self.clock:
            return (
                f"no clock at {self._own}: the bag follows {self.clock}, the only one on the graph"
            )
        if others:
            return (
                f"{len(others)} clocks on the graph ({', '.join(others)}), none of them {self._own}:"
                f" the bag is ordered by time of reception; choose one with --ros-args -r clock:={others[0]}"
            )
        return "no clock on the graph: the bag is ordered by time of reception, as with --time wall"

    def _choose(self, clock: str | None) -> None:
        self.clock = clock
        self.is_final = True

    def _remark_others(self, now_s: float, others: Collection[str]) -> str:
        """Return that only vehicles of other namespaces are there, if no namespace was asked for."""
        if not others or self._own != CLOCK_TOPIC or self._has_warned:
            return ""
        if self._others_since_s is None:
            self._others_since_s = now_s
        if now_s - self._others_since_s < GRACE_S:
            return ""
        self._has_warned = True
        spaces = [name.rpartition("/")[0] or "/" for name in others]
        return (
            f"nothing is published at {self._own}; vehicles are at {', '.join(spaces)}:"
            f" record them with --all, or one with --ros-args -r __ns:={spaces[0]}"
        )


def with_clock(selection: TopicSelection, clock_topic: str) -> TopicSelection:
    """Return the topics wanted with the clock among them.

    Raises:
        BagError: the clock is excluded.
    """
    include = (*selection.include, clock_topic) if selection.include else ()
    wanted = TopicSelection(include, selection.exclude)
    if not wanted.takes(clock_topic):
        raise BagError(
            f"{clock_topic} is excluded, but the times of the bag come from it;"
            " use --time wall to record without it"
        )
    return wanted
