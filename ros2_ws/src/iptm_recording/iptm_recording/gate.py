"""Decides when the recorder joins the topics by which the plant counts its peers; free of ROS.

In lock-step the plant starts once enough peers subscribe to its state and its clock. The recorder is
one of them, and must not be counted before it can hear everybody: else the first messages of the
controller, or of the plant itself, would be missing from the bag, or the recorder would be taken
for the bridge. It therefore subscribes to these "gate" topics last, when it is subscribed to all
other topics of the suite. Where no such start is to be expected (the trip is running already, or
the rest of the suite is not there), it does not wait.
"""

from __future__ import annotations

from collections.abc import Collection

# Time for the publishers to learn of the subscriptions made last.
SETTLE_S = 0.1
# Time in which the other topics of the suite show up, if there are any.
PATIENCE_S = 2.0


class Gate:
    """Opens once.

    Args:
        gate_topics: topics held back.
        awaited: topics that must be subscribed first.
    """

    def __init__(self, gate_topics: Collection[str], awaited: Collection[str]) -> None:
        self._gate_topics = frozenset(gate_topics)
        self._awaited = frozenset(awaited) - self._gate_topics
        self._first_seen_s: float | None = None
        self._complete_s: float | None = None
        self._is_running = False

    def holds(self, topic: str) -> bool:
        """Tell whether a topic belongs to the gate."""
        return topic in self._gate_topics

    def message_arrived(self) -> None:
        """Note that the trip runs already."""
        self._is_running = True

    def is_open(
        self, now_s: float, published: Collection[str], subscribed: Collection[str]
    ) -> bool:
        """Tell whether the gate topics may be subscribed to.

        Args:
            now_s: steady time.
            published: topics that have a publisher.
            subscribed: topics the recorder is subscribed to.
        """
        if self._is_running:
            return True
        if self._first_seen_s is None and self._gate_topics.intersection(published):
            self._first_seen_s = now_s
        if self._awaited.issubset(subscribed):
            if self._complete_s is None:
                self._complete_s = now_s
            return now_s - self._complete_s >= SETTLE_S
        is_alone = not self._awaited.intersection(published)
        return (
            is_alone and self._first_seen_s is not None and now_s - self._first_seen_s >= PATIENCE_S
        )
