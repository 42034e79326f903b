"""Events on the road: the leader that counts is not the one of the route, and its predictions follow it."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import replace

import numpy as np

from iptm_core.state import LeaderPreview, LeaderState
from iptm_faults.events import TrafficEvent
from iptm_faults.fault import Fault, at_places
from iptm_faults.kinds import FaultPlace


class Traffic:
    """The leader that counts, after all events on the road.

    Each event turns the leader and the previews of the event before it into its own.
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        happening = [fault for fault in at_places(faults, FaultPlace.TRAFFIC) if fault.happens()]
        self._events: list[TrafficEvent] = [fault.effect(fault) for fault in happening]
        self._starts_s = [fault.start_s for fault in happening]

    @property
    def is_quiet(self) -> bool:
        """Whether the traffic has no event."""
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

    def sampled(self, own: LeaderPreview, host_position_m: float) -> LeaderPreview:
        """Return the leader that counts at the instants of an interval; events begin with ticks.

        Args:
            own: the leader of the route at these instants, the first of which is the present tick.
            host_position_m: where the host is at the first of them.
        """
        if not own.times_s.size:
            return own
        now_s = float(own.times_s[0])
        # Copies: the next tick goes on from this one.
        events = [
            copy(event)
            for event, start_s in zip(self._events, self._starts_s, strict=True)
            if start_s <= now_s
        ]
        states = []
        for row in zip(
            *(v.tolist() for v in (own.times_s, own.positions_m, own.speeds_m_s)), strict=True
        ):
            state = LeaderState(*row)
            for event in events:
                state = event.leader(state, host_position_m)
            states.append(state)
        return replace(
            own,
            positions_m=np.array([state.position_m for state in states]),
            speeds_m_s=np.array([state.speed_m_s for state in states]),
        )

    def preview(self, own: LeaderPreview) -> LeaderPreview:
        """Return what the leader that counts has predicted, from a prediction for the leader of the route."""
        for event in self._events:
            own = event.preview(own)
        return own
