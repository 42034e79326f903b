"""Publishers of the suite: quality of service, and listeners that must miss nothing."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _keep_last(
    depth: int,
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE,
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=reliability, durability=durability
    )


STREAM_QOS = _keep_last(100)
"""State, previews and commands: reliable, volatile, and deep, as foreign messages must not displace due ones
in a subscription, and a listener may be a moment late.
"""
KEPT_STREAM_QOS = _keep_last(100, DurabilityPolicy.TRANSIENT_LOCAL)
"""A stream that late subscribers receive from its beginning, as far as the history is kept."""
LATCHED_QOS = _keep_last(1, DurabilityPolicy.TRANSIENT_LOCAL)
"""Static data: reliable, keep last 1, transient-local (a late subscriber still gets it)."""
RAW_QOS = _keep_last(5000)
"""What comes in bursts and must not be lost: reliable, keep last 5000, volatile."""
SENSOR_QOS = _keep_last(100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Requested of sensors of any origin: best effort, which reliable publishers meet as well, keep last 100."""


def describe_qos(profile: QoSProfile) -> str:
    """Return a profile in words, for tables and error texts, e.g. `reliable, keep last 100`."""
    reliability = profile.reliability.name.lower().replace("_", " ")
    durability = profile.durability.name.lower().replace("_", "-")
    text = f"{reliability}, keep last {profile.depth}"
    return text if durability == "volatile" else f"{text}, {durability}"


_PATIENCE_S = 1.0


class PatientPublisher(Publisher):
    """A publisher that can wait for its listeners.

    Attributes:
        is_left_behind: whether a listener did not follow when it was last waited for.
    """

    is_left_behind = False
    _unheard = 0

    def let_listeners_follow(self, others: Iterable[Publisher] = ()) -> None:
        """Wait, each time half a queue has been published, until every listener has it, as a recorder must.

        A listener that has stopped holds this up once, for a second. It is not waited for again until all
        have followed, or it has left the graph.

        Args:
            others: waited for as well, as what is lost on the way is sent again topic by topic.
        """
        self._unheard += 1
        if self._unheard < STREAM_QOS.depth // 2:
            return
        self._unheard = 0
        patience_s = 0.0 if self.is_left_behind else _PATIENCE_S
        self.is_left_behind = not all(
            each.wait_for_all_acked(Duration(seconds=patience_s)) for each in (self, *others)
        )
