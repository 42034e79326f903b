"""A finished bag as the source of a view, without ROS: the whole trip on the page, to be played there.

Foxglove, which has no player of its own for a live connection, is given the messages when they are due.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

from iptm_core.errors import BagError
from iptm_interfaces.topics import TOPICS, Topic
from iptm_recording.bag_reader import BagReader
from iptm_recording.playback import Playback, PlaybackOptions
from iptm_view.foxglove_server import FoxgloveServer
from iptm_view.page_feed import END, PageFeed
from iptm_view.run_facts import RunFacts, facts_of_information
from iptm_view.run_follower import PAGE_TOPICS, RunFollower

AT_ONCE = 0.0
"""Rate at which a bag is not played: the page shows its end, Foxglove gets all messages at once."""
_LOOK_S = 0.05
_MOST_UNSHOWN = 50
"""Messages after which to show what there is; the follower keeps more ticks than that."""

Wait = Callable[[float], bool]
"""Sleeps for a number of seconds; returns True to stop."""


class BagSource(AbstractContextManager["BagSource"]):
    """A bag as the source of a view; use it as a context manager."""

    def __init__(
        self, bag: Path, rate: float = AT_ONCE, start_s: float = 0.0, namespace: str | None = None
    ) -> None:
        """Open a bag.

        Args:
            bag: bag folder or file.
            rate: playback speed over recorded speed, 0 for none.
            start_s: where playback begins, recorded time since the start of the bag.
            namespace: of the vehicle; needed only if the bag holds several.
        """
        namespace = (namespace or "").strip("/")
        played = PlaybackOptions(bag, rate=1.0 if rate == AT_ONCE else rate, start_s=start_s)
        self._namespace = f"/{namespace}"
        self._rate, self._start_s = rate, start_s
        self._reader = BagReader(bag)
        try:
            self._whole = Playback(self._reader, PlaybackOptions(bag))
            self._played = Playback(self._reader, played)
            self._topics = self._find_topics(namespace)
            facts = facts_of_information(
                f"bag {bag.resolve().name}", self._reader.run_information()
            )
            self.facts: RunFacts = replace(facts, run=bag)
        except BagError:
            self._reader.close()
            raise

    def __exit__(self, *error: object) -> None:
        """Close the bag."""
        self._reader.close()

    def load(self, feed: PageFeed, facts: RunFacts, wait: Wait = lambda _: False) -> None:
        """Put the whole trip into a feed; the page plays it."""
        follower = RunFollower(feed, facts, self._namespace)
        follower.expect(self._topics.values())
        if self._rate != AT_ONCE:
            feed.put("play", {"rate": self._rate, "start_s": self._start_s})
        for number, message in enumerate(self._whole.messages()):
            topic = self._topics.get(message.topic)
            if topic is not None:
                follower.take(topic, message.data)
            if number % _MOST_UNSHOWN == 0:
                follower.show()
                if wait(0.0):
                    return
        follower.show(incomplete=True)
        feed.put(END, {"ended": True})

    def play(self, foxglove: FoxgloveServer, wait: Wait) -> None:
        """Pass all messages on to Foxglove once, each when it is due."""
        latched = {record.name for record in self._played.topics if record.is_latched}
        for record in self._played.topics:
            foxglove.offer(record.name, record.type_name)
        begin_s = time.monotonic()
        for message in self._played.messages():
            due_s = 0.0 if self._rate == AT_ONCE else self._played.due_s(message.log_time_ns)
            while (early_s := begin_s + due_s - time.monotonic()) > 0.0:
                foxglove.serve_latecomers()
                if wait(min(early_s, _LOOK_S)):
                    return
            foxglove.take(message.topic, message.data, is_latched=message.topic in latched)

    def _find_topics(self, namespace: str) -> dict[str, Topic]:
        """Return the page's topics by their names in the bag."""
        found: dict[str, Topic] = {}
        for topic in PAGE_TOPICS:
            spec = TOPICS[topic]
            name = spec.name
            if namespace and not name.startswith("/"):
                name = f"{self._namespace}/{name}"
            try:
                found[self._reader.resolve(name, spec.type_name).name] = topic
            except BagError:
                if topic is Topic.PLANT_ODOMETRY:
                    raise
        return found
