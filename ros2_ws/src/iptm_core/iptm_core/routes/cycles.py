"""Driving cycles at 1 Hz, the noise of logged ones, the leader that drives one, and integrals."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from importlib import resources

import numpy as np
from numpy.typing import ArrayLike, NDArray

from iptm_core.errors import RouteError
from iptm_core.state import FloatArray, LeaderState
from iptm_core.units import KM_H_PER_M_S, M_S_PER_MPH


def refuse_where(wrong: NDArray[np.bool_], message: Callable[[int], str]) -> None:
    """Raise a `RouteError` for the first index at which something is wrong."""
    if wrong.any():
        raise RouteError(message(int(np.argmax(wrong))))


def read_only_nodes(
    nodes: ArrayLike, values: ArrayLike, what: str
) -> tuple[FloatArray, FloatArray]:
    """Copy nodes and values, shape (n,) each, into read-only arrays.

    Other shapes, n = 0, values that are not finite and nodes that do not increase are refused.
    """
    x = np.array(nodes, dtype=np.float64)
    y = np.array(values, dtype=np.float64)
    if x.ndim != 1 or y.ndim != 1 or x.size != y.size or x.size == 0:
        raise RouteError(
            f"{what}: shapes {x.shape} and {y.shape}; two equally long, non-empty rows are needed"
        )
    refuse_where(
        ~(np.isfinite(x) & np.isfinite(y)),
        lambda k: f"{what}: node {k} is ({x[k]}, {y[k]}); only finite values are allowed",
    )
    refuse_where(
        np.diff(x) <= 0.0,
        lambda k: (
            f"{what}: node {k + 1} at {x[k + 1]} follows {x[k]}; nodes must strictly increase"
        ),
    )
    x.setflags(write=False)
    y.setflags(write=False)
    return x, y


def cumulative_integral(nodes: FloatArray, values: FloatArray) -> FloatArray:
    """Integrate a piecewise linear function from its first node to every node, shape (n,), read-only."""
    result = np.zeros_like(nodes)
    np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(nodes), out=result[1:])
    result.setflags(write=False)
    return result


def integral_at(
    x: FloatArray, nodes: FloatArray, values: FloatArray, integrals: FloatArray
) -> FloatArray:
    """Return the integral from the first node to points between the nodes, shape of ``x``."""
    if nodes.size == 1:
        return np.zeros_like(x)
    left = nodes.searchsorted(x, side="right") - 1
    left = np.minimum(np.maximum(left, 0), nodes.size - 2)
    tau = x - nodes[left]
    rate = (values[left + 1] - values[left]) / (nodes[left + 1] - nodes[left])
    result: FloatArray = integrals[left] + tau * (values[left] + 0.5 * rate * tau)
    return result


_SOURCES = {
    "nycc": "EPA New York City Cycle, 598 s edition (40 CFR part 86, appendix I)",
    "sc03": "EPA SC03 (40 CFR part 86, appendix I)",
    "us06": "EPA US06 (40 CFR part 86, appendix I)",
    "hwfet": "EPA highway fuel economy test (40 CFR part 600, appendix I)",
    "udds": "EPA urban dynamometer driving schedule (40 CFR part 86, appendix I)",
    "wltc_class3b": "WLTC class 3b (UN Global Technical Regulation No. 15)",
}

CYCLE_NAMES = tuple(_SOURCES)
"""Names of the published cycles for `load_cycle`."""

LOW_SPEED_M_S = 60.0 / KM_H_PER_M_S
HIGH_SPEED_M_S = 120.0 / KM_H_PER_M_S
RAMP_TIME_S = 90.0
"""Duration of the ramp from standstill and of the one back to it."""

_WAVE_TIME_S = 240.0
_MIN_DURATION_S = 360


@dataclass(frozen=True, eq=False)
class DrivingCycle:
    """A speed trace; between its samples speed is linear in time.

    Attributes:
        times_s: 0, 1, 2, ... s, shape (n,), n >= 2.
        speeds_m_s: speeds at these times, shape (n,), never negative.
    """

    name: str
    times_s: FloatArray
    speeds_m_s: FloatArray
    source: str

    def __post_init__(self) -> None:
        times, speeds = read_only_nodes(self.times_s, self.speeds_m_s, f"cycle {self.name}")
        if times.size < 2 or not np.array_equal(times, np.arange(times.size)):
            raise RouteError(
                f"cycle {self.name}: {times.size} samples from {times[0]} s to {times[-1]} s; "
                "at least two samples at 0, 1, 2, ... s are needed"
            )
        refuse_where(
            speeds < 0.0,
            lambda k: f"cycle {self.name}: speed {speeds[k]} m/s at {times[k]} s; allowed: >= 0",
        )
        object.__setattr__(self, "times_s", times)
        object.__setattr__(self, "speeds_m_s", speeds)

    @property
    def duration_s(self) -> float:
        """Time of the last sample."""
        return float(self.times_s[-1])

    @property
    def distance_m(self) -> float:
        """Distance of the whole cycle."""
        return float(self.distances_m()[-1])

    @property
    def max_speed_m_s(self) -> float:
        """Highest speed of the cycle."""
        return float(np.max(self.speeds_m_s))

    def distances_m(self) -> FloatArray:
        """Distance travelled at every sample, shape (n,); the first is 0."""
        return cumulative_integral(self.times_s, self.speeds_m_s)


@cache
def load_cycle(name: str) -> DrivingCycle:
    """Load a published driving cycle, one of `CYCLE_NAMES`."""
    if name not in _SOURCES:
        raise RouteError(f"unknown driving cycle {name!r}; allowed: {', '.join(CYCLE_NAMES)}")
    file = resources.files("iptm_core.routes") / "data" / f"{name}.csv"
    header, *rows = file.read_text(encoding="utf-8").split()
    times_s, speeds = np.array([row.split(",") for row in rows], dtype=float).T
    unit_m_s = {"time_s,speed_mph": M_S_PER_MPH, "time_s,speed_kmh": 1.0 / KM_H_PER_M_S}[header]
    return DrivingCycle(name, times_s, speeds * unit_m_s, _SOURCES[name])


def smooth_cycle(
    duration_s: int, low_m_s: float = LOW_SPEED_M_S, high_m_s: float = HIGH_SPEED_M_S
) -> DrivingCycle:
    """Build the smooth cycle.

    Cosine ramps lead from standstill to the low speed and back (60 km/h: peak 0.29 m/s^2); between them
    speed swings as a cosine between the low and the high one, in whole periods of about four minutes.

    It stands at its first and last sample, and stays below 0.3 m/s^2 for all durations at 60 and 120 km/h.

    Args:
        duration_s: whole seconds, at least 360.
    """
    if int(duration_s) != duration_s or duration_s < _MIN_DURATION_S:
        raise RouteError(
            f"smooth cycle of {duration_s} s; allowed: whole seconds, at least {_MIN_DURATION_S}"
        )
    times = np.arange(int(duration_s) + 1, dtype=np.float64)
    cruise = duration_s - 2.0 * RAMP_TIME_S
    period = cruise / max(1, round(cruise / _WAVE_TIME_S))
    swing = 0.5 * (high_m_s - low_m_s)
    waves = low_m_s + swing * (1.0 - np.cos(2.0 * np.pi * (times - RAMP_TIME_S) / period))
    to_end = np.minimum(times, duration_s - times)
    ramp = 0.5 * low_m_s * (1.0 - np.cos(np.pi * to_end / RAMP_TIME_S))
    speeds = np.where(to_end < RAMP_TIME_S, ramp, waves)
    low_km_h, high_km_h = KM_H_PER_M_S * low_m_s, KM_H_PER_M_S * high_m_s
    source = f"made for this project: slow ramps between {low_km_h:g} and {high_km_h:g} km/h"
    return DrivingCycle("smooth", times, speeds, source)


FINAL_BRAKING_M_S2 = 1.5
"""Deceleration with which a leader stops whose trace ends while it still moves."""

_MIN_BRAKING_S = 1e-3


@dataclass(frozen=True, eq=False)
class LeaderMotion:
    """Position and speed of the preceding vehicle at any time.

    Speed is linear between the nodes, so that position is the exact parabola of its integral.
    Before the first node the leader stands at its start; after the last node it stands at its
    last position. Build it with `from_cycle`, which makes the last node a standstill.

    Attributes:
        times_s: node times, shape (n,), increasing.
        speeds_m_s: speeds at the nodes, shape (n,), never negative, the last one 0.
        start_position_m: rear-bumper position before the first node; the initial gap.
        positions_m: positions at the nodes, shape (n,); follows from the others.
    """

    times_s: FloatArray
    speeds_m_s: FloatArray
    start_position_m: float
    positions_m: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        times, speeds = read_only_nodes(self.times_s, self.speeds_m_s, "motion of the leader")
        refuse_where(
            speeds < 0.0,
            lambda k: f"motion of the leader: speed {speeds[k]} m/s at {times[k]} s; allowed: >= 0",
        )
        if speeds[-1] != 0.0:
            raise RouteError(f"motion of the leader: it ends at {speeds[-1]} m/s; allowed: 0")
        if not np.isfinite(self.start_position_m):
            raise RouteError(
                f"motion of the leader: start at {self.start_position_m} m; must be finite"
            )
        positions = self.start_position_m + cumulative_integral(times, speeds)
        positions.setflags(write=False)
        object.__setattr__(self, "times_s", times)
        object.__setattr__(self, "speeds_m_s", speeds)
        object.__setattr__(self, "positions_m", positions)

    @classmethod
    def from_cycle(cls, cycle: DrivingCycle, initial_gap_m: float) -> LeaderMotion:
        """Let the leader drive a cycle.

        If the cycle ends while the leader still moves, it brakes to a standstill with
        `FINAL_BRAKING_M_S2` after the last sample.

        Args:
            initial_gap_m: position of its rear bumper at t = 0, where the ego vehicle starts at 0 m.
        """
        times, speeds = cycle.times_s, cycle.speeds_m_s
        if speeds[-1] > 0.0:
            # The floor keeps the node distinct from the last sample at a vanishing speed.
            braking_s = max(float(speeds[-1]) / FINAL_BRAKING_M_S2, _MIN_BRAKING_S)
            times = np.append(times, times[-1] + braking_s)
            speeds = np.append(speeds, 0.0)
        return cls(times, speeds, float(initial_gap_m))

    def speeds_at(self, times_s: ArrayLike) -> FloatArray:
        """Speeds in m/s at any times, same shape as ``times_s``."""
        times = np.asarray(times_s, dtype=np.float64)
        return np.interp(times, self.times_s, self.speeds_m_s, left=0.0, right=0.0)

    def positions_at(self, times_s: ArrayLike) -> FloatArray:
        """Rear-bumper positions in m at any times, same shape as ``times_s``."""
        times = np.maximum(np.asarray(times_s, dtype=np.float64), self.times_s[0])
        times = np.minimum(times, self.times_s[-1])
        return integral_at(times, self.times_s, self.speeds_m_s, self.positions_m)

    def motion_at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions and speeds at increasing times, shape (n,) each."""
        known_s = self._lists[0]
        if not known_s[0] <= times_s.item(0) <= times_s.item(-1) < known_s[-1]:
            return self.positions_at(times_s), self.speeds_at(times_s)
        left = self.times_s.searchsorted(times_s, side="right") - 1
        starts_s, speeds, positions, rates = self._nodes.take(left, axis=0).T
        tau = times_s - starts_s
        return positions + tau * (speeds + 0.5 * rates * tau), rates * tau + speeds

    @cached_property
    def _nodes(self) -> FloatArray:
        """Times, speeds, positions and accelerations at the starts of the intervals, shape (n - 1, 4)."""
        rates = np.diff(self.speeds_m_s) / np.diff(self.times_s)
        starts = self.times_s[:-1], self.speeds_m_s[:-1], self.positions_m[:-1]
        return np.column_stack([*starts, rates])

    def state_at(self, time_s: float) -> LeaderState:
        """Position and speed at one instant."""
        times_s, speeds_m_s, positions_m = self._lists
        if not times_s[0] <= time_s < times_s[-1]:
            return LeaderState(
                float(time_s), float(self.positions_at(time_s)), float(self.speeds_at(time_s))
            )
        left = bisect_right(times_s, time_s) - 1
        tau, speed = time_s - times_s[left], speeds_m_s[left]
        rate = (speeds_m_s[left + 1] - speed) / (times_s[left + 1] - times_s[left])
        position = positions_m[left] + tau * (speed + 0.5 * rate * tau)
        return LeaderState(float(time_s), position, rate * tau + speed)

    @cached_property
    def _lists(self) -> tuple[list[float], list[float], list[float]]:
        return self.times_s.tolist(), self.speeds_m_s.tolist(), self.positions_m.tolist()


NOTED_NOISE_M_S = 0.14
"""Noise from which a drive has a note: above the published cycles, 0.02 to 0.12 m/s, and below a logger with
0.6 km/h."""
_MEDIAN_OF_NORMAL = 0.6745
_MOVING_M_S = 1.0


def speed_noise_m_s(cycle: DrivingCycle) -> float:
    """Return the standard deviation of white noise in the speeds of a drive, in m/s; 0 for one that stands.

    From the median of the third differences while it moves: noise with standard deviation s gives them
    sqrt(20) s, and a driver keeps them small.
    """
    speeds = cycle.speeds_m_s
    thirds = np.abs(np.diff(speeds, 3))
    moving = thirds[np.minimum(speeds[3:], speeds[:-3]) > _MOVING_M_S]
    return float(np.median(moving)) / _MEDIAN_OF_NORMAL / 20.0**0.5 if moving.size else 0.0


def smoothed(cycle: DrivingCycle, width_s: float) -> DrivingCycle:
    """Return a drive with the speeds of parabolas fitted around them, of the same length and distance.

    Args:
        cycle: the drive.
        width_s: of the window; it is narrower near the ends of the drive and of each stop, which stay. Below
            5 s there is nothing to fit. Windows of 5, 9 and 15 s leave 70, 50 and 39 % of white noise.
    """
    speeds = cycle.speeds_m_s
    reach = int(0.5 * width_s)
    if reach < 2:
        return cycle
    stands = np.concatenate(([True], speeds == 0.0, [True]))
    rows = np.arange(speeds.size)
    edges = np.flatnonzero(stands) - 1
    before = rows - edges[np.searchsorted(edges, rows, side="right") - 1]
    after = edges[np.searchsorted(edges, rows, side="left")] - rows
    inside = np.minimum(rows, rows[::-1])
    reaches = np.minimum(np.minimum(reach, inside), np.minimum(before, after))
    fitted = speeds.copy()
    for around in range(2, reach + 1):
        here = np.flatnonzero(reaches == around)
        offsets = np.arange(-around, around + 1)
        # Weights of the middle of a parabola fitted to equidistant values (Savitzky and Golay 1964).
        weights = 3.0 * (3 * around**2 + 3 * around - 1 - 5 * offsets**2)
        weights /= (2 * around - 1) * (2 * around + 1) * (2 * around + 3)
        fitted[here] = np.maximum(speeds[here[:, None] + offsets] @ weights, 0.0)
    plain = replace(cycle, speeds_m_s=fitted)
    share = cycle.distance_m / plain.distance_m if plain.distance_m > 0.0 else 1.0
    return replace(plain, speeds_m_s=share * fitted)
