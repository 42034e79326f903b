"""A prediction bounded by the speed limits of the road ahead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iptm_core.road_ahead import BRAKING_M_S2, SpeedLimits
from iptm_core.state import FloatArray
from iptm_v2x_bridge.prediction.predictor import (
    ErrorGrowth,
    Knowledge,
    Prediction,
    Predictor,
    PredictorName,
)

_STEP_S = 0.25
GROWTH = ErrorGrowth(
    (0.0, 0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0, 60.0),
    (0.02, 0.03, 0.07, 0.26, 0.65, 1.3, 3.5, 12.6, 56.0, 192.0, 491.0, 727.0),
)


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
