"""What faults make of a measurement: the pure part, tick by tick; None means that nothing arrives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace

import numpy as np

from iptm_core.state import LeaderPreview, LeaderState, SlopePreview, VehicleState
from iptm_core.trip_time import NS_PER_S
from iptm_faults.fault import Fault, at_places
from iptm_faults.kinds import FaultPlace


class PreviewFaults:
    """What becomes of the predictions of the leader."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._faults = at_places(faults, FaultPlace.PREVIEW)
        self._first: dict[int, LeaderPreview] = {}

    def hits(self, time_ns: int) -> bool:
        """Return whether the prediction of a tick is changed."""
        return any(fault.hits(time_ns) for fault in self._faults)

    def told(self, time_ns: int, preview: LeaderPreview) -> LeaderPreview | None:
        """Return what arrives instead of a prediction; ticks in increasing order of time.

        Args:
            time_ns: the tick.
            preview: what was sent.
        """
        told: LeaderPreview | None = preview
        for number, fault in enumerate(self._faults):
            if told is not None and fault.hits(time_ns):
                first = self._first.setdefault(number, told)
                told = fault.effect(fault, time_ns, told, first)
        return told


def told_leader(
    faults: Iterable[Fault], time_ns: int, leader: LeaderState, host_position_m: float
) -> LeaderState | None:
    """Return what is measured of the leader; the host's position is the true one."""
    told: LeaderState | None = leader
    for fault in at_places(faults, FaultPlace.LEADER):
        if told is not None and fault.hits(time_ns):
            told = fault.effect(fault, time_ns, told, host_position_m)
    return told


def told_samples(
    faults: Iterable[Fault], samples: LeaderPreview, host_position_m: float
) -> LeaderPreview | None:
    """Return what a range sensor measures in an interval, the samples themselves where nothing hits them.

    Args:
        faults: of all places.
        samples: the leader that counts at the instants of the interval.
        host_position_m: where the host is at the first of them.

    Returns:
        The finite measurements that arrive, None for none.
    """
    of_leader = at_places(faults, FaultPlace.LEADER)
    columns = (
        values.tolist() for values in (samples.times_s, samples.positions_m, samples.speeds_m_s)
    )
    true = [LeaderState(*row) for row in zip(*columns, strict=True)]
    told = [
        told_leader(of_leader, round(one.time_s * NS_PER_S), one, host_position_m) for one in true
    ]
    if told == true:
        return samples
    rows = [(one.time_s, one.position_m, one.speed_m_s) for one in told if one is not None]
    rows = [row for row in rows if np.isfinite(row).all()]
    return LeaderPreview(rows[0][0], *np.array(rows).T) if rows else None


def told_state(faults: Iterable[Fault], time_ns: int, state: VehicleState) -> VehicleState:
    """Return what is measured of the ego vehicle; faults in time (late, repeated) are not seen here."""
    for fault in at_places(faults, FaultPlace.STATE):
        if fault.spec.effect is not None and fault.hits(time_ns):
            state = fault.effect(fault, time_ns, _two_cells(state))
    return state


def told_slope(faults: Iterable[Fault], time_ns: int, slope: SlopePreview) -> SlopePreview:
    """Return the map of the road as it is told."""
    for fault in at_places(faults, FaultPlace.ROAD):
        if fault.hits(time_ns):
            slope = replace(slope, slopes_rad=fault.effect(fault, slope.slopes_rad))
    return slope


def _two_cells(state: VehicleState) -> VehicleState:
    """Return what is measured of a state: of its cells the first and the last."""
    if type(state) is VehicleState:
        return state
    return VehicleState(**{item.name: getattr(state, item.name) for item in fields(VehicleState)})
