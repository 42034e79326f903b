"""Radio traffic as recorded, replayed for its original ticks, and what hands it to a bridge without a socket.

With end-of-tick marks the tick of a datagram is exact, so that a replay repeats bit for bit. A recording
without them, such as a capture of the air, is cut by the times of reception.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Protocol

from iptm_core.errors import ParameterError
from iptm_core.state import NS_PER_MS
from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.datagrams import DatagramSource, EndOfTick, Received


class RadioRecording(DatagramSource):
    """All that was received in one trip; it restarts with every trip.

    Attributes:
        start_timestamp_ms: TimestampIts at trip time 0.
        receptions: the first tick that each datagram counts for, when it was received (both ns of trip time),
            and its bytes, in the order of reception.
        dropped: by tick, how many more datagrams had to be dropped unread by then.
    """

    def __init__(
        self,
        start_timestamp_ms: int,
        receptions: Sequence[tuple[int, int, bytes]],
        dropped: Sequence[tuple[int, int]] = (),
    ) -> None:
        super().__init__(start_timestamp_ms)
        self.start_timestamp_ms, self.receptions = start_timestamp_ms, receptions
        self.dropped = dropped
        self._ticks_ns = [tick_ns for tick_ns, _, _ in receptions]

    def take(self, after_ns: int | None, until_ns: int) -> tuple[Sequence[Received], int]:
        """Return what counts for the ticks after one up to another; see `DatagramSource`."""
        ticks_ns = self._ticks_ns
        first = 0 if after_ns is None else bisect_right(ticks_ns, after_ns)
        dropped = sum(
            count
            for tick_ns, count in self.dropped
            if tick_ns <= until_ns and (after_ns is None or tick_ns > after_ns)
        )
        taken = self.receptions[first : bisect_right(ticks_ns, until_ns)]
        return [(received_ns, datagram) for _, received_ns, datagram in taken], dropped

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics: datagrams, and the last tick that one counts for."""
        return {
            "recorded_datagrams": len(self.receptions),
            "recorded_until_s": max(self._ticks_ns, default=0) * 1e-9,
        }


def recording_with_marks(
    received: Iterable[tuple[int, bytes]], source: str, start_timestamp_ms: int | None = None
) -> RadioRecording | None:
    """Return a recording whose datagrams end with a mark at every tick, None without marks.

    Args:
        received: time of reception (ns of TimestampIts) and bytes, in the order of reception.
        source: file, for messages.
        start_timestamp_ms: TimestampIts at trip time 0, the time of reception is of another clock;
            None where the marks themselves were received in the time of the trip.

    Raises:
        ParameterError: it holds several trips.
    """
    start_ms = start_timestamp_ms
    waiting: list[tuple[int, bytes]] = []
    receptions: list[tuple[int, int, bytes]] = []
    dropped: list[tuple[int, int]] = []
    last_ns: int | None = None
    lost = 0
    for its_ns, datagram in received:
        mark = EndOfTick.decode(datagram)
        if mark is None:
            waiting.append((its_ns, datagram))
            continue
        if last_ns is not None and mark.time_ns < last_ns:
            raise ParameterError(
                f"recorded_packets is {source!r}, where {mark.time_ns * 1e-9:g} s of a trip follow "
                f"{last_ns * 1e-9:g} s; allowed: one trip"
            )
        last_ns = mark.time_ns
        if start_ms is None:
            start_ms = (its_ns - mark.time_ns) // NS_PER_MS
        for heard_ns, data in waiting:
            own_ns = heard_ns - start_ms * NS_PER_MS
            at_ns = own_ns if start_timestamp_ms is None else mark.time_ns
            receptions.append((mark.time_ns, at_ns, data))
        waiting.clear()
        missing = mark.sent - len(receptions) - lost
        if missing > 0:
            dropped.append((mark.time_ns, missing))
            lost += missing
    if start_ms is None or last_ns is None:
        return None
    return RadioRecording(start_ms, receptions, dropped)


def recording_by_time(
    received: Iterable[tuple[int, bytes]], start_timestamp_ms: int
) -> RadioRecording:
    """Return a recording whose datagrams count from the time of their reception on.

    Args:
        received: time of reception (ns of TimestampIts) and bytes, at least one.
        start_timestamp_ms: TimestampIts at trip time 0; 0 or less begins the trip with the first datagram.
    """
    by_time = sorted(received, key=lambda entry: entry[0])
    start_ms = start_timestamp_ms if start_timestamp_ms > 0 else by_time[0][0] // NS_PER_MS
    trip = [(its_ns - start_ms * NS_PER_MS, datagram) for its_ns, datagram in by_time]
    return RadioRecording(start_ms, [(at_ns, at_ns, data) for at_ns, data in trip])


class Radio(Protocol):
    """A source without a socket: a recording, or a simulated sender."""

    def take(self, after_ns: int | None, until_ns: int) -> tuple[Sequence[Received], int]:
        """Return the datagrams received in a time; see `DatagramSource`."""
        ...


class SimulatedRadio:
    """Hands the bridge, before each tick, everything that is received up to it.

    Attributes:
        bridge: the bridge.
        predictors: ticks by the predictor in use.
    """

    def __init__(self, source: Radio, bridge: CamBridge) -> None:
        self._source, self.bridge = source, bridge
        self.predictors: Counter[str] = Counter()

    def answer(
        self, time_ns: int, ego_position_m: float, ego_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        """Return the answer to one tick; see `CamBridge.answer`."""
        after_ns = self.bridge.read_until_ns
        if after_ns is not None and after_ns > time_ns:
            after_ns = None  # a new trip
        received, dropped = self._source.take(after_ns, time_ns)
        for received_ns, datagram in received:
            self.bridge.receive(datagram, received_ns)
        self.bridge.count_overflow(dropped)
        self.bridge.read_until_ns = time_ns
        answer = self.bridge.answer(time_ns, ego_position_m, ego_speed_m_s)
        self.predictors[answer.predictor or "none"] += 1
        return answer
