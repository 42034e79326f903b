"""What is assumed of a leader that has fallen silent: that it brakes, since its last message."""

from __future__ import annotations

import numpy as np

from iptm_core.state import FloatArray
from iptm_v2x_bridge.prediction.predictor import Knowledge, Prediction, PredictorName

ASSUMED_BRAKING_M_S2 = 3.0
"""Harder than drivers brake without an emergency. A harder braking leader is known once it is heard again."""


class AssumedBraking:
    """Lets the leader brake to a halt: no guess but the worst that is reckoned with, so it has no bound."""

    def predict(self, known: Knowledge, times_s: FloatArray) -> Prediction:
        """Return the motion at all times asked for."""
        last = known.last
        halt_s = last.speed_m_s / ASSUMED_BRAKING_M_S2
        elapsed = np.clip(times_s - last.time_s, 0.0, halt_s)
        moved = elapsed * (last.speed_m_s - 0.5 * ASSUMED_BRAKING_M_S2 * elapsed)
        return Prediction(
            PredictorName.ASSUMED_BRAKING,
            times_s,
            last.position_m - last.bound_m + moved,
            np.maximum(last.speed_m_s - ASSUMED_BRAKING_M_S2 * elapsed, 0.0),
            np.zeros_like(times_s),
        )
