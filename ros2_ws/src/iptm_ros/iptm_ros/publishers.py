"""Publishers of the suite: quality of service, and listeners that must miss nothing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

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
KEPT_RAW_QOS = _keep_last(5000, DurabilityPolicy.TRANSIENT_LOCAL)
"""The same for late subscribers, such as a recorder that the publisher discovers after its first burst."""
SENSOR_QOS = _keep_last(100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Requested of sensors of any origin: best effort, which reliable publishers meet as well, keep last 100."""


def describe_qos(profile: QoSProfile) -> str:
    """Return a profile in words, for tables and error texts, e.g. `reliable, keep last 100`."""
    reliability = profile.reliability.name.lower().replace("_", " ")
    durability = profile.durability.name.lower().replace("_", "-")
    text = f"{reliability}, keep last {profile.depth}"
    return text if durability == "volatile" else f"{text}, {durability}"


_LOOK_AFTER, _WAIT_AFTER = 3 * STREAM_QOS.depth // 8, STREAM_QOS.depth // 2
PATIENCE_S = 1.0
"""Longest wait for listeners."""
_PATIENCE, _NO_PATIENCE = Duration(seconds=PATIENCE_S), Duration()


class PatientPublisher(Publisher):
    """A publisher that can wait for its listeners.

    Attributes:
        is_left_behind: whether a listener did not follow when it was last waited for.
    """

    is_left_behind = False
    _unheard = 0
    _behind: Sequence[Publisher] = ()

    @property
    def is_heard(self) -> bool:
        """Whether a subscription is matched: what none takes need not be published."""
        return int(self.get_subscription_count()) > 0

    def let_listeners_follow(self, others: Iterable[Publisher] = ()) -> None:
        """Hold up a tick that is about to be published until no listener is more than half a queue behind.

        Listeners acknowledge once in several ticks. In the last of the ticks that may pass unacknowledged,
        publishers of which all has arrived are found without waiting, and then the others are waited for.

        A listener that has stopped holds this up once, for a second. It is not waited for again until all
        have followed, or it has left the graph.

        Args:
            others: checked as well, as each topic sends its lost messages again by itself.
        """
        self._unheard += 1
        if self._unheard < _LOOK_AFTER:
            return
        is_late = self._unheard >= _WAIT_AFTER and not self.is_left_behind
        patience = _PATIENCE if is_late else _NO_PATIENCE
        behind = list(self._behind or (self, *others))
        while behind and behind[-1].wait_for_all_acked(patience):
            behind.pop()
        self._behind = behind
        if not behind:
            self._unheard, self.is_left_behind = 0, False
        elif is_late:
            self.is_left_behind = True
