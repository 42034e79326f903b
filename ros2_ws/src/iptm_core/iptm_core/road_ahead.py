"""Rules of the road ahead: speed limits over position, and places not to be passed before an instant.

A rule of the road is an upper bound and no vehicle. Limits of signs, curves, the set speed of the driver and
the end of the route are speeds over position; a closed stop line is a position over time.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from iptm_core.declaration import Settings, parameter
from iptm_core.errors import ParameterError, RouteError
from iptm_core.routes.cycles import LeaderMotion
from iptm_core.routes.road_line import RoadLine, east_north_m
from iptm_core.settings import LeaderSource
from iptm_core.state import FloatArray
from iptm_core.units import KM_H_PER_M_S


@dataclass(frozen=True)
class LeaderSourceSettings(Settings):
    """Source of the lead vehicle."""

    leader_source: LeaderSource = parameter(
        LeaderSource.CYCLE,
        "cycle: the leader drives the cycle; cam: it is observed by the messages that arrive; vehicle: it is "
        "vehicle_ahead, whose plans are the previews; range_sensor: it is measured, alone or together with "
        "its messages (range_sensor_and_cam), in a simulation by the plant, whose leader drives the cycle; "
        "none: the road is empty; with cam, vehicle and none the cycle gives the road only",
    )


@dataclass(frozen=True)
class RoadRuleSettings(Settings):
    """Rules of the road for the ego vehicle."""

    ego_keeps_rules: bool = parameter(
        default=False,
        description="with a leader: the ego keeps speed limits and signals where they are stricter, and "
        "drives on where none is observed; without one it always does",
    )
    set_speed_km_h: float = parameter(
        0.0,
        "set speed of the driver where rules are kept, 0 for none",
        "km/h",
        0.0,
        250.0,
    )
    speed_limits_km_h: str = parameter(
        "",
        "speed limits of the road, <from metre>:<km/h> parts, e.g. '0:50, 1200:70'; cycle: between two halts "
        "the lowest usual limit that the cycle keeps",
    )
    signals: str = parameter(
        "",
        "signals of the road with plans that repeat themselves, <metre of the stop line>:<cycle in s>:"
        "<s of trip time, with cam of TimestampIts, at which it turns green>:<s for which it is green> parts",
    )
    line_foresight_s: float = parameter(
        60.0, "stop lines that the ego vehicle reaches later are not looked at", "s", 1.0, 3600.0
    )
    max_lateral_acceleration_m_s2: float = parameter(
        2.0, "where rules are kept, curves are passed with this at most", "m/s^2", 0.1, 10.0
    )


@dataclass(frozen=True)
class RoadAheadSettings(RoadRuleSettings, LeaderSourceSettings):
    """The road ahead: the leader, and the rules of the road."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.keeps_rules and not (self.speed_limits_km_h.strip() or self.set_speed_km_h):
            why = "leader_source none" if not self.ego_keeps_rules else "ego_keeps_rules"
            raise ParameterError(
                f"speed_limits_km_h is empty and set_speed_km_h is 0 with {why}; allowed: one of them stated"
            )

    @property
    def keeps_rules(self) -> bool:
        """Whether the rules of the road bind the ego vehicle."""
        return self.ego_keeps_rules or self.leader_source is LeaderSource.NONE


BRAKING_M_S2 = 1.0
"""Deceleration with which drivers come down to a lower limit."""
START_M_S2 = 1.0
"""Acceleration with which drivers come up to a limit."""
HARDEST_M_S2 = 1.8
"""Deceleration for a stop that leaves no room for comfort."""


@dataclass(frozen=True, eq=False)
class SpeedLimits:
    """Limits along the road.

    Attributes:
        starts_m: where each limit begins, shape (n,), increasing; the first also holds before it.
        limits_m_s: the limits, shape (n,), above 0.
    """

    starts_m: FloatArray
    limits_m_s: FloatArray
    _starts: tuple[float, ...] = field(init=False, repr=False)
    _limits: tuple[float, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        fits = self.starts_m.size and self.starts_m.shape == self.limits_m_s.shape
        # "Not above" is not the same as "at most": NaN is neither.
        rising = fits and np.all(np.diff(self.starts_m) > 0.0)
        if not rising or not np.all(self.limits_m_s > 0.0):
            raise RouteError(
                f"speed limits: {self.starts_m.size} starts, {self.limits_m_s.size} limits; "
                "allowed: equal numbers from 1, increasing starts, limits above 0"
            )
        # The same as plain numbers, for single positions.
        object.__setattr__(self, "_starts", tuple(self.starts_m.tolist()))
        object.__setattr__(self, "_limits", tuple(self.limits_m_s.tolist()))

    def at_m_s(self, positions_m: FloatArray) -> FloatArray:
        """Return the limits that hold at positions, shape of them."""
        index = np.searchsorted(self.starts_m, positions_m, side="right") - 1
        limits: FloatArray = self.limits_m_s[np.maximum(index, 0)]
        return limits

    def approach_at_m_s(self, position_m: float) -> float:
        """Return the speed with which a position can be passed, lower limits ahead kept in mind."""
        starts, limits = self._starts, self._limits
        here = max(bisect_right(starts, position_m) - 1, 0)
        allowed = limits[here]
        for start, limit in zip(starts[here + 1 :], limits[here + 1 :], strict=True):
            ahead = start - position_m
            if 2.0 * BRAKING_M_S2 * ahead >= allowed * allowed:
                break
            allowed = min(allowed, math.sqrt(limit * limit + 2.0 * BRAKING_M_S2 * ahead))
        return allowed

    def and_not_above(self, other: SpeedLimits) -> SpeedLimits:
        """Return the lower one of two limits everywhere."""
        starts = np.union1d(self.starts_m, other.starts_m)
        return SpeedLimits(starts, np.minimum(self.at_m_s(starts), other.at_m_s(starts)))

    def between(self, from_m: float, to_m: float) -> SpeedLimits:
        """Return what holds on a part of the road; its first and last limits hold beyond the part."""
        first = max(bisect_right(self._starts, from_m) - 1, 0)
        last = max(bisect_right(self._starts, to_m), first + 1)
        return SpeedLimits(self.starts_m[first:last], self.limits_m_s[first:last])


@dataclass(frozen=True)
class Stop:
    """A place that the front of the ego vehicle does not pass before an instant.

    Attributes:
        position_m: where it halts at the latest.
        until_s: trip time at which it opens; infinite if it never is.
    """

    position_m: float
    until_s: float


@dataclass(frozen=True, eq=False)
class RoadAhead:
    """Upper bounds of motion at one instant, vehicles apart.

    Attributes:
        has_leader: whether a lead vehicle is observed, whose motion is reported apart from this.
        limits: speed limits, None without known rules of the road; then it has no stops either.
        stops: in driving order.
    """

    has_leader: bool
    limits: SpeedLimits | None = None
    stops: tuple[Stop, ...] = ()


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """A motion in equal steps, its first node the present: arrays of shape (n,)."""

    times_s: FloatArray
    positions_m: FloatArray
    speeds_m_s: FloatArray


def lawful_drive(
    limits: SpeedLimits,
    stops: Sequence[Stop],
    start: tuple[float, float, float],
    steps: int,
    step_s: float,
    room_m: FloatArray | None = None,
    headway_s: float = 0.0,
) -> SampledMotion:
    """Return how an attentive driver drives: at the limits, with comfort, and never past a stop.

    Args:
        stops: that hold the vehicle, in driving order, none behind it.
        room_m: where a lead vehicle lets the front of this one stand at the nodes, shape (steps + 1,).
    """
    now_s, position, speed = start
    begin_m, begin_m_s = position, speed
    positions, speeds = [position], [speed]
    for number in range(1, steps + 1):
        time_s = now_s + number * step_s
        allowed = limits.approach_at_m_s(position + speed * step_s)
        aimed = min(speed + START_M_S2 * step_s, allowed)
        stop = next((stop for stop in stops if stop.until_s > time_s), None)
        stop_m = math.inf
        if stop is not None:
            stop_m = max(stop.position_m, position)
            # What is to be braked for at once may take more than comfort.
            distance_m = max(stop_m - begin_m, 0.1)
            braking = max(BRAKING_M_S2, 0.5 * begin_m_s**2 / distance_m)
            rest_m = max(stop_m - position - 0.5 * speed * step_s, 0.0)
            aimed = min(aimed, math.sqrt(2.0 * braking * rest_m))
        if room_m is not None and room_m[number] < math.inf:
            aimed = min(aimed, max(float(room_m[number]) - position, 0.0) / headway_s)
        aimed = max(aimed, speed - HARDEST_M_S2 * step_s, 0.0)
        position += min(0.5 * step_s * (speed + aimed), stop_m - position)
        speed = aimed
        positions.append(position)
        speeds.append(speed)
    times: FloatArray = now_s + step_s * np.arange(steps + 1, dtype=np.float64)
    return SampledMotion(times, np.array(positions), np.array(speeds))


LEGAL_KM_H = (30.0, 50.0, 60.0, 80.0, 100.0, 130.0)
"""Usual limits of towns, country roads and motorways."""
KEPT_WITHIN = 1.03
"""A limit is kept up to this share of it: WLTC reaches 131.3 km/h."""
HALT_M_S = 0.1
CURVE_CHORD_M = 25.0
"""Distance of the three points through which the circle of a curve is laid."""
CURVE_SPACING_M = 10.0
STRAIGHT_M_S = 60.0
"""Curves that allow more than this, beyond the speed of any car of the project, are not limits."""


def limits_of_drive(motion: LeaderMotion) -> SpeedLimits:
    """Return the limits of a road as a drive on it suggests them.

    Between two halts the limit is the lowest of `LEGAL_KM_H` that the drive keeps there; the parts of the
    published cycles are made for such classes of roads.
    """
    halted = motion.speeds_m_s <= HALT_M_S
    begins = np.flatnonzero(halted[:-1] & ~halted[1:])
    if not begins.size or (begins[0] > 0 and not halted[0]):
        begins = np.concatenate([[0], begins])
    fastest = np.maximum.reduceat(motion.speeds_m_s, begins)
    legal = np.array(LEGAL_KM_H) / KM_H_PER_M_S
    above = np.minimum(np.searchsorted(KEPT_WITHIN * legal, fastest), legal.size - 1)
    return SpeedLimits(motion.positions_m[begins], legal[above])


def limits_of_curves(
    line: RoadLine,
    lateral_m_s2: float,
    chord_m: float = CURVE_CHORD_M,
    spacing_m: float = CURVE_SPACING_M,
) -> SpeedLimits:
    """Return the speeds with which the curves of a road take a lateral acceleration.

    The radius belongs to the circle through three points of the line (Menger's curvature), so a bend counts
    also on the road around it.

    Args:
        lateral_m_s2: largest lateral acceleration, above 0.
    """
    _, _, headings = line.locate(line.positions_m)
    if np.all(headings == headings[0]):
        return SpeedLimits(np.zeros(1), np.full(1, STRAIGHT_M_S))
    places: FloatArray = np.arange(0.0, line.length_m + spacing_m, spacing_m).astype(np.float64)
    latitudes, longitudes, _ = line.locate(places)
    origin = (latitudes, longitudes)
    before_e, before_n = east_north_m(*line.locate(places - chord_m)[:2], origin)
    after_e, after_n = east_north_m(*line.locate(places + chord_m)[:2], origin)
    doubled_area = np.abs(before_e * after_n - before_n * after_e)
    sides = np.hypot(before_e, before_n) * np.hypot(after_e, after_n)
    sides *= np.hypot(after_e - before_e, after_n - before_n)
    curvature = 2.0 * doubled_area / np.maximum(sides, 1e-9)
    speeds = np.minimum(np.sqrt(lateral_m_s2 / np.maximum(curvature, 1e-9)), STRAIGHT_M_S)
    changes = np.concatenate([[True], np.diff(speeds) != 0.0])
    return SpeedLimits(places[changes], speeds[changes])
