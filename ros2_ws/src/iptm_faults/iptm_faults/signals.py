"""What faults make of a measurement: the pure part, tick by tick; None means that nothing arrives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from iptm_core.parameters.units import CELSIUS_ZERO_K
from iptm_core.state import LeaderPreview, LeaderState, SlopePreview, VehicleState
from iptm_core.trip_time import NS_PER_S
from iptm_faults.fault import Fault, at_places
from iptm_faults.kinds import FaultKind, FaultPlace


class PreviewFaults:
    """What becomes of the predictions of the leader."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._faults = at_places(faults, FaultPlace.PREVIEW)
        self._held: dict[int, LeaderPreview] = {}

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
                self._held.setdefault(number, told)
                told = self._changed(fault, time_ns, told, self._held[number])
        return told

    @staticmethod
    def _changed(
        fault: Fault, time_ns: int, preview: LeaderPreview, held: LeaderPreview
    ) -> LeaderPreview | None:
        if fault.kind is FaultKind.PREVIEW_LOST:
            return None
        if fault.kind is FaultKind.PREVIEW_EMPTY or preview.times_s.size == 0:
            return LeaderPreview.empty()
        if fault.kind is FaultKind.PREVIEW_STALE:
            return held
        if fault.kind is FaultKind.PREVIEW_FROZEN:
            return _moved_in_time(held, preview.generated_at_s - held.generated_at_s)
        if fault.kind is FaultKind.PREVIEW_FUTURE:
            now_s = time_ns / NS_PER_S
            return _moved_in_time(preview, now_s + fault.magnitude - preview.generated_at_s)
        return _spoilt(fault, preview, fault.random(time_ns))


def _moved_in_time(preview: LeaderPreview, by_s: float) -> LeaderPreview:
    times_s = preview.times_s + by_s
    return replace(preview, generated_at_s=float(times_s[0]), times_s=times_s)


def _spoilt(fault: Fault, preview: LeaderPreview, random: np.random.Generator) -> LeaderPreview:
    """Return a prediction whose content is damaged at a random node, the first one excepted."""
    count = preview.times_s.size
    if count < 3:
        return LeaderPreview.empty()
    node = 1 + int(random.integers(count - 2))
    times_s, positions_m = preview.times_s.copy(), preview.positions_m.copy()
    if fault.kind is FaultKind.PREVIEW_UNORDERED:
        times_s[[node, node + 1]] = times_s[[node + 1, node]]
    elif fault.kind is FaultKind.PREVIEW_NAN:
        positions_m[node] = np.nan
    else:
        positions_m[1:] += random.uniform(-fault.magnitude, fault.magnitude)
        np.maximum.accumulate(positions_m, out=positions_m)
    return replace(preview, times_s=times_s, positions_m=positions_m)


def told_leader(
    faults: Iterable[Fault], time_ns: int, leader: LeaderState, host_position_m: float
) -> LeaderState | None:
    """Return what is measured of the leader; the host's position is the true one."""
    told: LeaderState | None = leader
    for fault in at_places(faults, FaultPlace.LEADER):
        if told is None or not fault.hits(time_ns):
            continue
        if fault.kind is FaultKind.LEADER_LOST:
            told = None
        elif fault.kind is FaultKind.LEADER_NAN:
            told = replace(told, speed_m_s=np.nan)
        elif fault.kind is FaultKind.LEADER_OVERLAP:
            told = replace(told, position_m=host_position_m - fault.magnitude)
        else:
            told = replace(told, position_m=told.position_m + _anywhere_m(fault, time_ns))
    return told


def told_state(faults: Iterable[Fault], time_ns: int, state: VehicleState) -> VehicleState:
    """Return what is measured of the host; faults in time (late, repeated) are not seen here."""
    for fault in at_places(faults, FaultPlace.STATE):
        if not fault.hits(time_ns):
            continue
        if fault.kind is FaultKind.STATE_NAN:
            state = replace(state, speed_m_s=np.nan)
        elif fault.kind is FaultKind.STATE_JUMPING:
            state = replace(state, position_m=state.position_m + _anywhere_m(fault, time_ns))
        elif fault.kind is FaultKind.STATE_OVERHEATED:
            hot_k = fault.magnitude + CELSIUS_ZERO_K
            state = replace(state, cell_1_temperature_k=hot_k, cell_n_temperature_k=hot_k)
    return state


def told_slope(faults: Iterable[Fault], time_ns: int, slope: SlopePreview) -> SlopePreview:
    """Return the map of the road as it is told."""
    for fault in at_places(faults, FaultPlace.ROAD):
        if not fault.hits(time_ns):
            continue
        slopes_rad = slope.slopes_rad.copy()
        if fault.kind is FaultKind.SLOPE_NAN:
            slopes_rad[int(fault.random(fault.start_ns).integers(slopes_rad.size))] = np.nan
        else:
            slopes_rad += fault.magnitude
        slope = replace(slope, slopes_rad=slopes_rad)
    return slope


def _anywhere_m(fault: Fault, time_ns: int) -> float:
    return float(fault.random(time_ns).uniform(-fault.magnitude, fault.magnitude))
