"""Where the host is at a tick, for answers that depend on it."""

from __future__ import annotations

import math
from collections.abc import Callable

from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock

from iptm_interfaces.codecs import ns_from_time
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import Topic

_KEPT = 16
MISSING = "waiting for the position of the host"


class HostStates:
    """Position and speed of the host by stamp."""

    def __init__(
        self, node: SuiteNode, retry: Callable[[], None], *, is_counted: bool = False
    ) -> None:
        """Listen to the odometry of the host.

        Args:
            node: takes part in the graph.
            retry: called on every state.
            is_counted: listen to the clock once more, only to be counted: the plant waits for the same number
                of peers on the clock as on the odometry.
        """
        self._retry = retry
        self._states: dict[int, tuple[float, float]] = {}
        node.listen(Topic.PLANT_ODOMETRY, self._on_odometry)
        if is_counted:
            node.listen(Topic.CLOCK, self._on_clock)

    def _on_clock(self, message: Clock) -> None:
        pass

    def _on_odometry(self, message: Odometry) -> None:
        position_m = float(message.pose.pose.position.x)
        speed_m_s = float(message.twist.twist.linear.x)
        if not (math.isfinite(position_m) and math.isfinite(speed_m_s)):
            return  # the tick stays unanswered; the report states what is waited for
        self._states[ns_from_time(message.header.stamp)] = (position_m, speed_m_s)
        while len(self._states) > _KEPT:
            del self._states[next(iter(self._states))]
        self._retry()

    def at(self, time_ns: int) -> tuple[float, float] | None:
        """Return position (m) and speed (m/s) at a tick, None while they are missing."""
        return self._states.get(time_ns)
