"""From the messages of a run, on the graph or in a bag, to the feed of the page; joined by stamp."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message

from iptm_core.errors import MessageError
from iptm_core.state import NS_PER_S
from iptm_ros.codecs import has_leader, s_from_ns
from iptm_ros.diagnostics import TRIP_TIME, Level, status_values
from iptm_ros.recording.timeline import read_stamp_ns
from iptm_ros.topics import Topic
from iptm_view.page_feed import EVENTS, PLANS, ROWS, PageFeed
from iptm_view.page_row import AHEAD_TOPICS, ROW_TOPICS, page_row, plan_ahead, road_height
from iptm_view.run_facts import RunFacts

JOINED_TOPICS = (*ROW_TOPICS, *AHEAD_TOPICS, Topic.ROAD_AHEAD, Topic.COMMAND)
"""Topics that belong together by their stamps."""

PAGE_TOPICS = (*JOINED_TOPICS, Topic.SLOPE, Topic.DIAGNOSTICS)
"""Topics that the page needs."""

# Not the plan: a fallback has none. The command is the controller's last message in a tick.
_OF_EVERY_TICK = frozenset((*ROW_TOPICS, Topic.LEADER_PREVIEW, Topic.COMMAND))
_STAMPS_KEPT = 64
_STAMPS_WAITING = 16
"""Ticks that wait for missing messages; with more of them the messages will not come."""
_SET_BACK_NS = 10 * NS_PER_S
_LEVELS = {level.value: level.name for level in Level}


class RunFollower:
    """Takes messages as they come and keeps a feed up to date.

    Attributes:
        facts: what is known of the run; set it as soon as it is.
    """

    def __init__(self, feed: PageFeed, facts: RunFacts, namespace: str = "/") -> None:
        """Begin with an empty page.

        Args:
            feed: of the page.
            facts: what is known of the run.
            namespace: of the nodes whose diagnostics count; those in namespaces within it do, too.
        """
        self._prefix = f"{namespace.rstrip('/')}/"
        self._feed = feed
        self._pending: dict[int, dict[Topic, bytes]] = {}
        self._expected = _OF_EVERY_TICK
        self._last_ns = -1
        self._statuses: dict[str, dict[str, Any]] = {}
        self._road: bytes | None = None
        self._faults: dict[str, None] = {}
        self.facts = facts
        feed.begin_trip()
        self.show_facts(facts)

    def expect(self, topics: Iterable[Topic]) -> None:
        """Set the published topics; a tick is complete when it has all of them, or newer ones are."""
        self._expected = _OF_EVERY_TICK.intersection(topics)

    def _is_complete(self, found: Mapping[Topic, bytes]) -> bool:
        missing = self._expected - found.keys()
        road = found.get(Topic.ROAD_AHEAD)
        is_free = road is not None and not has_leader(road)
        return not missing or (is_free and missing == {Topic.LEADER})

    def take(self, topic: Topic, data: bytes) -> None:
        """Take one message, given by its CDR bytes."""
        if topic is Topic.DIAGNOSTICS:
            self._take_diagnostics(deserialize_message(data, DiagnosticArray))
        elif topic is Topic.SLOPE:
            self._road = data
            self._show_road()
        elif topic in JOINED_TOPICS:
            stamp_ns = read_stamp_ns(data)
            if stamp_ns is not None:
                self._join(topic, stamp_ns, data)

    def show(self, most: int | None = None, *, incomplete: bool = False) -> int:
        """Bring the page up to date.

        Args:
            most: largest number of ticks, the newest ones; None for all.
            incomplete: show ticks of which messages are missing, too; for the end of a run.
        """
        stamps = sorted(self._pending)
        # A tick that others have overtaken lacks what will not come, such as a lost command: it counts, too.
        complete = [stamp for stamp in stamps if self._is_complete(self._pending[stamp])]
        given_up = stamps if incomplete else stamps[:-_STAMPS_WAITING]
        overtaken_ns = max([*complete, *given_up], default=-1)
        ready = [
            stamp
            for stamp in stamps
            if Topic.PLANT_STATE in self._pending[stamp] and stamp <= overtaken_ns
        ]
        if not ready:
            return 0
        shown = ready if most is None else ready[-most:]
        for stamp_ns in shown:
            self._show_tick(stamp_ns)
        for stamp in [stamp for stamp in self._pending if stamp <= ready[-1]]:
            del self._pending[stamp]
        self._last_ns = ready[-1]
        return len(shown)

    def show_facts(self, facts: RunFacts) -> None:
        """Replace what is known of the run."""
        self.facts = facts
        self._feed.put("facts", facts.document())

    def _join(self, topic: Topic, stamp_ns: int, data: bytes) -> None:
        if stamp_ns < self._last_ns and (stamp_ns == 0 or self._last_ns - stamp_ns > _SET_BACK_NS):
            # Time has been set back: a new trip, not a late message.
            self._pending.clear()
            self._last_ns = -1
            self._feed.begin_trip()
        if stamp_ns <= self._last_ns:
            return
        self._pending.setdefault(stamp_ns, {})[topic] = data
        if len(self._pending) > _STAMPS_KEPT:
            del self._pending[min(self._pending)]

    def _show_tick(self, stamp_ns: int) -> None:
        messages = self._pending[stamp_ns]
        row, faults = page_row(stamp_ns, messages, self.facts.parameters)
        self._note(faults)
        self._feed.append(ROWS, row)
        try:
            plan = plan_ahead(messages)
        except MessageError as error:
            self._note([str(error)])
        else:
            if plan:
                self._feed.append(PLANS, plan)

    def _show_road(self) -> None:
        if self._road is None:
            return
        try:
            self._feed.put("road", road_height(self._road))
        except MessageError as error:
            self._note([str(error)])

    def _note(self, faults: Iterable[str]) -> None:
        new = [fault for fault in faults if fault not in self._faults]
        if new and len(self._faults) < _STAMPS_KEPT:
            self._faults.update(dict.fromkeys(new))
            self._show_statuses()

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if not status.name.startswith(self._prefix):
                continue
            shown = {
                "name": status.name,
                "level": _LEVELS.get(status.level, "UNKNOWN"),
                "reason": status.message,
                "values": status_values(status),
            }
            before = self._statuses.get(status.name, {})
            heard_s = self._trip_time_s(shown["values"])
            since_s = heard_s - before.get("heard_s", heard_s)
            shown |= {"heard_s": heard_s, "every_s": max(since_s, before.get("every_s", 0.0))}
            self._note_change(shown)
            self._statuses[status.name] = shown
        self._show_statuses()

    def _note_change(self, status: Mapping[str, Any]) -> None:
        """Append an event where a node changes its level or reason during the trip."""
        keys = ("name", "level", "reason")
        known = self._statuses.get(status["name"], {"level": Level.OK.name})
        both_ok = status["level"] == known["level"] == Level.OK.name
        is_news = any(status[key] != known.get(key) for key in keys)
        time_s = self._trip_time_s(status["values"])
        if is_news and not both_ok and time_s > 0.0:
            self._feed.append(EVENTS, {"time_s": time_s, **{key: status[key] for key in keys}})

    def _trip_time_s(self, values: Mapping[str, str]) -> float:
        """Return the trip time of a status; where it names none, the time of the newest row."""
        try:
            return float(values[TRIP_TIME])
        except (KeyError, ValueError):
            return s_from_ns(max(0, self._last_ns))

    def _show_statuses(self) -> None:
        self._feed.put(
            "statuses",
            {"statuses": list(self._statuses.values()), "faults": list(self._faults)},
        )
