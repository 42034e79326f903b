"""A drive's radio traffic as it was recorded, or as a simulated sender sends it to a bridge in one process.

Every datagram of a recording is replayed for its original tick. With end-of-tick marks the tick
is exact, so that a replay repeats bit for bit. One without them, such as a capture of the air, is cut by the
times of reception.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from iptm_core.errors import ParameterError
from iptm_core.state import NS_PER_MS
from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.datagrams import EndOfTick, Reception
from iptm_v2x_bridge.sending.sender import CamSender


@dataclass(frozen=True)
class RadioRecording:
    """All that was received in one trip.

    Attributes:
        start_timestamp_ms: TimestampIts at trip time 0.
        receptions: by tick, in the order of reception.
        dropped: by tick, how many more datagrams had to be dropped unread by then.
    """

    start_timestamp_ms: int
    receptions: tuple[Reception, ...]
    dropped: tuple[tuple[int, int], ...] = ()
    _ticks_ns: tuple[int, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        ticks_ns = tuple(reception.tick_ns for reception in self.receptions)
        object.__setattr__(self, "_ticks_ns", ticks_ns)

    @property
    def ends_ns(self) -> int:
        """The last tick that a datagram counts for, 0 without any."""
        return self.receptions[-1].tick_ns if self.receptions else 0

    def received(self, after_ns: int | None, until_ns: int) -> tuple[Sequence[Reception], int]:
        """Return what counts for the ticks after one (None for all before) and up to another.

        Returns:
            The datagrams, and how many more had been dropped unread.
        """
        ticks_ns = self._ticks_ns
        first = 0 if after_ns is None else bisect_right(ticks_ns, after_ns)
        dropped = sum(
            count
            for tick_ns, count in self.dropped
            if tick_ns <= until_ns and (after_ns is None or tick_ns > after_ns)
        )
        return self.receptions[first : bisect_right(ticks_ns, until_ns)], dropped


def recording_with_marks(
    received: Iterable[tuple[int, bytes]], source: str, start_timestamp_ms: int | None = None
) -> RadioRecording | None:
    """Return a recording whose datagrams end with a mark at every tick, None without marks.

    Args:
        received: time of reception (ns of TimestampIts) and bytes, in the order of reception.
        source: file, for messages.
        start_timestamp_ms: TimestampIts at trip time 0, the time of reception being that of another clock;
            None where the marks themselves were received in the time of the trip.

    Raises:
        ParameterError: it holds several trips.
    """
    start_ms = start_timestamp_ms
    waiting: list[tuple[int, bytes]] = []
    receptions: list[Reception] = []
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
            receptions.append(Reception(mark.time_ns, at_ns, data))
        waiting.clear()
        missing = mark.sent - len(receptions) - lost
        if missing > 0:
            dropped.append((mark.time_ns, missing))
            lost += missing
    if start_ms is None or last_ns is None:
        return None
    return RadioRecording(start_ms, tuple(receptions), tuple(dropped))


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
    return RadioRecording(start_ms, tuple(Reception(at_ns, at_ns, data) for at_ns, data in trip))


class SimulatedRadio:
    """Hands the bridge, before each tick, everything that arrives up to it.

    All of it is received at the time of the tick, as in lock-step over a socket: both give the same numbers.
    """

    def __init__(self, sender: CamSender, bridge: CamBridge) -> None:
        self._sender, self.bridge = sender, bridge
        self._heard_until_ns: int | None = None

    def answer(
        self, time_ns: int, ego_position_m: float, ego_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        """Return the answer to one tick; see `CamBridge.answer`."""
        after_ns = self._heard_until_ns
        if after_ns is None or after_ns > time_ns:
            after_ns = -(10**12)
        for _, datagram in self._sender.arrivals(after_ns, time_ns):
            self.bridge.receive(datagram, time_ns)
        self._heard_until_ns = time_ns
        return self.bridge.answer(time_ns, ego_position_m, ego_speed_m_s)
