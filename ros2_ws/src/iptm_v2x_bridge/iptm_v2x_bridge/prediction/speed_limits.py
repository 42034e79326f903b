"""A prediction bounded by the speed limits of the road ahead."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field, replace

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.state import FloatArray
from iptm_v2x_bridge.prediction.predictor import (
    ErrorGrowth,
    Knowledge,
    Prediction,
    Predictor,
    PredictorName,
)

BRAKING_M_S2 = 1.0
"""Deceleration with which drivers come down to a lower limit."""
_STEP_S = 0.25
GROWTH = ErrorGrowth(
    (0.0, 0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0, 60.0),
    (0.02, 0.03, 0.07, 0.26, 0.65, 1.3, 3.5, 12.6, 56.0, 192.0, 491.0, 727.0),
)


@dataclass(frozen=True, eq=False)
class SpeedLimits:
    """Limits along the road.

    Attributes:
        starts_m: where each limit begins, shape (n,), increasing; the first holds before it, too.
        limits_m_s: the limits, shape (n,), above 0.

    Raises:
        RouteError: malformed arrays.
    """

    starts_m: FloatArray
    limits_m_s: FloatArray
    _starts: tuple[float, ...] = field(init=False, repr=False)
    _limits: tuple[float, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        fits = self.starts_m.size and self.starts_m.shape == self.limits_m_s.shape
        if not fits or np.any(np.diff(self.starts_m) <= 0.0) or np.any(self.limits_m_s <= 0.0):
            raise RouteError(
                f"speed limits: {self.starts_m.size} starts, {self.limits_m_s.size} limits; "
                "allowed: equal numbers from 1, increasing starts, limits above 0"
            )
        # The same as plain numbers, for single positions.
        object.__setattr__(self, "_starts", tuple(self.starts_m.tolist()))
        object.__setattr__(self, "_limits", tuple(self.limits_m_s.tolist()))

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


NO_LIMITS = SpeedLimits(np.zeros(1), np.full(1, 70.0))
"""For a road of which no limit is known: no car is faster."""


class BoundedBySpeedLimits:
    """Takes another prediction and keeps it within the limits of the road."""

    def __init__(self, inner: Predictor, limits: SpeedLimits) -> None:
        self._inner, self._limits = inner, limits

    def predict(self, known: Knowledge, times_s: FloatArray) -> Prediction | None:
        """Return the bounded motion; speeds above a limit are taken to be the driver's habit."""
        last = known.last
        end_s = float(times_s[-1])
        count = int(np.ceil(max(end_s - last.time_s, 0.0) / _STEP_S)) + 1
        fine: FloatArray = last.time_s + _STEP_S * np.arange(count + 1, dtype=np.float64)
        free = self._inner.predict(known, fine)
        if free is None:
            return None
        # Someone who drives 10 % above the limit here will do so there.
        habit = max(1.0, last.speed_m_s / self._limits.approach_at_m_s(last.position_m))
        positions, speeds = [last.position_m], [last.speed_m_s]
        for aimed in free.speeds_m_s[1 : fine.size].tolist():
            allowed = habit * self._limits.approach_at_m_s(positions[-1])
            speed = min(aimed, max(allowed, speeds[-1] - 2.0 * BRAKING_M_S2 * _STEP_S))
            positions.append(positions[-1] + 0.5 * _STEP_S * (speeds[-1] + speed))
            speeds.append(speed)
        reached = fine[: len(positions)]
        return replace(
            free,
            predictor=PredictorName.SPEED_LIMITS,
            times_s=times_s,
            positions_m=np.interp(times_s, reached, positions),
            speeds_m_s=np.interp(times_s, reached, speeds),
            bounds_m=GROWTH.at(np.maximum(times_s - last.time_s, 0.0)) + last.bound_m,
        )
