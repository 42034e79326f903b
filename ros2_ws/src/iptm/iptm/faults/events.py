"""Events on the road, one class per kind: each turns a lead vehicle and its previews into others.

A preview made before an event began does not contain it.

Cars that cut in at random do so the more often the larger the gap that the ego vehicle leaves. No published
table has the rate per gap. It is composed of a published rate and a published gap acceptance, in two
independent ways:

- `BY_ROOM`: 12.4 per 100 km, 5600 lane changes on 45,000 km (highD: Krajewski et al., ITSC 2018), and the
  critical gaps of discretionary changes by Ahmed (thesis, MIT 1999, as in MITSIMLab), which depend on
  relative speed. Cars beside the gap are spread evenly: the rate grows with the length where one would fit.
- `BY_HEADWAY`: 7.2 per 100 km, one in 8.6 miles of heavy traffic (AAA, 2025), and critical gaps of 1.00 s,
  standard deviation 0.24 s, ahead and behind (Goswami and Bham, TRB 2007, I-80). The rate grows with the
  share of drivers who accept the gap, and no more once all do.

Assumed: each rate is the mean over the gaps of other traffic (`TRAFFIC_GAP_S`) at `REFERENCE_M_S`, and the
car directly ahead leaves the lane again as often as that.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from iptm_core.frozen import replace
from iptm_core.settings import VEHICLE_LENGTH_M
from iptm_core.state import NS_PER_S, FloatArray, LeaderPreview, LeaderState

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


TRAFFIC_GAP_S, TRAFFIC_SPREAD = 1.84, 0.35
"""Median time gap of the measured cars of OpenACC above 5 m/s, and standard deviation of its logarithm."""
REFERENCE_M_S = 25.0
_QUANTILES = 25

CriticalGaps = Callable[[float, float, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
"""Smallest gaps in m that drivers accept ahead and behind: from the speeds in m/s of the ego vehicle and of
the car that cuts in, and a standard normal number for each gap."""


def _by_distance(
    ego_m_s: float, other_m_s: float, ahead: FloatArray, behind: FloatArray
) -> tuple[FloatArray, FloatArray]:
    # The car drives as the one ahead of it, so the term of their relative speed is zero.
    faster = ego_m_s - other_m_s
    lag = 2.020 + 0.153 * min(faster, 0.0) + 0.188 * max(faster, 0.0)
    return np.exp(0.508 + 0.488 * ahead), np.exp(lag + 0.526 * behind)


def _by_time(
    ego_m_s: float, other_m_s: float, ahead: FloatArray, behind: FloatArray
) -> tuple[FloatArray, FloatArray]:
    spread = math.sqrt(math.log1p((0.244 / 1.002) ** 2))
    median_s = 1.002 * math.exp(-0.5 * spread**2)
    lead_s, lag_s = (median_s * np.exp(spread * drawn) for drawn in (ahead, behind))
    return lead_s * other_m_s, lag_s * ego_m_s


@dataclass(frozen=True)
class CutInLaw:
    """How often cars cut in, relative to the mean rate, and where.

    Attributes:
        critical_gaps: what drivers accept.
        by_room: whether the rate grows with the room that is left, not with the share who accept it.
    """

    critical_gaps: CriticalGaps
    by_room: bool

    def room_m(
        self,
        gap_m: float | FloatArray,
        ego_m_s: float,
        other_m_s: float,
        ahead: FloatArray,
        behind: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the length of road on which a car fits, negative for none, and where it begins, in m.

        Args:
            gap_m: from the ego vehicle's front to the rear end of the car ahead.
            ego_m_s: speed of the ego vehicle.
            other_m_s: speed of the car ahead, and of the one that cuts in.
            ahead: standard normal number per driver.
            behind: another one.
        """
        lead_m, lag_m = self.critical_gaps(ego_m_s, other_m_s, ahead, behind)
        return gap_m - VEHICLE_LENGTH_M - lead_m - lag_m, lag_m

    def share(self, room_m: FloatArray, ego_m_s: float) -> FloatArray:
        """Return the rate at a room, relative to the one of cars that would always fit."""
        if not self.by_room:
            return (room_m > 0.0).astype(np.float64)
        mean_gap_s = TRAFFIC_GAP_S * math.exp(0.5 * TRAFFIC_SPREAD**2)
        return np.maximum(room_m, 0.0) / (VEHICLE_LENGTH_M + mean_gap_s * ego_m_s)


BY_ROOM = CutInLaw(_by_distance, by_room=True)
BY_HEADWAY = CutInLaw(_by_time, by_room=False)


@cache
def mean_share(law: CutInLaw) -> float:
    """Return the mean of `CutInLaw.share` over the gaps of other traffic at `REFERENCE_M_S`."""
    levels = (np.arange(_QUANTILES) + 0.5) / _QUANTILES
    normal = np.array([NormalDist().inv_cdf(level) for level in levels.tolist()])
    gaps, ahead, behind = np.meshgrid(normal, normal, normal)
    gap_m = TRAFFIC_GAP_S * np.exp(TRAFFIC_SPREAD * gaps) * REFERENCE_M_S
    room_m, _ = law.room_m(gap_m, REFERENCE_M_S, REFERENCE_M_S, ahead, behind)
    return float(law.share(room_m, REFERENCE_M_S).mean())


class CutIns(Gone):
    """Cars cut in by a law, once a second at most, and leave; each drives as the leader of the route does."""

    def __init__(self, fault: Fault, law: CutInLaw) -> None:
        super().__init__(fault)
        self._law = law
        self._shifts_m: tuple[float, ...] = ()
        """Distances from the leader of the route to the cars between, the nearest to the ego vehicle last."""
        self._last: tuple[float, float] | None = None
        """Time and place of the ego vehicle when cars could last cut in."""
        self._past: tuple[tuple[float, float], ...] = ()
        """Times and distances of the cars that were directly ahead."""

    def leader(self, own: LeaderState, ego_position_m: float) -> LeaderState:
        """Return the leader that counts; ticks in increasing order of time."""
        if self._last is not None and own.time_s < self._last[0]:
            self._last, self._shifts_m, self._past = None, (), ()
        if self._last is None or own.time_s >= self._last[0] + 1.0 - 1e-9:
            if self._last is not None and self._is_there(own.time_s):
                self._advance(own, ego_position_m, *self._last)
            self._last = own.time_s, ego_position_m
        return replace(own, position_m=own.position_m + self._at(own.time_s))

    def _is_there(self, time_s: float) -> bool:
        return super()._is_there(time_s) and time_s < self._fault.end_s

    def _at(self, time_s: float) -> float:
        if not self._is_there(time_s):
            return 0.0
        return next((shift for since_s, shift in reversed(self._past) if since_s <= time_s), 0.0)

    def _advance(
        self, own: LeaderState, ego_m: float, before_s: float, ego_before_m: float
    ) -> None:
        """Let the car directly ahead leave, or another one cut in, or neither."""
        way_m = max(ego_m - ego_before_m, 0.0)
        ego_m_s = way_m / (own.time_s - before_s)
        random = self._fault.random(round(own.time_s * NS_PER_S))
        leaves, enters, place = random.random(3).tolist()
        ahead, behind = random.standard_normal((2, 1))
        expected = way_m * self._fault.magnitude / 1e5
        shift_m = self._shifts_m[-1] if self._shifts_m else 0.0
        gap_m = own.position_m + shift_m - ego_m
        room_m, lag_m = self._law.room_m(gap_m, ego_m_s, own.speed_m_s, ahead, behind)
        rate = float(self._law.share(room_m, ego_m_s)[0]) / mean_share(self._law)
        if self._shifts_m and leaves < -math.expm1(-expected):
            self._shifts_m = self._shifts_m[:-1]
        elif enters < -math.expm1(-expected * rate):
            rear_m = ego_m + float(lag_m[0] + place * room_m[0])
            self._shifts_m = (*self._shifts_m, rear_m - own.position_m)
        else:
            return
        shift_m = self._shifts_m[-1] if self._shifts_m else 0.0
        past = self._past
        while len(past) > 1 and past[1][0] < own.time_s - REMEMBERED_S:
            past = past[1:]
        self._past = (*past, (own.time_s, shift_m))
