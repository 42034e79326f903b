"""Whether another vehicle of the graph is there."""

from __future__ import annotations

from collections.abc import Callable

from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import Topic, topic_of

_LOOK_PERIOD_S = 0.5


class VehiclePresence:
    """Checks whether another vehicle still publishes a topic.

    The middleware reports the end of a process at once, and a killed one after its lease. A process that
    is only slow is still there, however busy the machine.

    Attributes:
        is_gone: it published the topic and does not any more.
    """

    def __init__(
        self, node: SuiteNode, vehicle: str, topic: Topic, on_gone: Callable[[], None]
    ) -> None:
        """Begin to look.

        Args:
            node: looks around in the graph.
            vehicle: namespace of the vehicle.
            topic: what it publishes.
            on_gone: called when it has gone.
        """
        self.is_gone = False
        self._node, self._on_gone = node, on_gone
        self._name = node.resolve_topic_name(topic_of(vehicle, topic))
        self._was_there = False
        node.every(_LOOK_PERIOD_S, self._look)

    def _look(self) -> None:
        is_there = self._node.count_publishers(self._name) > 0
        self._was_there |= is_there
        went = self._was_there and not is_there and not self.is_gone
        self.is_gone = self._was_there and not is_there
        if went:
            self._on_gone()
