"""Where the messages of a view come from: a finished bag, or a run on the ROS graph.

Of a bag the whole trip is put on the page, to be played there. Foxglove, which has no player of its own for
a live connection, is given the messages when they are due. From the graph, the page is fed some times a
second of wall time, however fast the run is: of a fast run only the newest messages are taken.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from iptm_bags.playback import Playback, PlaybackOptions
from iptm_core.errors import BagError
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.run_information import RunInformation
from iptm_ros.topics import BRIDGE, CONTROLLER, PLANT, TOPICS, Topic
from iptm_view.foxglove_server import FoxgloveServer
from iptm_view.graph_subscriptions import OF_A_TRIP, GraphSubscriptions
from iptm_view.page_feed import END, PageFeed
from iptm_view.run_facts import RunFacts, asked_names, facts_of_information, facts_of_nodes
from iptm_view.run_follower import PAGE_TOPICS, RunFollower
from iptm_view.visual_topics import VISUAL_TOPICS

AT_ONCE = 0.0
"""Rate at which a bag is not played: the page shows its end, Foxglove gets all messages at once."""
_FOXGLOVE_LOOK_S = 0.05
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
                if wait(min(early_s, _FOXGLOVE_LOOK_S)):
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
                if topic is Topic.PLANT_STATE:
                    raise
        return found


class NodeQuestions:
    """Pending requests for parameters, and the answers so far; never blocks."""

    def __init__(self, node: Node) -> None:
        prefix = node.get_namespace().rstrip("/")
        self._node = Node(
            f"{node.get_name()}_questions",
            namespace=node.get_namespace(),
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = EventsExecutor()
        self._executor.add_node(self._node)
        self._clients = {
            name: AsyncParameterClient(self._node, f"{prefix}/{name}")
            for name in (PLANT, BRIDGE, CONTROLLER)
        }
        self._futures: dict[str, Any] = {}
        self.answers: dict[str, dict[str, Any]] = {}

    def ask(self) -> bool:
        """Ask the nodes that are present and have not answered; return whether an answer has come."""
        self._executor.spin_once(timeout_sec=0.0)
        is_new = False
        for name, client in self._clients.items():
            if name in self.answers:
                continue
            future = self._futures.get(name)
            if future is None:
                if client.services_are_ready():
                    self._futures[name] = client.get_parameters(asked_names(name))
            elif future.done():
                del self._futures[name]
                response = future.result()
                if response is not None:
                    self.answers[name] = _known(asked_names(name), response.values)
                    is_new = True
        return is_new

    def close(self) -> None:
        """Stop asking."""
        self._executor.shutdown()
        self._node.destroy_node()

    def forget(self) -> None:
        """Forget all answers, as other nodes may come."""
        self.answers.clear()
        self._futures.clear()


def _known(names: list[str], values: list[Any]) -> dict[str, Any]:
    """Return the parameters that are set, by name."""
    found = zip(names, map(parameter_value_to_python, values), strict=False)
    return {name: value for name, value in found if value is not None}


NAME = "view"

_SPECS = {**TOPICS, **VISUAL_TOPICS}
_DEPTH = 16  # more than a slow run publishes between two looks
_LOOK_S = 0.1
_LOOK_WHILE_RUNNING_S = 0.5
_IDLE_S = 3.0
_WAITING = (
    "Listening in ROS domain {domain}, namespace {namespace}. scripts/run_demo drives in a domain of its own"
    " and prints its number: start the view with ROS_DOMAIN_ID=NUMBER scripts/iptm view, or the run with"
    " --domain {domain}. scripts/run_demo --view needs neither."
)
# Ticks decoded per second at most: all of a run at a pace to be watched, few of one that is faster.
_TICKS_PER_S = 12.0
_TICKS_AT_ONCE = 3.0


class GraphSource:
    """The graph as the source of a view."""

    def __init__(
        self,
        node: Node,
        feed: PageFeed,
        foxglove: FoxgloveServer | None,
        on_facts: Callable[[RunFacts], RunFacts],
        information: RunInformation | None = None,
        bag: Path | None = None,
        *,
        passes_global: bool = True,
    ) -> None:
        """Set up; topics are joined by `look`.

        Args:
            node: takes part in the graph, in the namespace of the vehicle; see `listening_node`.
            feed: of the page.
            foxglove: server to pass messages on to.
            on_facts: receives what is known of a run; returns what the page shows.
            information: of the run; None to ask its nodes.
            bag: that the run is being recorded in, read when it is complete; None for none.
            passes_global: whether Foxglove is given the topics that all vehicles share, too.
        """
        self._feed = feed
        self._foxglove = foxglove
        self._on_facts = on_facts
        self._graph = GraphSubscriptions(node, _DEPTH, _SPECS)
        domain = node.context.get_domain_id()
        self._about = RunFacts(
            f"ROS graph, domain {domain}, namespace {node.get_namespace()}",
            waiting=_WAITING.format(domain=domain, namespace=node.get_namespace()),
        )
        self._questions = NodeQuestions(node) if information is None else None
        facts = self._about
        if information is not None:
            facts = self._described(facts_of_information(facts.source, information))
        self._follower = RunFollower(feed, on_facts(facts), node.get_namespace())
        self._passed_on = {
            topic: name
            for topic, name in self._graph.names.items()
            if passes_global or not _SPECS[topic].name.startswith("/")
        }
        self._bag, self._namespace = bag, node.get_namespace()
        self._is_running = False
        self._looked_s = self._shown_s = time.monotonic() - _LOOK_S
        self._allowance = _TICKS_AT_ONCE
        self._last_heard_s = time.monotonic()

    def look(self) -> None:
        """Show what has been published, and look for new topics from time to time."""
        for topic, data in self._graph.take():
            self._take(topic, data)
        now_s = time.monotonic()
        is_idle = now_s - self._last_heard_s > _IDLE_S
        refilled = self._allowance + _TICKS_PER_S * (now_s - self._shown_s)
        self._allowance, self._shown_s = min(_TICKS_AT_ONCE, refilled), now_s
        if self._allowance >= 1.0:
            self._allowance -= self._follower.show(int(self._allowance), incomplete=is_idle)
        if now_s - self._looked_s < (_LOOK_WHILE_RUNNING_S if self._is_running else _LOOK_S):
            return
        self._looked_s = now_s
        self._join_and_leave()
        self._read_bag()
        if self._foxglove is not None:
            self._foxglove.serve_latecomers()
        if self._questions is not None and self._graph.joined and self._questions.ask():
            facts = facts_of_nodes(self._about.source, self._questions.answers)
            self._follower.show_facts(self._on_facts(self._described(facts)))

    def _described(self, facts: RunFacts) -> RunFacts:
        return replace(facts, waiting=self._about.waiting)

    def _join_and_leave(self) -> None:
        wanted = self._foxglove.wanted if self._foxglove is not None else ()
        whole = {topic for topic, name in self._passed_on.items() if name in wanted}
        published = self._graph.look(whole.union(PAGE_TOPICS), whole)
        if self._is_running and not self._graph.is_running:
            self._end()
        if self._foxglove is not None:
            for topic in published & self._passed_on.keys():
                self._foxglove.offer(self._passed_on[topic], _SPECS[topic].type_name)
        self._follower.expect(published)

    def _take(self, topic: Topic, data: bytes) -> None:
        if topic in OF_A_TRIP:
            self._last_heard_s = time.monotonic()
        if self._graph.is_running and not self._is_running:
            self._is_running = True
            self._feed.put(END, {"ended": False})
        self._follower.take(topic, data)
        if self._foxglove is not None and topic in self._passed_on:
            self._foxglove.take(self._passed_on[topic], data, is_latched=_SPECS[topic].latched)

    def _read_bag(self) -> None:
        """Show every tick once the bag of the run is complete; of a fast run some were skipped."""
        if self._bag is None or self._is_running or not (self._bag / "metadata.yaml").is_file():
            return
        bag, self._bag = self._bag, None
        try:
            with BagSource(bag, namespace=self._namespace) as source:
                facts = replace(self._follower.facts, source=f"{self._about.source}, {bag.name}")
                source.load(self._feed, facts)
        except BagError as error:
            self._follower.show_facts(self._follower.facts.with_note(str(error)))

    def close(self) -> None:
        """Leave the graph."""
        if self._questions is not None:
            self._questions.close()

    def _end(self) -> None:
        """The plant has left the graph: the trip is over, and the next one has other parameters."""
        self._is_running = False
        self._follower.show(incomplete=True)
        if self._questions is not None:
            self._questions.forget()
        self._feed.put(END, {"ended": True})
