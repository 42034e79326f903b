"""Which tick is answered: one whose messages have the very same stamp, of several the newest."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

import numpy as np

from iptm_controller.measurements import Measurements
from iptm_core.errors import MessageError, ParameterError
from iptm_core.road_ahead import RoadAhead
from iptm_core.state import LeaderPreview, LeaderState, PackReading, SlopePreview, VehicleState
from iptm_ros.codecs import decode_leader, decode_observation
from iptm_ros.codecs.cdr import is_stamp
from iptm_ros.stamp_gate import StampGate, Verdict
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic

SLOW_DECISION_S = 0.05
WAITED_SHARE = 0.5
"""A tick that is complete within this share of the time of a slow decision after it has waited for it."""
CATCH_UP_S = 0.002
OTHER_INPUTS = (Topic.LEADER_PREVIEW, Topic.ROAD_AHEAD, Topic.LEADER)
"""What a decision takes besides the state."""
FLAT_ROAD = SlopePreview(np.zeros(1), np.zeros(1))


K = TypeVar("K", bound=Hashable)


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


class StampMatcher(Generic[K]):
    """Collects one value per named slot for each stamp and hands out complete sets.

    Stamps are compared as integer nanoseconds, never approximately. Only the leading slot, the state of the
    plant, advances the trip: messages in the other slots with stray stamps are discarded first. Sets leave in
    the order of the trip: once a set is complete, older ones are dropped, except those of a trip that a new
    one has just interrupted.

    Attributes:
        gate: judges the stamps of sets; it counts the stray ones.
        counts: sets `matched` (handed out) and `abandoned` (given up, because a newer one was handed out or
            memory was full); messages `late` (for a stamp not newer than the last set) and `duplicate`
            (replaced one of the same slot and stamp, or came again for two sets in a row that had left).
    """

    def __init__(
        self,
        leading: K,
        others: Iterable[K] = (),
        max_pending: int = 16,
        gate: StampGate | None = None,
        is_complete: Callable[[Mapping[K, Any]], bool] | None = None,
    ) -> None:
        """Set up a matcher.

        Args:
            leading: the slot that advances the time of the trip.
            others: further slots.
            max_pending: incomplete sets kept; beyond it one that is least likely the next tick is given up.
            is_complete: whether the values of a stamp make a set, by default of all slots.
        """
        if max_pending < 1:
            raise ParameterError(f"matcher has room for {max_pending} sets; allowed: at least 1")
        self._leading = leading
        self._slots = tuple(dict.fromkeys((leading, *others)))
        self._max_pending = max_pending
        self.gate = gate or StampGate()
        self._is_complete = is_complete or (lambda values: len(values) == len(self._slots))
        self._pending: dict[int, dict[K, Any]] = {}
        self._last_slots: set[K] = set()
        self._came_again = self._came_again_before = False
        self.counts: Counter[str] = Counter()

    @property
    def last_ns(self) -> int | None:
        """Stamp of the last set handed out."""
        return self.gate.now_ns

    def put(self, slot: K, stamp_ns: int, value: Any) -> MatchedSet[K] | None:
        """Add a value; return the set if this was the last one missing.

        The last set is returned once more, without values, when its leading slot came again.
        """
        if slot not in self._slots:
            allowed = ", ".join(map(str, self._slots))
            raise ParameterError(f"matcher has no slot {slot!r}; allowed: {allowed}")
        if not is_stamp(stamp_ns):
            self.gate.turn_away()
            return None
        if self.gate.is_late(stamp_ns):
            self.counts["late"] += 1
            if stamp_ns == self.gate.now_ns:
                if slot == self._leading:
                    return MatchedSet(stamp_ns, {}, self.gate.judge(stamp_ns))
                self._note_again(slot)
                return None
        values = self._pending.setdefault(stamp_ns, {})
        if slot in values:
            self.counts["duplicate"] += 1
        values[slot] = value
        if self._is_complete(values):
            return self._hand_out(stamp_ns)
        if len(self._pending) > self._max_pending:
            del self._pending[min(self._pending, key=self._likelihood)]
            self.counts["abandoned"] += 1
        return None

    def _note_again(self, slot: K) -> None:
        """Note a message for the last set. Once it may be the answer to a state that came again."""
        if slot in self._last_slots:
            self._came_again = True
            if self._came_again_before:
                self.counts["duplicate"] += 1
        self._last_slots.add(slot)

    def _hand_out(self, stamp_ns: int) -> MatchedSet[K] | None:
        values = self._pending.pop(stamp_ns)
        verdict = self.gate.judge(stamp_ns)
        if verdict is Verdict.STRAY:
            return None
        self._last_slots = set(values)
        self._came_again, self._came_again_before = False, self._came_again
        later = verdict is Verdict.NEXT
        over = [stamp for stamp in self._pending if not later or stamp < stamp_ns]
        for other in over:
            # A beginning may be a stray stamp, then the trip before goes on with the messages of its tick.
            if self.gate.may_resume(other):
                continue
            del self._pending[other]
            self.counts["abandoned"] += 1
        self.counts["matched"] += 1
        return MatchedSet(stamp_ns, values, verdict)

    def _likelihood(self, stamp_ns: int) -> tuple[bool, bool, int]:
        """Return what orders pending sets by how likely they become the next tick."""
        distance_ns = abs(stamp_ns - self.gate.expected_ns)
        return self.gate.follows(stamp_ns), self._leading in self._pending[stamp_ns], -distance_ns

    def _candidates(self) -> list[int]:
        """Stamps of the pending sets that may be handed out as they are, of the trip if there are any.

        They have the leading slot; or it alone is missing, in a set of the trip.
        """
        led = [stamp for stamp, values in self._pending.items() if self._leading in values]
        of_trip = [stamp for stamp in led if self.gate.follows(stamp)]
        answered = [
            stamp
            for stamp, values in self._pending.items()
            if self.gate.follows(stamp) and self._is_complete({**values, self._leading: None})
        ]
        return of_trip or answered or led

    @property
    def is_waiting(self) -> bool:
        """Whether a set is there that lacks something."""
        has_state = any(self._leading in values for values in self._pending.values())
        return has_state or bool(self._candidates())

    @property
    def backlog_ns(self) -> int:
        """Time from the last set to the newest one of the trip that has the leading slot.

        0 while there is only one such set: then the plant may be waiting for the answer.
        """
        led = [
            stamp
            for stamp, values in self._pending.items()
            if self._leading in values and self.gate.follows(stamp)
        ]
        if len(led) < 2:
            return 0
        last_ns = self.gate.now_ns
        return max(led) - (min(led) if last_ns is None else last_ns)

    def missing(self) -> tuple[int, tuple[K, ...]] | None:
        """Return stamp and missing slots of the set that `take_incomplete` would hand out."""
        stamp_ns = max(self._candidates(), default=None)
        if stamp_ns is None:
            return None
        values = self._pending[stamp_ns]
        return stamp_ns, tuple(slot for slot in self._slots if slot not in values)

    def take_incomplete(self) -> MatchedSet[K] | None:
        """Hand out the newest of the sets that may be the next tick, for a fallback answer."""
        waiting = self.missing()
        return None if waiting is None else self._hand_out(waiting[0])


class CompleteTick:
    """Determines whether all messages of a tick have arrived.

    The road ahead states whether there is a leader to wait for. Without such a topic, as of a bridge of the
    user's, there always is.
    """

    def __init__(self, node: SuiteNode) -> None:
        name = node.resolve_topic_name(Topic.ROAD_AHEAD.value)
        self._look = partial(node.count_publishers, name)
        self._has_road = False

    def __call__(self, values: Mapping[Topic, Any]) -> bool:
        """Return whether a tick with these messages can be decided."""
        if not {Topic.PLANT_STATE, Topic.LEADER_PREVIEW} <= values.keys():
            return False
        road: RoadAhead | None = values.get(Topic.ROAD_AHEAD)
        if road is not None:
            return Topic.LEADER in values or not road.has_leader
        if Topic.LEADER not in values:
            return False
        self._has_road = self._has_road or self._look() > 0
        return not self._has_road


class CatchUp:
    """Answers the newest tick only, where others have waited for the decision on the one before.

    In real time a controller that decides more slowly than ticks come would otherwise fall behind further
    and further. In lock-step the plant waits, so nothing is skipped.

    Attributes:
        is_skipping: whether ticks are skipped at present.
        skipped_ticks: ticks without a decision of their own.
    """

    def __init__(self, node: SuiteNode, answer: Callable[[MatchedSet[Topic]], None]) -> None:
        self.is_skipping = False
        self.skipped_ticks = 0
        self._answer = answer
        self._newest: MatchedSet[Topic] | None = None
        self._seen_last: MatchedSet[Topic] | None = None
        self._answered_s = -math.inf
        self._took_s = 0.0
        self._timer = node.every(CATCH_UP_S, self._catch_up)
        self._timer.cancel()

    def note_answer(self, started_s: float) -> None:
        """Note that a decision which was begun at a steady time is made."""
        self._answered_s = time.monotonic()
        self._took_s = self._answered_s - started_s

    def takes(self, matched: MatchedSet[Topic]) -> bool:
        """Return whether a tick is kept until what else has waited is taken in."""
        if self._newest is None and not self._is_behind():
            self.is_skipping = False
            return False
        if self._newest is not None:
            self.skipped_ticks += 1
            self.is_skipping = True
        self._newest = matched
        if self._timer.is_canceled():
            self._seen_last = None
            self._timer.reset()
        return True

    def _is_behind(self) -> bool:
        """Return whether a tick has waited for the decision on the one before."""
        waited = time.monotonic() - self._answered_s < WAITED_SHARE * self._took_s
        return waited and self._took_s > SLOW_DECISION_S

    def _catch_up(self) -> None:
        """Answer as soon as no further tick has been completed for a moment."""
        if self._newest is not self._seen_last:
            self._seen_last = self._newest
            return
        self._timer.cancel()
        newest, self._newest = self._newest, None
        if newest is not None:
            self._answer(newest)


def read_measurements(values: Mapping[Topic, Any], slope: SlopePreview | None) -> Measurements:
    """Decode the arrived messages, with the reason for each missing one.

    Args:
        values: messages of a tick by topic, preview and road decoded already.
        slope: of the road, None where it is not known.
    """
    faults = []
    road: RoadAhead | None = values.get(Topic.ROAD_AHEAD)
    state: VehicleState | None = None
    leader: LeaderState | None = None
    pack: PackReading | None = None
    try:
        if Topic.PLANT_STATE in values:
            observed = decode_observation(values[Topic.PLANT_STATE])
            state, pack = observed.state, observed.pack_reading
        else:
            faults.append(f"no {Topic.PLANT_STATE.value} received")
    except MessageError as error:
        faults.append(str(error))
    try:
        if Topic.LEADER in values:
            leader = decode_leader(values[Topic.LEADER])
        elif road is None or road.has_leader or road.limits is None:
            faults.append("no measurement of the leader received")
    except MessageError as error:
        faults.append(str(error))
    preview: LeaderPreview = values.get(Topic.LEADER_PREVIEW) or LeaderPreview.empty()
    return Measurements(state, leader, preview, slope or FLAT_ROAD, "; ".join(faults), road, pack)
