"""Interface of predictors, and predictions of a leader whose future is unknown.

Its acceleration dies away, or it brakes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from iptm_core.declaration import TextEnum
from iptm_core.settings import VEHICLE_LENGTH_M
from iptm_core.state import FloatArray, LeaderPreview


class PredictorName(TextEnum):
    """Predictors from the best informed to the least."""

    RECEIVED_PATH = "received_path"
    LEARNT_PROFILE = "learnt_profile"
    SIGNALS = "signals"
    SPEED_LIMITS = "speed_limits"
    REGRESSION = "regression"
    HISTORY = "history"
    ASSUMED_BRAKING = "assumed_braking"


CREEP_M_S = 0.5
"""Speed below which a vehicle is taken to stand."""


@dataclass(frozen=True)
class Observation:
    """A vehicle at the generation of one message.

    Attributes:
        time_s: time of generation, s of TimestampIts.
        position_m: rear end along the road.
        speed_m_s: speed along the road.
        acceleration_m_s2: acceleration, None if not sent.
        bound_m: 95 % bound of the position as its sender states it, 0 if it does not.
    """

    time_s: float
    position_m: float
    speed_m_s: float
    acceleration_m_s2: float | None
    bound_m: float = 0.0

    def moved_on_m(self, time_s: float) -> float:
        """Return where the rear end is at another time if the speed is kept."""
        return self.position_m + self.speed_m_s * (time_s - self.time_s)


@dataclass(frozen=True)
class LeaderTrack:
    """Input of a predictor: what has been received of the leader.

    Attributes:
        observations: oldest first, at least one.
        path: newest path that it has announced: times, shape (n,), n >= 2, increasing, in the time of the
            observations, the first one in its message; and positions of its rear end along the road.
            None without one.
        length_m: from its rear end to its front.
        stood_s: for how long it has stood, as far as received.
        age_s: of the last observation, at the tick for which the motion is predicted.
    """

    observations: Sequence[Observation]
    path: tuple[FloatArray, FloatArray] | None = None
    length_m: float = VEHICLE_LENGTH_M
    stood_s: float = 0.0
    age_s: float = 0.0

    @property
    def last(self) -> Observation:
        """The newest observation."""
        return self.observations[-1]


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

    @property
    def name(self) -> PredictorName:
        """Name on diagnostics."""
        ...

    def predict(self, track: LeaderTrack, times_s: FloatArray) -> LeaderPreview | None:
        """Return the motion at increasing times from the last observation on, None without a prediction.

        Its bounds include the error of the present position. It may end before the last of the times.
        """
        ...


def joined_motion(predictions: Sequence[LeaderPreview]) -> LeaderPreview:
    """Return the expected motion, and how far the leader may be behind it under all predictions.

    The initial uncertainty of the position is constant: it moves the whole motion nearer and is not part of
    the bounds. Of several predictions the nearest position and the lowest speed count. Speeds are
    lowered by their own bounds: the smallest gap depends on them more than on anything else, the cost on
    positions only.

    Args:
        predictions: at least one, beginning at the same time with the same nodes.

    Returns:
        The motion up to the end of the shortest prediction.
    """
    count = min(prediction.times_s.size for prediction in predictions)
    # Between the present and an observation by a clock that is ahead, a path may roll backwards.
    positions = np.maximum.accumulate(
        np.min([each.positions_m[:count] - each.bounds_m[0] for each in predictions], axis=0)
    )
    nearest = np.min([(each.positions_m - each.bounds_m)[:count] for each in predictions], axis=0)
    speeds = np.min([each.lowest_speeds_m_s[:count] for each in predictions], axis=0)
    bounds = np.maximum(positions - nearest, 0.0)
    return LeaderPreview(predictions[0].times_s[:count], positions, speeds, bounds)


DECAY_S = 4.0
"""Time constant with which an acceleration dies away."""
SLOPE_WINDOW_S = 1.0
GROWTH = ErrorGrowth(
    (0.0, 0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0, 60.0),
    (0.02, 0.03, 0.07, 0.26, 0.65, 1.3, 3.5, 12.2, 57.0, 193.0, 571.0, 945.0),
)


class History:
    """Lets the present acceleration decay; the leader never drives backwards."""

    name = PredictorName.HISTORY

    def predict(self, track: LeaderTrack, times_s: FloatArray) -> LeaderPreview:
        """Return the motion at all times asked for."""
        last = track.last
        elapsed = np.maximum(times_s - last.time_s, 0.0)
        acceleration = present_acceleration_m_s2(track)
        gone = 1.0 - np.exp(-elapsed / DECAY_S)
        speeds = last.speed_m_s + acceleration * DECAY_S * gone
        moved = last.speed_m_s * elapsed + acceleration * DECAY_S * (elapsed - DECAY_S * gone)
        if speeds.min(initial=0.0) < 0.0:
            # It halts where the speed reaches zero, and stays.
            ratio = 1.0 + last.speed_m_s / (acceleration * DECAY_S)
            halt_s = -DECAY_S * float(np.log(max(ratio, 1e-12)))
            halted = 1.0 - np.exp(-halt_s / DECAY_S)
            way = last.speed_m_s * halt_s + acceleration * DECAY_S * (halt_s - DECAY_S * halted)
            moved = np.where(elapsed < halt_s, moved, max(way, 0.0))
            speeds = np.maximum(speeds, 0.0)
        return LeaderPreview(
            times_s,
            last.position_m + np.maximum.accumulate(moved),
            speeds,
            np.maximum(GROWTH.at(elapsed), unheard_braking_m(track, elapsed, speeds))
            + last.bound_m,
        )


def present_acceleration_m_s2(track: LeaderTrack) -> float:
    """Return the acceleration that the leader sends, else the one of its last second."""
    last = track.last
    if last.acceleration_m_s2 is not None:
        return last.acceleration_m_s2
    for earlier in track.observations:
        elapsed_s = last.time_s - earlier.time_s
        if 0.0 < elapsed_s <= SLOPE_WINDOW_S + 1e-9:
            return (last.speed_m_s - earlier.speed_m_s) / elapsed_s
    return 0.0


ASSUMED_BRAKING_M_S2 = 3.0
"""Harder than drivers brake without an emergency. A harder braking leader is known once it is heard again."""


def unheard_braking_m(
    track: LeaderTrack, elapsed_s: FloatArray, speeds_m_s: FloatArray
) -> FloatArray:
    """Return how far behind the expectation a leader may be that has braked since its last message.

    The braking reserve of the controller assumes that the leader begins to brake at the first node ahead. One
    that was last heard a second before the tick may have begun then, which is rarer than the 1 % that
    the bounds leave out, and no less to be allowed for. Up to the tick nothing is added.

    Args:
        track: messages of the leader.
        elapsed_s: times since the last one, shape (n,).
        speeds_m_s: expected speeds there, shape (n,).
    """
    lowest_m_s = max(track.last.speed_m_s - ASSUMED_BRAKING_M_S2 * track.age_s, 0.0)
    lost_m_s = max(float(np.interp(track.age_s, elapsed_s, speeds_m_s)) - lowest_m_s, 0.0)
    ahead = elapsed_s > track.age_s + 1e-6
    behind_m: FloatArray = np.where(ahead, 0.5 * lost_m_s * elapsed_s, 0.0)
    return behind_m


class AssumedBraking:
    """Lets a silent leader brake to a halt since its last message: the worst case, so its bounds are 0."""

    name = PredictorName.ASSUMED_BRAKING

    def predict(self, track: LeaderTrack, times_s: FloatArray) -> LeaderPreview:
        """Return the motion at all times asked for."""
        last = track.last
        halt_s = last.speed_m_s / ASSUMED_BRAKING_M_S2
        elapsed = np.clip(times_s - last.time_s, 0.0, halt_s)
        moved = elapsed * (last.speed_m_s - 0.5 * ASSUMED_BRAKING_M_S2 * elapsed)
        return LeaderPreview(
            times_s,
            last.position_m - last.bound_m + moved,
            np.maximum(last.speed_m_s - ASSUMED_BRAKING_M_S2 * elapsed, 0.0),
            np.zeros_like(times_s),
        )
