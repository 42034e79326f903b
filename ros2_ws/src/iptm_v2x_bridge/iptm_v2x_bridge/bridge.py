"""The bridge without ROS: for every tick, the leader now and the prediction held on board."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from iptm_core.road_ahead import RoadAhead
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_core.state import NS_PER_S, LeaderPreview, LeaderState
from iptm_v2x_bridge.imperfections import distort, is_lost, latency_ns
from iptm_v2x_bridge.source import PreviewSource, preview_times_s


@dataclass(frozen=True)
class BridgeAnswer:
    """Answer of the bridge at one tick.

    Attributes:
        time_ns: the tick, integer nanoseconds of trip time.
        leader: state of the leader at the tick; None without a leader.
        preview: latest prediction received, with its own time of generation.
        lost: whether the prediction generated at this tick is lost on the way.
        predictor: predictor in use on the leader's messages; empty without one.
        leader_bound_m: conservative reduction of the leader's distance.
        contested: whether messages with the identity of the leader contradict each other.
        road: rules of the road, None where none are known.
    """

    time_ns: int
    leader: LeaderState | None
    preview: LeaderPreview
    lost: bool
    predictor: str = ""
    leader_bound_m: float = 0.0
    contested: bool = False
    road: RoadAhead | None = None

    @property
    def preview_age_s(self) -> float:
        """Time since the generation of the preview, infinite if there is none."""
        return self.preview.age_s(self.time_ns / NS_PER_S)


class TickBridge(Protocol):
    """What answers ticks, wherever it knows the leader from."""

    def answer(
        self, time_ns: int, host_position_m: float, host_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        """Return the answer to one tick.

        Args:
            time_ns: the tick, integer nanoseconds of trip time.
            host_position_m: front of the host along the road at the tick.
            host_speed_m_s: its speed; plays no part without rules of the road.
        """
        ...


class V2xBridge:
    """Answers ticks in increasing order of time.

    The same tick asked again gets the same answer; an earlier one means that a new trip has begun.

    Attributes:
        sent: predictions generated in this trip, lost ones included.
        lost: predictions lost in this trip.
    """

    def __init__(
        self,
        source: PreviewSource,
        settings: PreviewSettings | None = None,
        earlier_ticks_ns: range = range(0),
    ) -> None:
        """Set up a bridge at the beginning of a trip."""
        self._source = source
        self._settings = settings or PreviewSettings()
        self._earlier_ticks_ns = earlier_ticks_ns
        self._restart()

    def _restart(self) -> None:
        self._in_flight: list[tuple[int, LeaderPreview]] = []
        self._latest = LeaderPreview.empty()
        self._last: BridgeAnswer | None = None
        self.sent = 0
        self.lost = 0

    def answer(
        self,
        time_ns: int,
        host_position_m: float = 0.0,  # noqa: ARG002
        host_speed_m_s: float = 0.0,  # noqa: ARG002
    ) -> BridgeAnswer:
        """Return the answer to one tick; the place of the host plays no part. See `TickBridge.answer`."""
        if self._last is not None and time_ns == self._last.time_ns:
            return self._last
        if self._last is not None and time_ns < self._last.time_ns:
            self._restart()
        leader, lost = self._source.leader_at(time_ns), False
        if self._settings.preview_mode is not PreviewMode.NONE:
            if self._last is None and time_ns == self._earlier_ticks_ns.stop:
                for earlier_ns in self._earlier_ticks_ns:
                    self._transmit(earlier_ns)
            lost = self._transmit(time_ns)
        self._last = BridgeAnswer(time_ns, leader, self._latest, lost)
        return self._last

    def _transmit(self, time_ns: int) -> bool:
        """Send the prediction of this tick and receive what has arrived; return whether it is lost.

        The newest prediction by its time of generation is held exactly as it was generated: its age must stay
        visible to its user.
        """
        self.sent += 1
        lost = is_lost(self._settings, time_ns)
        if lost:
            self.lost += 1
        else:
            preview = self._source.predict(preview_times_s(self._settings, time_ns))
            due_ns = time_ns + latency_ns(self._settings)
            self._in_flight.append((due_ns, distort(self._settings, preview)))
        while self._in_flight and self._in_flight[0][0] <= time_ns:
            _, preview = self._in_flight.pop(0)
            if preview.times_s.size and preview.generated_at_s >= self._latest.generated_at_s:
                self._latest = preview
        return lost
