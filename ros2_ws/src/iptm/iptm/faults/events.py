"""Events on the road, one class per kind: each turns a lead vehicle and its previews into others.

A preview made before an event began does not contain it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from iptm_core.state import NS_PER_S, LeaderPreview, LeaderState

if TYPE_CHECKING:
    from iptm.faults.fault import Fault

DRIVE_OFF_M_S2 = 2.0
"""Acceleration of a lead vehicle that drives off after a hard stop."""

REMEMBERED_S = 300.0
"""Age in s up to which a preview may contain a hard stop; older motion is discarded."""


class Gone:
    """The lead vehicle turns off; the next one drives as it did, the size farther on, for good."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault
        self._shift_m: float | None = None

    def leader(self, own: LeaderState, ego_position_m: float) -> LeaderState:
        """Return the leader that counts; ticks in increasing order of time."""
        if self._shift_m is None and self._is_there(own.time_s):
            self._shift_m = self._first_shift_m(own, ego_position_m)
        return replace(own, position_m=own.position_m + self._at(own.time_s))

    def preview(self, own: LeaderPreview) -> LeaderPreview:
        """Return its preview: it does not announce that it will leave."""
        shift_m = self._at(own.generated_at_s)
        return replace(own, positions_m=own.positions_m + shift_m) if shift_m else own

    def _first_shift_m(self, own: LeaderState, ego_position_m: float) -> float:
        del own, ego_position_m
        return self._fault.magnitude

    def _is_there(self, time_s: float) -> bool:
        return time_s >= self._fault.start_s

    def _at(self, time_s: float) -> float:
        return (self._shift_m or 0.0) if self._is_there(time_s) else 0.0


class CutIn(Gone):
    """A vehicle of the lead vehicle's speed comes in between, the size ahead of the ego vehicle, and goes."""

    def _first_shift_m(self, own: LeaderState, ego_position_m: float) -> float:
        return min(ego_position_m + self._fault.magnitude - own.position_m, 0.0)

    def _is_there(self, time_s: float) -> bool:
        return super()._is_there(time_s) and time_s < self._fault.end_s


@dataclass(frozen=True)
class _Stopping:
    """Motion of a leader in a hard stop; `apart` while it does not drive as its own does."""

    time_s: float
    position_m: float
    speed_m_s: float
    own_position_m: float
    apart: bool


class HardStop:
    """A leader that brakes to a standstill, stands, and drives off until it has its own speed again.

    Its previews contain the stop from its beginning on.
    """

    def __init__(self, fault: Fault) -> None:
        self._fault = fault
        self._past: dict[int, _Stopping] = {}
        self._now: _Stopping | None = None

    def leader(self, own: LeaderState, ego_position_m: float) -> LeaderState:  # noqa: ARG002
        """Return the leader that counts; ticks in increasing order of time."""
        if own.time_s < self._fault.start_s:
            return own
        if self._now is None or own.time_s < self._now.time_s:
            self._now = _Stopping(
                own.time_s, own.position_m, own.speed_m_s, own.position_m, apart=True
            )
            self._past.clear()
        elif own.time_s > self._now.time_s:
            self._now = self._advance(
                self._now,
                own.time_s,
                own.position_m,
                own.speed_m_s,
                braking=self._now.time_s < self._fault.end_s,
            )
        self._past[_ns(own.time_s)] = self._now
        while next(iter(self._past)) < _ns(own.time_s - REMEMBERED_S):
            del self._past[next(iter(self._past))]
        return LeaderState(own.time_s, self._now.position_m, self._now.speed_m_s)

    def preview(self, own: LeaderPreview) -> LeaderPreview:
        """Return its preview: the motion to come, braking included."""
        motion = self._past.get(_ns(own.generated_at_s)) if own.times_s.size else None
        if motion is None:
            return own
        if not motion.apart:
            shift_m = motion.position_m - motion.own_position_m
            return replace(own, positions_m=own.positions_m + shift_m)
        positions, speeds = [motion.position_m], [motion.speed_m_s]
        nodes = zip(
            own.times_s[1:].tolist(),
            own.positions_m[1:].tolist(),
            own.speeds_m_s[1:].tolist(),
            strict=True,
        )
        for node in nodes:
            motion = self._advance(motion, *node, braking=self._announces_braking(motion.time_s))
            positions.append(motion.position_m)
            speeds.append(motion.speed_m_s)
        return replace(own, positions_m=np.array(positions), speeds_m_s=np.array(speeds))

    def _announces_braking(self, time_s: float) -> bool:
        """Return whether a preview has the lead vehicle braking at an instant."""
        return time_s < self._fault.end_s

    def _advance(
        self,
        motion: _Stopping,
        time_s: float,
        own_position_m: float,
        own_speed_m_s: float,
        *,
        braking: bool,
    ) -> _Stopping:
        """Return the motion at a later instant at which the own leader is known."""
        if not motion.apart:
            moved_m = own_position_m - motion.own_position_m
            return _Stopping(
                time_s, motion.position_m + moved_m, own_speed_m_s, own_position_m, apart=False
            )
        interval_s, speed = time_s - motion.time_s, motion.speed_m_s
        if braking:
            moving_s = min(interval_s, speed / self._fault.magnitude)
            ahead = speed - self._fault.magnitude * moving_s
            ahead = 0.0 if moving_s < interval_s else max(ahead, 0.0)
            position_m = motion.position_m + 0.5 * (speed + ahead) * moving_s
            return _Stopping(time_s, position_m, ahead, own_position_m, apart=True)
        ahead = min(own_speed_m_s, speed + DRIVE_OFF_M_S2 * interval_s)
        ahead = max(ahead, speed - self._fault.magnitude * interval_s)
        position_m = motion.position_m + 0.5 * (speed + ahead) * interval_s
        apart = ahead != own_speed_m_s
        return _Stopping(time_s, position_m, ahead, own_position_m, apart=apart)


class UnannouncedHardStop(HardStop):
    """A hard stop that no preview announces: each one starts as measured and returns to the usual drive."""

    def _announces_braking(self, time_s: float) -> bool:
        del time_s
        return False


TrafficEvent = Gone | HardStop
"""Behaviour of the lead vehicle."""


def _ns(time_s: float) -> int:
    return round(time_s * NS_PER_S) if np.isfinite(time_s) else -1
