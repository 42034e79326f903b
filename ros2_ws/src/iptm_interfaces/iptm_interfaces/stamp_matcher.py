"""Put together what belongs together: messages of several topics with the very same stamp."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from iptm_core.errors import ParameterError

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class MatcherCounts:
    """What became of the messages.

    Attributes:
        matched: complete sets handed out.
        late: messages for a stamp not newer than the last set.
        duplicate: messages that replaced one of the same slot and stamp.
        abandoned: incomplete sets given up, because a newer one was complete or memory was full.
    """

    matched: int = 0
    late: int = 0
    duplicate: int = 0
    abandoned: int = 0


class StampMatcher(Generic[K]):
    """Collects one value per named slot for each stamp and hands out complete sets.

    Stamps are compared as integer nanoseconds, never approximately. Sets leave in increasing order
    of stamp: once a set is complete, older ones can no longer become complete and are dropped.
    """

    def __init__(self, slots: Iterable[K], max_pending: int = 16) -> None:
        """Set up a matcher.

        Args:
            slots: names that make a set complete.
            max_pending: incomplete sets kept; beyond it the oldest is given up.

        Raises:
            ParameterError: no slot, or no room.
        """
        self._slots = tuple(dict.fromkeys(slots))
        if not self._slots or max_pending < 1:
            raise ParameterError(
                f"matcher has {len(self._slots)} slots and room for {max_pending} sets; "
                "allowed: at least 1 of each"
            )
        self._max_pending = max_pending
        self._pending: dict[int, dict[K, Any]] = {}
        self._last_ns: int | None = None
        self._counts = dict.fromkeys(("matched", "late", "duplicate", "abandoned"), 0)

    @property
    def counts(self) -> MatcherCounts:
        """What became of the messages so far."""
        return MatcherCounts(**self._counts)

    @property
    def last_ns(self) -> int | None:
        """Stamp of the last complete set."""
        return self._last_ns

    def put(self, slot: K, stamp_ns: int, value: Any) -> Mapping[K, Any] | None:
        """Add a value; return the complete set if this was the last one missing.

        Args:
            slot: one of the names.
            stamp_ns: stamp in integer nanoseconds.
            value: the message or what was decoded from it.

        Raises:
            ParameterError: unknown slot.
        """
        if slot not in self._slots:
            allowed = ", ".join(map(str, self._slots))
            raise ParameterError(f"matcher has no slot {slot!r}; allowed: {allowed}")
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            self._counts["late"] += 1
            return None
        values = self._pending.setdefault(stamp_ns, {})
        if slot in values:
            self._counts["duplicate"] += 1
        values[slot] = value
        if len(values) == len(self._slots):
            self._finish(stamp_ns)
            return values
        if len(self._pending) > self._max_pending:
            del self._pending[min(self._pending)]
            self._counts["abandoned"] += 1
        return None

    def _finish(self, stamp_ns: int) -> None:
        del self._pending[stamp_ns]
        for older in [pending for pending in self._pending if pending < stamp_ns]:
            del self._pending[older]
            self._counts["abandoned"] += 1
        self._last_ns = stamp_ns
        self._counts["matched"] += 1

    def missing(self) -> tuple[int, tuple[K, ...]] | None:
        """Return stamp and missing slots of the newest incomplete set, for a diagnostic reason."""
        if not self._pending:
            return None
        newest = max(self._pending)
        values = self._pending[newest]
        return newest, tuple(slot for slot in self._slots if slot not in values)

    def take_incomplete(self) -> tuple[int, Mapping[K, Any]] | None:
        """Hand out the newest incomplete set with its stamp, for an answer with what there is.

        Older sets are given up; what still arrives for this stamp counts as late.
        """
        if not self._pending:
            return None
        newest = max(self._pending)
        values = self._pending[newest]
        self._counts["abandoned"] += len(self._pending)
        self._pending.clear()
        self._last_ns = newest
        return newest, values

    def reset(self) -> None:
        """Forget everything but the counts, for a trip that starts again at an earlier time."""
        self._pending.clear()
        self._last_ns = None
