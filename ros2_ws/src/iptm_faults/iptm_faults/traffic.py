"""Events on the road: the leader that counts is not the one of the route, and its predictions follow it."""

from __future__ import annotations

from collections.abc import Iterable

from iptm_core.state import LeaderPreview, LeaderState
from iptm_faults.events import TrafficEvent
from iptm_faults.fault import Fault, at_places
from iptm_faults.kinds import FaultPlace


class Traffic:
    """The leader that counts, after all events on the road.

    Each event turns the leader and the previews of the event before it into its own.
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._events: list[TrafficEvent] = [
            fault.effect(fault)
            for fault in at_places(faults, FaultPlace.TRAFFIC)
            if fault.happens()
        ]

    @property
    def is_quiet(self) -> bool:
        """Whether there is no event at all."""
        return not self._events

    def leader(self, own: LeaderState, host_position_m: float) -> LeaderState:
        """Return the leader that counts.

        Args:
            own: the leader of the route; ticks in increasing order of time.
            host_position_m: where the host is at the same instant.
        """
        for event in self._events:
            own = event.leader(own, host_position_m)
        return own

    def preview(self, own: LeaderPreview) -> LeaderPreview:
        """Return what the leader that counts has predicted, from a prediction for the leader of the route."""
        for event in self._events:
            own = event.preview(own)
        return own
