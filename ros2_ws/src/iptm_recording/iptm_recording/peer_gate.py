"""When the recorder joins the topics by which the plant counts its peers; free of ROS."""

from __future__ import annotations

from collections.abc import Collection

# Time for the publishers to learn of the subscriptions made last.
SETTLE_S = 0.3
# Time in which the other topics of the suite begin to show up, if there are any.
PATIENCE_ALONE_S = 2.0
# Time in which an incomplete suite grows further, if it does: nodes may start slowly.
PATIENCE_INCOMPLETE_S = 30.0


class PeerGate:
    """Decision when the recorder joins the topics by which the plant counts its peers.

    In lock-step the plant starts once enough peers subscribe to its state and its clock. The
    recorder is one of them, and must not be counted before it receives all topics: else the first
    messages of the controller, or of the plant itself, would be missing from the bag, or the recorder
    would be mistaken for the bridge. It therefore subscribes to these "gate" topics last, when it is
    subscribed to all other topics of the suite. Where no such start is to be expected (the trip is
    running already, or the rest of the suite is not there), it does not wait.

    Args:
        gate_topics: topics held back.
        awaited: topics that must be subscribed first.

    Attributes:
        is_running: set once a message of a trip has arrived.
    """

    def __init__(self, gate_topics: Collection[str], awaited: Collection[str]) -> None:
        self._gate_topics = frozenset(gate_topics)
        self._awaited = frozenset(awaited) - self._gate_topics
        self._seen: frozenset[str] = frozenset()
        self._last_change_s: float | None = None
        self.is_running = False

    def holds(self, topic: str) -> bool:
        """Return whether a topic belongs to the gate."""
        return topic in self._gate_topics

    def is_open(
        self, now_s: float, published: Collection[str], subscribed: Collection[str]
    ) -> bool:
        """Return whether the gate topics may be subscribed to.

        Args:
            now_s: steady time.
            published: topics that have a publisher.
            subscribed: topics the recorder is subscribed to and receives from.
        """
        if self.is_running:
            return True
        seen = frozenset((*published, *subscribed))
        if seen != self._seen:
            self._seen = seen
            self._last_change_s = now_s
        if self._last_change_s is None:
            return False
        unchanged_s = now_s - self._last_change_s
        if self._awaited.issubset(subscribed):
            return unchanged_s >= SETTLE_S
        if self._awaited.isdisjoint(seen):
            return not self._gate_topics.isdisjoint(seen) and unchanged_s >= PATIENCE_ALONE_S
        return unchanged_s >= PATIENCE_INCOMPLETE_S
