"""Incidents of a node: exceptions in callbacks, refused messages, duplicate peers.

Counters run for the lifetime of the node; the status reports recent incidents only.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from iptm_interfaces.topics import Topic

MAX_MESSAGE_BYTES = 64 * 1024
"""Largest serialised message taken from a topic, unless it is named below."""
_LARGER_BYTES = {
    # The longest and finest preview that the settings of the bridge allow.
    Topic.LEADER_PREVIEW: 18 * 2**20,
    Topic.SLOPE: 4 * 2**20,
    Topic.PLAN: 2**20,
    Topic.DIAGNOSTICS: 2**20,
}

RECENT_S = 3.0
"""Steady time for which a status reports an incident."""
LINGERING_S = 25.0
"""Steady time after which a second publisher is a duplicate; Fast DDS drops a killed process after 20 s."""


def largest_message_bytes(topic: Topic) -> int:
    """Return the size beyond which a serialised message is refused unread."""
    return _LARGER_BYTES.get(topic, MAX_MESSAGE_BYTES)


@dataclass
class _Incidents:
    count: int = 0
    last_s: float = -math.inf
    what: str = "none"

    def note(self, what: str, now_s: float) -> None:
        self.count += 1
        self.last_s, self.what = now_s, what


class NodeHealth:
    """Incidents of one node.

    Attributes:
        defects: unexpected exceptions.
        refusals: messages that were too large or could not be read.
    """

    def __init__(self, steady_time_s: Callable[[], float] = time.monotonic) -> None:
        self._steady_time_s = steady_time_s
        self.defects = _Incidents()
        self.refusals = _Incidents()
        self._doubled_since_s: dict[str, float] = {}
        self._contradicted_s: dict[str, float] = {}

    def note_defect(self, what: str) -> None:
        """Count an unexpected exception."""
        self.defects.note(what, self._steady_time_s())

    def note_refusal(self, what: str) -> None:
        """Count a refused message."""
        self.refusals.note(what, self._steady_time_s())

    def note_publishers(self, who: str, count: int) -> None:
        """Record the number of publishers of a topic that only one node should publish.

        Args:
            who: the node that should be the only one.
            count: publishers in the graph.
        """
        if count < 2:
            self._doubled_since_s.pop(who, None)
        else:
            self._doubled_since_s.setdefault(who, self._steady_time_s())

    def note_contradiction(self, who: str) -> None:
        """Record a message that a single node would not send: a repeated or late answer."""
        self._contradicted_s[who] = self._steady_time_s()

    @property
    def doubled(self) -> tuple[str, ...]:
        """Nodes that are there more than once.

        A killed process stays in the graph for a while, so either both must speak, or the second one must
        stay for longer than that.
        """
        now_s = self._steady_time_s()
        return tuple(
            who
            for who, since_s in self._doubled_since_s.items()
            if now_s - since_s > LINGERING_S
            or self._contradicted_s.get(who, -math.inf) > max(since_s, now_s - RECENT_S)
        )

    @property
    def error(self) -> str:
        """Reason for an error status without numbers, empty if there is none."""
        if self._is_recent(self.defects):
            return "an internal error was caught, see the log"
        doubled = self.doubled
        return f"more than one {' and '.join(doubled)} on this graph" if doubled else ""

    @property
    def warning(self) -> str:
        """Reason for a warning without numbers, empty if there is none."""
        return "messages were refused" if self._is_recent(self.refusals) else ""

    @property
    def values(self) -> dict[str, object]:
        """Key values for the diagnostics."""
        return {
            "caught_errors": self.defects.count,
            "last_caught_error": self.defects.what,
            "refused_messages": self.refusals.count,
            "last_refused_message": self.refusals.what,
        }

    def _is_recent(self, incidents: _Incidents) -> bool:
        return self._steady_time_s() - incidents.last_s < RECENT_S


class AwakeClock:
    """Steady time without the stretches in which the process did not run.

    A process that was frozen, or busy in one callback, has not looked at its messages meanwhile: the
    silence of others must not be judged by that time.
    """

    PERIOD_S = 0.1
    LONGEST_STEP_S = 0.5

    def __init__(self) -> None:
        self._base_s = 0.0
        self._ticked_s = time.monotonic()

    def tick(self) -> None:
        """Note that the process runs; call it every `PERIOD_S`."""
        self._base_s = self.now_s()
        self._ticked_s = time.monotonic()

    def now_s(self) -> float:
        """Return the time in s."""
        return self._base_s + min(time.monotonic() - self._ticked_s, self.LONGEST_STEP_S)
