"""Table of the messages of roadside stations; rejected ones are counted by reason.

A map holds for the whole trip, as stop lines are fixed; phases expire without new messages;
speed signs hold until cancelled. The time of a packet is not checked: it is that of the
station's position, which may have been surveyed long ago.

Messages wait to be decoded, so that they cannot delay ticks and messages of cars: a map of 1.3 kB takes 5
ms, a message of a car 0.06 ms. Bytes stand for the time of decoding (3 to 4 us each, measured with pycrate),
so the same messages at the same times have the same outcome on every machine, live and recorded.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable

from iptm_core.routes.road_line import RoadLine
from iptm_v2x_bridge.messages.ivim import SpeedSigns, decode_ivim
from iptm_v2x_bridge.messages.mapem import IntersectionMap, LaneMaps, decode_mapem
from iptm_v2x_bridge.messages.packets import MESSAGE_HEADER_BYTES, MessageKind, OpenedDatagram
from iptm_v2x_bridge.messages.spatem import (
    IntersectionId,
    IntersectionPhases,
    SignalPhases,
    decode_spatem,
)
from iptm_v2x_bridge.rejections import LeftOut, Rejection, RejectionCounts
from iptm_v2x_bridge.roadside.phases import TimedPhases, opens_too_early, timed
from iptm_v2x_bridge.roadside.road_places import StopLine, Stretch, stop_lines, stretches
from iptm_v2x_bridge.stations.plausibility import MAX_AGE_MS, MAX_AHEAD_MS

PHASES_KNOWN_MS = 5000
"""Age at which phases expire; the line is then treated as one without a signal."""
MAX_INTERSECTIONS, MAX_SIGNS = 256, 256
"""Largest numbers kept; the farthest map, the oldest phases and the oldest sign are discarded."""
_REVISIONS = 128
_KINDS = {
    MessageKind.SPATEM: decode_spatem,
    MessageKind.MAPEM: decode_mapem,
    MessageKind.IVIM: decode_ivim,
}
ROADSIDE_KINDS = tuple(_KINDS)


class RoadsideTable:
    """Holds maps, phases and signs by their identity.

    Attributes:
        accepted: messages taken in, by kind.
        rejections: messages that were not.
        left_out: parts of messages that were not read.
        ego_position_m: front of the ego vehicle along the road; the farthest map gives way when there are too
        many.
    """

    def __init__(self, road: RoadLine) -> None:
        """Set up a table in which nothing has been heard; `road` is the ego vehicle's route."""
        self._road = road
        self.forget()

    def forget(self) -> None:
        """Forget everything that was heard."""
        self._maps: dict[IntersectionId, tuple[IntersectionMap, tuple[StopLine, ...]]] = {}
        self._phases: dict[IntersectionId, TimedPhases] = {}
        self._signs: dict[tuple[int, int, int], tuple[SpeedSigns, tuple[Stretch, ...]]] = {}
        self.accepted: Counter[MessageKind] = Counter()
        self.rejections = RejectionCounts()
        self.left_out: Counter[LeftOut] = Counter()
        self._accepted_maps: dict[bytes, None] = {}
        self.ego_position_m = 0.0

    def repeats(self, opened: OpenedDatagram) -> bool:
        """Return whether a message repeats one of the last accepted maps; if so, it is accepted."""
        if opened.payload not in self._accepted_maps:
            return False
        self._accepted_maps[opened.payload] = self._accepted_maps.pop(opened.payload)
        self.accepted[opened.kind] += 1
        return True

    def receive(self, opened: OpenedDatagram, now_ms: int) -> Rejection | None:
        """Take a message in; return why not, None if it was accepted."""
        message = _KINDS[opened.kind](opened.payload)
        reason = message if isinstance(message, Rejection) else self.take(message, now_ms)
        if reason is None:
            self.accepted[opened.kind] += 1
            if opened.kind is MessageKind.MAPEM:
                self._accepted_maps[opened.payload] = None
                if len(self._accepted_maps) > MAX_INTERSECTIONS:
                    del self._accepted_maps[next(iter(self._accepted_maps))]
        else:
            self.rejections.add(reason)
        return reason

    def take(self, message: SignalPhases | LaneMaps | SpeedSigns, now_ms: int) -> Rejection | None:
        """Take in what has been read; see `receive`."""
        if isinstance(message, SpeedSigns):
            return self._take_signs(message, now_ms)
        reasons = [
            self._take_phases(entry, now_ms)
            if isinstance(entry, IntersectionPhases)
            else self._take_map(entry)
            for entry in message.intersections
        ]
        if isinstance(message, LaneMaps):
            self.left_out.update(message.left_out)
        refused = [reason for reason in reasons if reason is not None]
        return refused[0] if refused else None

    def _take_phases(self, message: IntersectionPhases, now_ms: int) -> Rejection | None:
        phases = timed(message, now_ms)
        if phases.sent_ms > now_ms + MAX_AHEAD_MS:
            return Rejection.FUTURE
        if phases.sent_ms < now_ms - MAX_AGE_MS:
            return Rejection.STALE
        known = self._phases.pop(message.intersection, None)
        if known is not None and now_ms - known.sent_ms <= PHASES_KNOWN_MS:
            reason = _out_of_order(known.sent_ms, phases.sent_ms)
            if reason is None and opens_too_early(known, phases):
                reason = Rejection.PHASE_JUMP
            if reason is not None:
                self._phases[message.intersection] = known
                return reason
        # In the order of arrival: the first one is the oldest.
        self._phases[message.intersection] = phases
        if len(self._phases) > MAX_INTERSECTIONS:
            del self._phases[next(iter(self._phases))]
            self.rejections.add(Rejection.TABLE_FULL)
        return None

    def _take_map(self, message: IntersectionMap) -> Rejection | None:
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
            self._accepted_maps.clear()  # what was forgotten is to be read again
            self.rejections.add(Rejection.TABLE_FULL)
        return None

    def _distance_m(self, intersection: IntersectionId) -> float:
        _, lines = self._maps[intersection]
        away = (abs(line.position_m - self.ego_position_m) for line in lines)
        return min(away, default=float("inf"))

    def _take_signs(self, message: SpeedSigns, now_ms: int) -> Rejection | None:
        if message.issued_ms is not None and message.issued_ms > now_ms + MAX_AHEAD_MS:
            return Rejection.FUTURE
        if message.valid_to_ms is not None and message.valid_to_ms < now_ms:
            return Rejection.STALE
        known = self._signs.get(message.identity)
        if known is not None:
            if message == known[0]:
                return None  # signs are repeated as long as they hold
            if (message.issued_ms or 0) < (known[0].issued_ms or 0):
                return Rejection.OLDER
        self.left_out.update(message.left_out)
        found = () if message.is_cancelled else stretches(self._road, message)
        self._signs.pop(message.identity, None)
        # A cancellation is kept: what it cancels may be replayed.
        if found or known is not None:
            self._signs[message.identity] = message, found
        if len(self._signs) > MAX_SIGNS:
            del self._signs[next(iter(self._signs))]
            self.rejections.add(Rejection.TABLE_FULL)
        return None

    def lines(self) -> list[StopLine]:
        """Return the stop lines of all maps, in driving order."""
        found = (line for _, lines in self._maps.values() for line in lines)
        return sorted(found, key=lambda line: line.position_m)

    def phases_of(self, line: StopLine, now_ms: int) -> TimedPhases | None:
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

    def stretches(self, now_ms: int) -> list[Stretch]:
        """Return the stretches with speed limits that hold now."""
        return [
            stretch
            for signs, found in self._signs.values()
            if (signs.valid_from_ms or 0) <= now_ms <= (signs.valid_to_ms or now_ms)
            for stretch in found
        ]


def _out_of_order(before_ms: int, after_ms: int) -> Rejection | None:
    if after_ms > before_ms:
        return None
    return Rejection.DUPLICATE if after_ms == before_ms else Rejection.OLDER


BYTES_PER_MS = 30
"""Decoded on average: a tenth of a processor core, or 15 intersections with phases ten times a second."""
BURST_BYTES = 5000
"""Decoded at once: about 20 ms, before which no tick is answered."""
KEPT_PER_STATION = 16
"""Newest messages kept of one kind and station; one station may send for several intersections."""
MAX_STATIONS = 128
"""Stations with waiting messages of one kind."""

_Waiting = dict[int, deque[tuple[OpenedDatagram, int]]]


class WaitingMessages:
    """Hands messages over within a budget: kinds in turn, stations in turn, each in order of arrival."""

    def __init__(self, decode: Callable[[OpenedDatagram, int], object]) -> None:
        """Set up; `decode` takes a message and the TimestampIts of its reception."""
        self._decode = decode
        self._waiting: dict[MessageKind, _Waiting] = {}
        self._budget_bytes = BURST_BYTES
        self._at_ms = 0

    def __len__(self) -> int:
        """Return the number of messages that wait."""
        return sum(len(kept) for kind in self._waiting.values() for kept in kind.values())

    def add(self, opened: OpenedDatagram, now_ms: int) -> bool:
        """Let a message wait; return whether one has been dropped for it, or it itself."""
        if now_ms > self._at_ms:
            self.decode(now_ms)  # before this message, whenever it was called last
        station_id = int.from_bytes(opened.payload[2:MESSAGE_HEADER_BYTES], "big")
        stations = self._waiting.setdefault(opened.kind, {})
        if station_id not in stations and len(stations) >= MAX_STATIONS:
            return True
        kept = stations.setdefault(station_id, deque(maxlen=KEPT_PER_STATION))
        is_full = len(kept) == KEPT_PER_STATION
        kept.append((opened, now_ms))
        return is_full

    def decode(self, now_ms: int) -> None:
        """Hand over what the budget allows by now (TimestampIts); the last message may exceed it."""
        passed_ms = max(now_ms - self._at_ms, 0)
        self._at_ms += passed_ms
        self._budget_bytes = min(self._budget_bytes + BYTES_PER_MS * passed_ms, BURST_BYTES)
        while self._waiting and self._budget_bytes > 0:
            opened, heard_ms = self._next()
            self._budget_bytes -= len(opened.payload)
            self._decode(opened, heard_ms)

    def _next(self) -> tuple[OpenedDatagram, int]:
        """Take out the message whose turn it is; its kind and its station go to the end of their rows."""
        kind = next(iter(self._waiting))
        stations = self._waiting.pop(kind)
        station_id = next(iter(stations))
        kept = stations.pop(station_id)
        found = kept.popleft()
        if kept:
            stations[station_id] = kept
        if stations:
            self._waiting[kind] = stations
        return found
