"""Listens to a run on the ROS graph without taking part in it.

The page is fed some times a second of wall time, however fast the run is: messages stay bytes, and of a run
that flies by only the newest ones are taken at all.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rclpy.node import Node

from iptm_core.errors import BagError
from iptm_interfaces.topics import TOPICS, Topic
from iptm_interfaces.visual_topics import VISUAL_TOPICS
from iptm_recording.run_information import RunInformation
from iptm_view.bag_source import BagSource
from iptm_view.foxglove_server import FoxgloveServer
from iptm_view.graph_subscriptions import OF_A_TRIP, GraphSubscriptions
from iptm_view.node_questions import NodeQuestions
from iptm_view.page_feed import END, PageFeed
from iptm_view.run_facts import RunFacts, facts_of_information, facts_of_nodes
from iptm_view.run_follower import PAGE_TOPICS, RunFollower

NAME = "view"

_SPECS = {**TOPICS, **VISUAL_TOPICS}
_DEPTH = 16  # more than a slow run publishes between two looks
_LOOK_S = 0.1
_LOOK_WHILE_RUNNING_S = 0.5
_IDLE_S = 3.0
_WAITING = (
    "Listening in ROS domain {domain}, namespace {namespace}. scripts/run_demo drives in a domain of its own"
    " and prints its number: start the view with ROS_DOMAIN_ID=NUMBER scripts/view, or the run with"
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
            self._looked_s = -_LOOK_S  # the gate is open: join at once
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
