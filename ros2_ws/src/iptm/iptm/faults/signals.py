"""Traffic and measurements under faults, tick by tick; None if nothing arrives."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from copy import copy
from dataclasses import fields, replace
from typing import Generic, TypeVar

import numpy as np

from iptm.faults.events import TrafficEvent
from iptm.faults.fault import Fault, at_places
from iptm.faults.kinds import FaultKind, FaultPlace
from iptm_core.state import NS_PER_S, LeaderPreview, LeaderState, SlopePreview, VehicleState

Value = TypeVar("Value")


class Delay(Generic[Value]):
    """The last values of a signal: earlier ones are returned while faults delay it by ticks."""

    def __init__(self, faults: Iterable[Fault], kind: FaultKind) -> None:
        self._faults = tuple(fault for fault in faults if fault.kind is kind)
        longest = round(sum(fault.magnitude for fault in self._faults))
        self._past: deque[tuple[int, Value]] = deque(maxlen=longest + 1)

    def delayed(self, time_ns: int, value: Value) -> Value:
        """Return the value that arrives at a tick, the oldest one until there is an earlier one.

        Args:
            time_ns: the tick; one that is not later than the last begins a new trip or repeats the tick.
        """
        while self._past and self._past[-1][0] >= time_ns:
            self._past.pop()
        self._past.append((time_ns, value))
        ticks = round(sum(fault.magnitude for fault in self._faults if fault.hits(time_ns)))
        return self._past[max(len(self._past) - 1 - ticks, 0)][1]


class PreviewFaults:
    """Applies preview faults to the predictions of the leader's motion."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._faults = at_places(faults, FaultPlace.PREVIEW)
        self._first: dict[int, LeaderPreview] = {}

    def hits(self, time_ns: int) -> bool:
        """Return whether the prediction of a tick is changed."""
        return any(fault.hits(time_ns) for fault in self._faults)

    def apply(self, time_ns: int, preview: LeaderPreview) -> LeaderPreview | None:
        """Return the prediction with faults applied; ticks in increasing order of time."""
        faulty: LeaderPreview | None = preview
        for number, fault in enumerate(self._faults):
            if faulty is not None and fault.hits(time_ns):
                first = self._first.setdefault(number, faulty)
                faulty = fault.effect_on(faulty, time_ns, first=first)
        return faulty


class RangeSensorFaults:
    """Applies faults of the range sensor to the lead vehicle, at ticks and between them."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._faults = at_places(faults, FaultPlace.LEADER)
        self._first: dict[int, tuple[LeaderState, float]] = {}

    @property
    def is_sound(self) -> bool:
        """Whether there are no faults."""
        return not self._faults

    def leader(
        self, time_ns: int, leader: LeaderState, ego_position_m: float
    ) -> LeaderState | None:
        """Return the leader measured at a tick; the ego vehicle's position is the true one."""
        for number, fault in enumerate(self._faults):
            if not fault.hits(time_ns):
                self._first.pop(number, None)
            else:
                self._first.setdefault(number, (leader, ego_position_m))
        return self._measured(time_ns, leader, ego_position_m)

    def samples(self, samples: LeaderPreview, ego_position_m: float) -> LeaderPreview | None:
        """Return the measurements of an interval, the samples themselves without faults.

        Args:
            samples: the effective leader at the instants of the interval, the first of which is a tick.
            ego_position_m: where the ego vehicle is at the first of them.

        Returns:
            The finite measurements that arrive, None for none; an empty lane where that is reported.
        """
        columns = (
            values.tolist() for values in (samples.times_s, samples.positions_m, samples.speeds_m_s)
        )
        true = [LeaderState(*row) for row in zip(*columns, strict=True)]
        faulty = [self._measured(round(one.time_s * NS_PER_S), one, ego_position_m) for one in true]
        if faulty == true:
            return samples
        rows = [(one.time_s, one.position_m, one.speed_m_s) for one in faulty if one is not None]
        rows = [row for row in rows if np.isfinite(row).all()]
        if rows:
            return LeaderPreview(*np.array(rows).T)
        start_ns = round(true[0].time_s * NS_PER_S)
        vanished = any(
            fault.kind is FaultKind.LEADER_VANISHED and fault.hits(start_ns)
            for fault in self._faults
        )
        return LeaderPreview.empty() if vanished else None

    def _measured(
        self, time_ns: int, leader: LeaderState, ego_position_m: float
    ) -> LeaderState | None:
        faulty: LeaderState | None = leader
        for number, fault in enumerate(self._faults):
            if faulty is not None and fault.hits(time_ns):
                first, first_ego_m = self._first.get(number, (faulty, ego_position_m))
                faulty = fault.effect_on(
                    faulty,
                    time_ns,
                    ego_position_m=ego_position_m,
                    first=first,
                    first_ego_position_m=first_ego_m,
                )
        return faulty


class StateFaults:
    """Applies faults to the measured state; timing faults (late, repeated) are applied elsewhere."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        own = at_places(faults, FaultPlace.STATE)
        self._faults = tuple(fault for fault in own if fault.spec.effect is not None)
        self._first: dict[int, VehicleState] = {}

    def hits(self, time_ns: int) -> bool:
        """Return whether the state of a tick is changed."""
        return any(fault.hits(time_ns) for fault in self._faults)

    def apply(self, time_ns: int, state: VehicleState) -> VehicleState:
        """Return the measured state with faults applied; ticks in increasing order of time."""
        for number, fault in enumerate(self._faults):
            if fault.hits(time_ns):
                state = _two_cells(state)
                first = self._first.setdefault(number, state)
                state = fault.effect_on(state, time_ns, first=first)
        return state


def faulty_slope(faults: Iterable[Fault], time_ns: int, slope: SlopePreview) -> SlopePreview:
    """Return the map of the road with faults applied."""
    for fault in at_places(faults, FaultPlace.ROAD):
        if fault.hits(time_ns):
            slope = replace(slope, slopes_rad=fault.effect_on(slope.slopes_rad, time_ns))
    return slope


def _two_cells(state: VehicleState) -> VehicleState:
    """Return the measured part of a state: the first and the last cell."""
    if type(state) is VehicleState:
        return state
    return VehicleState(**{item.name: getattr(state, item.name) for item in fields(VehicleState)})


class Traffic:
    """The leader that counts, after all events on the road.

    Each event turns the leader and the previews of the event before it into its own.
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._events: list[TrafficEvent] = []
        self._starts_s: list[float] = []
        for fault in at_places(faults, FaultPlace.TRAFFIC):
            if fault.spec.event is not None and fault.happens():
                self._events.append(fault.spec.event(fault))
                self._starts_s.append(fault.start_s)

    @property
    def is_quiet(self) -> bool:
        """Whether the traffic has no event."""
        return not self._events

    def leader(self, own: LeaderState, ego_position_m: float) -> LeaderState:
        """Return the leader that counts.

        Args:
            own: the leader of the route; ticks in increasing order of time.
            ego_position_m: where the ego vehicle is at the same instant.
        """
        for event in self._events:
            own = event.leader(own, ego_position_m)
        return own

    def sampled(self, own: LeaderPreview, ego_position_m: float) -> LeaderPreview:
        """Return the leader that counts at the instants of an interval; events begin with ticks.

        Args:
            own: the leader of the route at these instants, the first of which is the present tick.
            ego_position_m: where the ego vehicle is at the first of them.
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
                state = event.leader(state, ego_position_m)
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
