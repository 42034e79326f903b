"""Put together what belongs together: messages of several topics with the very same stamp."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from iptm_core.errors import ParameterError
from iptm_interfaces.codecs.time import is_stamp
from iptm_interfaces.stamp_gate import StampGate, Verdict

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class MatcherCounts:
    """What became of the messages.

    Attributes:
        matched: sets handed out.
        late: messages for a stamp not newer than the last set.
        duplicate: messages that replaced one of the same slot and stamp.
        abandoned: sets given up, because a newer one was handed out or memory was full.
        stray: sets and messages whose stamp does not belong to the trip.
    """

    matched: int = 0
    late: int = 0
    duplicate: int = 0
    abandoned: int = 0
    stray: int = 0


@dataclass(frozen=True)
class MatchedSet(Generic[K]):
    """Messages of one stamp.

    Attributes:
        stamp_ns: the stamp.
        values: one value per slot; not all of them if it was handed out incomplete, none if it is the
            last set that was sent again.
        verdict: what the stamp is to the trip.
    """

    stamp_ns: int
    values: Mapping[K, Any]
    verdict: Verdict


@dataclass
class _Pending(Generic[K]):
    """Values of one stamp so far, and how many of the leading ones are among them."""

    values: dict[K, Any]
    led: int = 0


class StampMatcher(Generic[K]):
    """Collects one value per named slot for each stamp and hands out complete sets.

    Stamps are compared as integer nanoseconds, never approximately. Only the leading slots, those of the
    state of the plant, advance the trip: messages in the other slots with stray stamps are
    collected separately and discarded first. Sets leave in the order of the trip: once a set is
    complete, older ones are dropped, except those of a trip that a new one has just interrupted.
    """

    def __init__(
        self,
        slots: Iterable[K],
        leading: Iterable[K] | None = None,
        max_pending: int = 16,
        gate: StampGate | None = None,
        is_complete: Callable[[Mapping[K, Any]], bool] | None = None,
    ) -> None:
        """Set up a matcher.

        Args:
            slots: names that make a set complete.
            leading: the slots that advance the time of the trip, by default all.
            max_pending: incomplete sets kept; beyond it one that is least likely the next tick is given up.
            gate: judges the stamps of sets.
            is_complete: whether the values of a stamp make a set, by default those of all slots.

        Raises:
            ParameterError: no slot, no room, or a leading slot that is none.
        """
        self._slots = tuple(dict.fromkeys(slots))
        self._leading = frozenset(self._slots if leading is None else leading)
        if not (self._slots and self._leading) or max_pending < 1:
            raise ParameterError(
                f"matcher has {len(self._slots)} slots, {len(self._leading)} of them leading, and room "
                f"for {max_pending} sets; allowed: at least 1 of each"
            )
        self._max_pending = max_pending
        self._gate = gate or StampGate()
        self._is_complete = is_complete or self._has_all
        self._pending: dict[int, _Pending[K]] = {}
        self._again: set[K] = set()
        self._counts = dict.fromkeys(("matched", "late", "duplicate", "abandoned"), 0)

    @property
    def counts(self) -> MatcherCounts:
        """What became of the messages so far."""
        return MatcherCounts(**self._counts, stray=self._gate.strays)

    @property
    def duplicates(self) -> int:
        """Messages that replaced one of the same slot and stamp."""
        return self._counts["duplicate"]

    @property
    def gate(self) -> StampGate:
        """Judge of the stamps."""
        return self._gate

    @property
    def last_ns(self) -> int | None:
        """Stamp of the last set handed out."""
        return self._gate.now_ns

    def put(self, slot: K, stamp_ns: int, value: Any) -> MatchedSet[K] | None:
        """Add a value; return the set if this was the last one missing.

        The last set is returned once more, without values, when all of its leading slots came again.

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
        if not is_stamp(stamp_ns):
            self._gate.turn_away()
            return None
        if self._gate.is_late(stamp_ns):
            self._counts["late"] += 1
            if stamp_ns == self._gate.now_ns:
                return self._put_again(slot, stamp_ns)
        pending = self._pending.get(stamp_ns)
        if pending is None:
            pending = self._pending[stamp_ns] = _Pending({})
        values = pending.values
        if slot in values:
            self._counts["duplicate"] += 1
        elif slot in self._leading:
            pending.led += 1
        values[slot] = value
        if self._is_complete(values):
            return self._hand_out(stamp_ns)
        if len(self._pending) > self._max_pending:
            del self._pending[min(self._pending, key=self._likelihood)]
            self._counts["abandoned"] += 1
        return None

    def _has_all(self, values: Mapping[K, Any]) -> bool:
        return len(values) == len(self._slots)

    def _put_again(self, slot: K, stamp_ns: int) -> MatchedSet[K] | None:
        self._again.add(slot)
        if not self._leading <= self._again:
            return None
        self._again.clear()
        return MatchedSet(stamp_ns, {}, self._gate.judge(stamp_ns))

    def _hand_out(self, stamp_ns: int) -> MatchedSet[K] | None:
        values = self._pending.pop(stamp_ns).values
        verdict = self._gate.judge(stamp_ns)
        if verdict is Verdict.STRAY:
            return None
        later = verdict is Verdict.NEXT
        over = [stamp for stamp in self._pending if not later or stamp < stamp_ns]
        for other in over:
            # A beginning may be a stray stamp, then the trip before goes on with what has come of its tick.
            if self._gate.may_resume(other):
                continue
            del self._pending[other]
            self._counts["abandoned"] += 1
        self._again.clear()
        self._counts["matched"] += 1
        return MatchedSet(stamp_ns, values, verdict)

    def _likelihood(self, stamp_ns: int) -> tuple[bool, int, int]:
        """Return what orders pending sets by how likely they become the next tick."""
        distance_ns = abs(stamp_ns - self._gate.expected_ns)
        return self._gate.follows(stamp_ns), self._pending[stamp_ns].led, -distance_ns

    def _candidates(self) -> list[int]:
        """Stamps of the pending sets with a part of the leading slots, those of the trip if there are any."""
        led = [stamp for stamp, pending in self._pending.items() if pending.led]
        return [stamp for stamp in led if self._gate.follows(stamp)] or led

    @property
    def is_waiting(self) -> bool:
        """Whether a part of the leading slots of a set is there, but not all of the set."""
        return any(pending.led for pending in self._pending.values())

    @property
    def backlog_ns(self) -> int:
        """Time from the last set to the newest one of the trip that lacks no leading slot.

        0 while there is only one such set: then the plant may be waiting for the answer.
        """
        led = [
            stamp
            for stamp, pending in self._pending.items()
            if pending.led == len(self._leading) and self._gate.follows(stamp)
        ]
        if len(led) < 2:
            return 0
        last_ns = self._gate.now_ns
        return max(led) - (min(led) if last_ns is None else last_ns)

    def missing(self) -> tuple[int, tuple[K, ...]] | None:
        """Return stamp and missing slots of the set that `take_incomplete` would hand out."""
        candidates = self._candidates()
        if not candidates:
            return None
        stamp_ns = max(candidates, key=lambda stamp: (self._pending[stamp].led, stamp))
        values = self._pending[stamp_ns].values
        return stamp_ns, tuple(slot for slot in self._slots if slot not in values)

    def take_incomplete(self) -> MatchedSet[K] | None:
        """Hand out the newest of the sets that lack least of the leading slots, for a makeshift answer.

        Older sets are discarded; later messages of this stamp are late.
        """
        waiting = self.missing()
        return None if waiting is None else self._hand_out(waiting[0])
