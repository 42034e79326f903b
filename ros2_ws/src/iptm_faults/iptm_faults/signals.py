"""Effects of faults on measurements: the pure part, tick by tick; None if nothing arrives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace

import numpy as np

from iptm_core.state import NS_PER_S, LeaderPreview, LeaderState, SlopePreview, VehicleState
from iptm_faults.fault import Fault, at_places
from iptm_faults.kinds import FaultPlace


class PreviewFaults:
    """Applies preview faults to the predictions of the leader's motion."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._faults = at_places(faults, FaultPlace.PREVIEW)
        self._first: dict[int, LeaderPreview] = {}

    def hits(self, time_ns: int) -> bool:
        """Return whether the prediction of a tick is changed."""
        return any(fault.hits(time_ns) for fault in self._faults)

    def apply(self, time_ns: int, preview: LeaderPreview) -> LeaderPreview | None:
        """Return the prediction with faults applied; ticks in increasing order of time.

        Args:
            time_ns: the tick.
            preview: the prediction as sent.
        """
        faulty: LeaderPreview | None = preview
        for number, fault in enumerate(self._faults):
            if faulty is not None and fault.hits(time_ns):
                first = self._first.setdefault(number, faulty)
                faulty = fault.effect(fault, time_ns, faulty, first)
        return faulty


def faulty_leader(
    faults: Iterable[Fault], time_ns: int, leader: LeaderState, host_position_m: float
) -> LeaderState | None:
    """Return the measured leader; the host's position is the true one."""
    faulty: LeaderState | None = leader
    for fault in at_places(faults, FaultPlace.LEADER):
        if faulty is not None and fault.hits(time_ns):
            faulty = fault.effect(fault, time_ns, faulty, host_position_m)
    return faulty


def faulty_samples(
    faults: Iterable[Fault], samples: LeaderPreview, host_position_m: float
) -> LeaderPreview | None:
    """Return the measurements of a range sensor in an interval, the samples themselves without faults.

    Args:
        faults: of all places.
        samples: the effective leader at the instants of the interval.
        host_position_m: where the host is at the first of them.

    Returns:
        The finite measurements that arrive, None for none.
    """
    of_leader = at_places(faults, FaultPlace.LEADER)
    columns = (
        values.tolist() for values in (samples.times_s, samples.positions_m, samples.speeds_m_s)
    )
    true = [LeaderState(*row) for row in zip(*columns, strict=True)]
    faulty = [
        faulty_leader(of_leader, round(one.time_s * NS_PER_S), one, host_position_m) for one in true
    ]
    if faulty == true:
        return samples
    rows = [(one.time_s, one.position_m, one.speed_m_s) for one in faulty if one is not None]
    rows = [row for row in rows if np.isfinite(row).all()]
    return LeaderPreview(rows[0][0], *np.array(rows).T) if rows else None


def faulty_state(faults: Iterable[Fault], time_ns: int, state: VehicleState) -> VehicleState:
    """Return the measured state of the ego vehicle; timing faults (late, repeated) are applied elsewhere."""
    for fault in at_places(faults, FaultPlace.STATE):
        if fault.spec.effect is not None and fault.hits(time_ns):
            state = fault.effect(fault, time_ns, _two_cells(state))
    return state


def faulty_slope(faults: Iterable[Fault], time_ns: int, slope: SlopePreview) -> SlopePreview:
    """Return the map of the road with faults applied."""
    for fault in at_places(faults, FaultPlace.ROAD):
        if fault.hits(time_ns):
            slope = replace(slope, slopes_rad=fault.effect(fault, slope.slopes_rad))
    return slope


def _two_cells(state: VehicleState) -> VehicleState:
    """Return the measured part of a state: the first and the last cell."""
    if type(state) is VehicleState:
        return state
    return VehicleState(**{item.name: getattr(state, item.name) for item in fields(VehicleState)})
