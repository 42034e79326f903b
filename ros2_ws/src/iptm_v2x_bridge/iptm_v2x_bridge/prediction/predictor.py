"""Common interface of the predictors: input, prediction, and its bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from iptm_core.declaration import TextEnum
from iptm_core.state import FloatArray
from iptm_v2x_bridge.messages.cam import ASSUMED_LENGTH_M
from iptm_v2x_bridge.stations.station import Observation


class PredictorName(TextEnum):
    """Predictors from the best informed to the least."""

    RECEIVED_PATH = "received_path"
    LEARNT_PROFILE = "learnt_profile"
    SIGNALS = "signals"
    SPEED_LIMITS = "speed_limits"
    REGRESSION = "regression"
    HISTORY = "history"
    ASSUMED_BRAKING = "assumed_braking"


@dataclass(frozen=True, eq=False)
class RoadPath:
    """The newest predicted path, seen from the road.

    Attributes:
        times_s: times, shape (n,), n >= 2, increasing, in the time of the observations; the first one is when
            the path was sent.
        positions_m: rear end along the road, shape (n,).
    """

    times_s: FloatArray
    positions_m: FloatArray


@dataclass(frozen=True)
class Knowledge:
    """Input of a predictor: messages of the leader.

    Attributes:
        observations: oldest first, at least one.
        path: announced path, None without one.
        length_m: from its rear end to its front.
        stood_s: for how long it has stood, as far as received.
    """

    observations: Sequence[Observation]
    path: RoadPath | None = None
    length_m: float = ASSUMED_LENGTH_M
    stood_s: float = 0.0

    @property
    def last(self) -> Observation:
        """The newest observation."""
        return self.observations[-1]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Motion of the leader as far as the predictor reaches.

    Attributes:
        predictor: the predictor.
        times_s: times asked for and answered, shape (n,), increasing.
        positions_m: rear end along the road, shape (n,), never decreasing.
        speeds_m_s: speeds, shape (n,), never negative.
        bounds_m: 99 % bound of how far the leader is behind these positions, shape (n,).
        speed_bounds_m_s: 99 % bound of how much slower it is where the positions are known better than the
            speeds, shape (n,); empty if implied by the growth of the other bound.
    """

    predictor: PredictorName
    times_s: FloatArray
    positions_m: FloatArray
    speeds_m_s: FloatArray
    bounds_m: FloatArray
    speed_bounds_m_s: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def lowest_speeds_m_s(self) -> FloatArray:
        """Speeds less their own bounds, shape (n,)."""
        if not self.speed_bounds_m_s.size:
            return self.speeds_m_s
        lowest: FloatArray = np.maximum(self.speeds_m_s - self.speed_bounds_m_s, 0.0)
        return lowest


@dataclass(frozen=True)
class ErrorGrowth:
    """How the 99 % bound of a position grows with the time since the observation.

    The bounds of the predictors were determined on udds, hwfet, us06 and sc03 and are tested on other cycles.

    Attributes:
        leads_s: times since the observation, increasing from 0.
        bounds_m: bounds there; linear between, and on with the last rate.
    """

    leads_s: tuple[float, ...]
    bounds_m: tuple[float, ...]

    def at(self, leads_s: FloatArray) -> FloatArray:
        """Return the bounds at any times since the observation, shape of them."""
        rate = (self.bounds_m[-1] - self.bounds_m[-2]) / (self.leads_s[-1] - self.leads_s[-2])
        beyond = np.maximum(leads_s - self.leads_s[-1], 0.0)
        bounds: FloatArray = np.interp(leads_s, self.leads_s, self.bounds_m) + rate * beyond
        return bounds


class Predictor(Protocol):
    """Predicts the motion of the leader from its messages."""

    def predict(self, known: Knowledge, times_s: FloatArray) -> Prediction | None:
        """Return the motion at increasing times from the last observation on, None without a prediction.

        The prediction may end before the last of the times.
        """
        ...


def joined_motion(
    predictions: Sequence[Prediction],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the expected motion, and how far the leader may be behind it under all predictions.

    The initial uncertainty of the position is constant: it moves the whole motion nearer and is not part of
    the bounds. Of several predictions the nearest position and the lowest speed count. Speeds are
    lowered by their own bounds: the smallest gap depends on them more than on anything else, the cost on
    positions only.

    Args:
        predictions: at least one, beginning at the same time with the same nodes.

    Returns:
        Positions, speeds and bounds up to the end of the shortest prediction, shape (n,) each.
    """
    count = min(prediction.times_s.size for prediction in predictions)
    # Between the present and an observation by a clock that is ahead, a path may roll backwards.
    positions = np.maximum.accumulate(
        np.min([each.positions_m[:count] - each.bounds_m[0] for each in predictions], axis=0)
    )
    nearest = np.min([(each.positions_m - each.bounds_m)[:count] for each in predictions], axis=0)
    speeds = np.min([each.lowest_speeds_m_s[:count] for each in predictions], axis=0)
    return positions, speeds, np.maximum(positions - nearest, 0.0)
