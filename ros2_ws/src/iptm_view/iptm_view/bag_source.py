"""Shows a finished bag as if the run took place now, without ROS: same joining, same page."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

from iptm_core.errors import BagError
from iptm_interfaces.topics import TOPICS, Topic
from iptm_recording.bag_reader import BagReader
from iptm_recording.playback import Playback, PlaybackOptions
from iptm_recording.storage import RawMessage
from iptm_view.foxglove_server import FoxgloveServer
from iptm_view.page_feed import PageFeed
from iptm_view.run_facts import RunFacts, facts_of_information
from iptm_view.run_follower import PAGE_TOPICS, RunFollower

AT_ONCE = 0.0
"""Rate that stands for "everything at once"."""
_LOOK_S = 0.05
_MOST_UNSHOWN = 50
"""Messages after which to show what there is; the follower keeps more ticks than that."""


class BagSource(AbstractContextManager["BagSource"]):
    """A bag as the source of a view; use it as a context manager."""

    def __init__(
        self,
        bag: Path,
        rate: float,
        start_s: float = 0.0,
        duration_s: float | None = None,
        namespace: str | None = None,
    ) -> None:
        """Open a bag.

        Args:
            bag: bag folder or file.
            rate: playback speed over recorded speed, 0 for everything at once.
            start_s: offset into the bag at which to begin.
            duration_s: length of the part to show, recorded time; None up to the end.
            namespace: of the vehicle; needed only if the bag holds several.

        Raises:
            BagError: it cannot be read, holds no run of the suite, or an option is out of range.
        """
        options = PlaybackOptions(
            bag, rate=1.0 if rate == AT_ONCE else rate, start_s=start_s, duration_s=duration_s
        )
        self._is_cut = duration_s is not None
        self._namespace = f"/{(namespace or '').strip('/')}"
        self._rate = rate
        self._reader = BagReader(bag)
        try:
            self._playback = Playback(self._reader, options)
            self._topics = self._find_topics(namespace)
            self.facts: RunFacts = facts_of_information(
                f"bag {bag.resolve().name}", self._reader.run_information()
            )
        except BagError:
            self._reader.close()
            raise

    def __exit__(self, *error: object) -> None:
        """Close the bag."""
        self._reader.close()

    def play(
        self,
        feed: PageFeed,
        facts: RunFacts,
        foxglove: FoxgloveServer | None,
        wait: Callable[[float], bool],
    ) -> None:
        """Play it once into a feed.

        Args:
            feed: of the page.
            facts: what the page shall know of the run.
            foxglove: server to pass all messages on to.
            wait: sleeps for so many seconds; returns True to stop.
        """
        follower = RunFollower(feed, facts, self._namespace)
        follower.expect(self._topics.values())
        latched = {record.name for record in self._playback.topics if record.is_latched}
        if foxglove is not None:
            for record in self._playback.topics:
                foxglove.offer(record.name, record.type_name)

        def rest(seconds: float) -> bool:
            follower.show()
            if foxglove is not None:
                foxglove.serve_latecomers()
            return wait(seconds)

        for message in self._in_time(rest):
            if foxglove is not None:
                foxglove.take(message.topic, message.data, is_latched=message.topic in latched)
            topic = self._topics.get(message.topic)
            if topic is not None:
                follower.take(topic, message.data)
        follower.show(incomplete=True)
        feed.put("end", {"ended": not self._is_cut, "paused": self._is_cut})

    def _in_time(self, rest: Callable[[float], bool]) -> Iterator[RawMessage]:
        """Yield the messages when they are due, until `rest` says to stop.

        Without anything to wait for it rests for no time now and then, so that what was taken is shown.
        """
        begin_s, unshown = time.monotonic(), 0
        for message in self._playback.messages():
            due_s = 0.0 if self._rate == AT_ONCE else self._playback.due_s(message.log_time_ns)
            while (early_s := begin_s + due_s - time.monotonic()) > 0.0:
                unshown = 0
                if rest(min(early_s, _LOOK_S)):
                    return
            unshown += 1
            if unshown % _MOST_UNSHOWN == 0 and rest(0.0):
                return
            yield message

    def _find_topics(self, namespace: str | None) -> dict[str, Topic]:
        """Return the page's topics by their names in the bag.

        Raises:
            BagError: the bag holds no odometry of the plant, or several vehicles.
        """
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
