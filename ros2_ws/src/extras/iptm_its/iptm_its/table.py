"""The messages of roadside stations, and the rules of the road as given and heard.

A map holds for the whole trip, as stop lines are fixed; phases expire without new messages. The time of a
packet is not checked: it refers to the station's position, which may have been surveyed long ago. Rejected
messages are counted by reason.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import replace

from iptm_core.routes.road_line import RoadLine
from iptm_its.interpretation import (
    SAME_LINE_M,
    StopLine,
    joined,
    likely_closed,
    opens_too_early,
    stop_lines,
    surely_closed,
)
from iptm_its.mapem import IntersectionMap, decode_mapem
from iptm_its.pycrate_codec import WaitingMessages
from iptm_its.spatem import IntersectionId, IntersectionPhases, decode_spatem
from iptm_v2x_bridge.messages.packets import MessageKind, OpenedDatagram
from iptm_v2x_bridge.prediction.road_rules import ALWAYS, RoadRules, Signal
from iptm_v2x_bridge.rejections import LeftOut, Rejection, RejectionCounts
from iptm_v2x_bridge.stations.plausibility import LARGEST_OFFSET_MS, MAX_AGE_MS, ClockOffset

PHASES_KNOWN_MS = 5000
"""Age at which phases expire; the line is then treated as one without a signal."""
MAX_INTERSECTIONS = 256
"""Largest number kept; the farthest map and the oldest phases are discarded."""
CLOCK_MESSAGES = 10
"""Newest messages of an intersection whose ages show the offset of its clock."""
_REVISIONS = 128
_Part = IntersectionPhases | IntersectionMap
_KINDS: dict[MessageKind, Callable[[bytes, int], Sequence[_Part] | Rejection]] = {
    MessageKind.SPATEM: decode_spatem,
    MessageKind.MAPEM: lambda payload, _: decode_mapem(payload),
}


class RoadsideTable:
    """Holds maps and phases by their identity, and combines given rules with those received.

    For a stop line with both, messages take precedence, also after they have ceased.

    Attributes:
        accepted: messages taken in, by kind.
        rejections: messages that were not.
        left_out: parts of messages that were not read.
        ego: rules for an ego vehicle that keeps them: a line of unknown phase is closed.
        leader: rules for the prediction of a leader: a line of unknown phase binds it to nothing.
    """

    def __init__(self, road: RoadLine, given: RoadRules | None = None) -> None:
        """Set up a table in which nothing has been heard; `road` is the ego vehicle's route."""
        self._road, self._given = road, given or RoadRules()
        self.ego, self.leader = replace(self._given), replace(self._given)
        self._clear()

    def _clear(self) -> None:
        self._maps: dict[IntersectionId, tuple[IntersectionMap, tuple[StopLine, ...]]] = {}
        self._phases: dict[IntersectionId, IntersectionPhases] = {}
        self._ages_ms: dict[IntersectionId, deque[int]] = {}
        self.accepted: Counter[MessageKind] = Counter()
        self.rejections = RejectionCounts()
        self.left_out: Counter[LeftOut] = Counter()
        self._accepted_maps: dict[bytes, None] = {}
        self._waiting = WaitingMessages(self._read)
        self._known: dict[float, IntersectionPhases | None] = {}
        self._ego_position_m = self._now_s = 0.0

    def forget(self) -> None:
        """Forget everything that was heard."""
        self._clear()
        self.refresh(0, 0.0)

    def receive(self, opened: OpenedDatagram, now_ms: int) -> None:
        """Let a message wait to be decoded; one that repeats one of the last accepted maps is accepted."""
        if opened.payload in self._accepted_maps:
            self._accepted_maps[opened.payload] = self._accepted_maps.pop(opened.payload)
            self.accepted[opened.kind] += 1
        elif self._waiting.add(opened, now_ms):
            self.rejections.add(Rejection.WAITED)

    def decode(self, now_ms: int) -> None:
        """Decode as many of the waiting messages as the processor time allows; see `WaitingMessages`."""
        self._waiting.decode(now_ms)

    def _read(self, opened: OpenedDatagram, now_ms: int) -> None:
        parts = _KINDS[opened.kind](opened.payload, now_ms)
        if not isinstance(parts, Rejection):
            reasons = [self.take(part, now_ms) for part in parts]
            parts = next((reason for reason in reasons if reason is not None), ())
        if isinstance(parts, Rejection):
            self.rejections.add(parts)
            return
        self.accepted[opened.kind] += 1
        if opened.kind is MessageKind.MAPEM:
            self._accepted_maps[opened.payload] = None
            if len(self._accepted_maps) > MAX_INTERSECTIONS:
                del self._accepted_maps[next(iter(self._accepted_maps))]

    def take(self, part: _Part, now_ms: int) -> Rejection | None:
        """Take in what has been read; return why not, None if it was accepted."""
        if isinstance(part, IntersectionMap):
            return self._take_map(part)
        return self._take_phases(part, now_ms)

    def _take_phases(self, phases: IntersectionPhases, now_ms: int) -> Rejection | None:
        if phases.sent_ms > now_ms + LARGEST_OFFSET_MS:
            return Rejection.FUTURE
        if phases.sent_ms < now_ms - MAX_AGE_MS:
            return Rejection.STALE
        known = self._phases.pop(phases.intersection, None)
        if known is not None and now_ms - known.sent_ms <= PHASES_KNOWN_MS:
            reason = _out_of_order(known.sent_ms, phases.sent_ms)
            if reason is None and opens_too_early(known, phases):
                reason = Rejection.PHASE_JUMP
            if reason is not None:
                self._phases[phases.intersection] = known
                return reason
        # In the order of arrival: the first one is the oldest.
        self._phases[phases.intersection] = phases
        ages_ms = self._ages_ms.setdefault(phases.intersection, deque(maxlen=CLOCK_MESSAGES))
        ages_ms.append(now_ms - phases.sent_ms)
        if len(self._phases) > MAX_INTERSECTIONS:
            oldest = next(iter(self._phases))
            del self._phases[oldest], self._ages_ms[oldest]
            self.rejections.add(Rejection.TABLE_FULL)
        return None

    def _take_map(self, message: IntersectionMap) -> Rejection | None:
        self.left_out.update(message.left_out)
        known = self._maps.get(message.intersection)
        if known is not None:
            before, _ = known
            newer = (message.revision - before.revision) % _REVISIONS
            if newer == 0:
                return None if message == before else Rejection.OTHER_MAP
            if newer > _REVISIONS // 2:
                return Rejection.OLDER
        lines = stop_lines(self._road, message)
        if lines or known is not None:
            self._maps[message.intersection] = message, lines
        if len(self._maps) > MAX_INTERSECTIONS:
            farthest = max(self._maps, key=self._distance_m)
            del self._maps[farthest]
            self._accepted_maps.clear()  # forgotten maps are read again
            self.rejections.add(Rejection.TABLE_FULL)
        return None

    def _distance_m(self, intersection: IntersectionId) -> float:
        _, lines = self._maps[intersection]
        away = (abs(line.position_m - self._ego_position_m) for line in lines)
        return min(away, default=float("inf"))

    def lines(self) -> list[StopLine]:
        """Return the stop lines of all maps, in driving order."""
        found = (line for _, lines in self._maps.values() for line in lines)
        return sorted(found, key=lambda line: line.position_m)

    def phases_of(self, line: StopLine, now_ms: int) -> IntersectionPhases | None:
        """Return the phases of a line, None where they are not known, be it any more."""
        phases = self._phases.get(line.intersection)
        if (
            phases is None
            or not phases.is_working
            or phases.revision != line.revision
            or now_ms - phases.sent_ms > PHASES_KNOWN_MS
            or not line.groups <= phases.groups.keys()
        ):
            return None
        return phases

    def refresh(self, now_ms: int, ego_position_m: float) -> None:
        """Bring the rules up to date."""
        self._ego_position_m, self._now_s = ego_position_m, now_ms / 1000.0
        self.decode(now_ms)
        lines = self.lines()
        known = {line: self.phases_of(line, now_ms) for line in lines}
        given: list[Signal] = [
            signal
            for signal in self._given.signals
            if all(abs(signal.stop_line_m - line.position_m) >= SAME_LINE_M for line in lines)
        ]
        cautious = [self._signal(line, phases, surely=True) for line, phases in known.items()]
        likely = [
            self._signal(line, phases, surely=False)
            for line, phases in known.items()
            if phases is not None
        ]
        self.ego.signals = _in_order([*given, *cautious])
        self.leader.signals = _in_order([*given, *likely])
        self._known = {line.position_m: phases for line, phases in known.items()}

    def _signal(self, line: StopLine, phases: IntersectionPhases | None, *, surely: bool) -> Signal:
        """Return a line that is open while all of its groups are, by the own clock.

        The times of a clock that is ahead are moved back. One that may be behind opens later by as much.
        """
        if phases is None:
            return Signal(line.position_m, ALWAYS)
        clock = ClockOffset.of(self._ages_ms[line.intersection])
        closed, later_s = (surely_closed, clock.behind_s) if surely else (likely_closed, 0.0)
        spans = (
            (begins - clock.ahead_s, ends - clock.ahead_s + later_s)
            for group in line.groups
            for begins, ends in closed(phases.groups[group])
        )
        return Signal(line.position_m, joined(spans))

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics: what is known from where, and what was left out."""
        following = self.ego.next_after(self._ego_position_m)
        state = "none"
        if following is not None:
            state = "open" if following.is_open(self._now_s) else "closed"
            if following.stop_line_m not in self._known:
                state += " (given)"
            elif self._known[following.stop_line_m] is None:
                state = "unknown, counts as closed"
            else:
                state += " (heard)"
        values: dict[str, object] = {
            f"{kind.name.lower()}_accepted": self.accepted[kind] for kind in _KINDS
        }
        values |= {
            "roadside_waiting": len(self._waiting),
            "lines_heard": len(self._known),
            "lines_of_unknown_phase": sum(phases is None for phases in self._known.values()),
            "next_line": state,
            "next_line_m": "none" if following is None else following.stop_line_m,
        }
        return values | {f"left_out_{part}": count for part, count in self.left_out.items()}


def _out_of_order(before_ms: int, after_ms: int) -> Rejection | None:
    if after_ms > before_ms:
        return None
    return Rejection.DUPLICATE if after_ms == before_ms else Rejection.OLDER


def _in_order(signals: list[Signal]) -> tuple[Signal, ...]:
    """Return the signals in driving order; of two at one place, the first counts."""
    by_place = {signal.stop_line_m: signal for signal in reversed(signals)}
    return tuple(by_place[place] for place in sorted(by_place))
