"""Interface of predictors, and the prediction along the path that the leader sends."""

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
    """Input of a predictor: received data of the leader.

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


class LeaderPredictor(Protocol):
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


RESOLUTION_M = 0.02
"""Resolution of the points on the wire (m), and of the speed (m/s)."""
CHANGE_SHARE = 0.25
"""Error of the speed at a point per change of the acceleration from the points before and to those behind it,
and time between them. A kink of the acceleration at the point alone makes 1 / (4 sqrt 3) = 0.144."""
UNSEEN_JERK_M_S3 = 1.0
"""Changes of the acceleration between two points that do not show at them."""
MAX_SPEED_M_S = 70.0
MAX_DEVIATION_M = 1.0
"""Deviation from its path beyond which the leader is considered to have left it."""
MIN_AHEAD_S = 0.05
BACKWARD_TOLERANCE_M = 0.5


class ReceivedPath:
    """Follows the path prediction of the leader's newest message.

    Positions are sent at the points only. Speeds, and positions between the points, follow from the cubic
    spline through them; what the leader may do otherwise is bounded by how its acceleration changes from
    point to point.
    """

    name = PredictorName.RECEIVED_PATH

    def predict(self, track: LeaderTrack, times_s: FloatArray) -> LeaderPreview | None:
        """Return the motion up to the last point of the path; None without a plausible one."""
        last = track.last
        if track.path is None:
            return None
        path_times, path_places = track.path
        ahead = path_times > last.time_s + MIN_AHEAD_S
        announced_m = float(np.interp(last.time_s, path_times, path_places))
        if not ahead.any() or abs(announced_m - last.position_m) > MAX_DEVIATION_M:
            return None
        nodes = np.concatenate([[last.time_s], path_times[ahead]])
        places = np.concatenate([[last.position_m], path_places[ahead]])
        steps = np.diff(places)
        if steps.min() < -BACKWARD_TOLERANCE_M:
            return None
        if np.any(steps > MAX_SPEED_M_S * np.diff(nodes) + BACKWARD_TOLERANCE_M):
            return None
        places = np.maximum.accumulate(places)
        times = times_s[times_s <= nodes[-1] + 1e-9]
        positions, speeds = monotone_spline(nodes, places, last.speed_m_s, times)
        late_m, slow_m_s = between_points(nodes, places, last.speed_m_s, times)
        return LeaderPreview(
            times,
            positions,
            speeds,
            np.maximum.accumulate(late_m) + RESOLUTION_M + last.bound_m,
            slow_m_s,
        )


def between_points(
    nodes: FloatArray, values: FloatArray, first_slope: float, at: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return 99 % bounds of position (m) and speed (m/s) that points leave open, shape of the times each.

    Args:
        nodes: times of the points, s, shape (n,), increasing, n >= 2.
        values: positions of the points, m, shape (n,), never decreasing.
        first_slope: speed at the first point, m/s.
        at: times, s, shape (m,), inside the nodes.
    """
    widths = np.diff(nodes)
    secants = np.diff(values) / widths
    middles = np.concatenate([nodes[:1], 0.5 * (nodes[1:] + nodes[:-1])])
    accelerations = np.diff(np.concatenate([[first_slope], secants])) / np.diff(middles)
    changes = np.abs(np.diff(accelerations, append=accelerations[-1:]))
    around = np.concatenate([changes[:1], changes]) + np.concatenate([changes, [0.0]])
    longest = np.maximum(np.concatenate([widths[:1], widths]), np.concatenate([widths, [0.0]]))
    slow = CHANGE_SHARE * longest * around + UNSEEN_JERK_M_S3 * longest**2 / 12.0 + RESOLUTION_M
    slow[0] = 0.0  # the first speed is sent
    index = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, widths.size - 1)
    share = (at - nodes[index]) / widths[index]
    larger = np.maximum(slow[1:], slow[:-1])[index]
    return larger * widths[index] * share * (1.0 - share), np.interp(at, nodes, slow)


def monotone_spline(
    nodes: FloatArray, values: FloatArray, first_slope: float, at: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Interpolate values that never decrease by a cubic spline that never does either.

    Slopes belong to the spline with continuous curvature, reduced where it would overshoot (Fritsch and
    Carlson, 1980).

    Args:
        nodes: abscissae, shape (n,), increasing, n >= 2.
        values: ordinates, shape (n,), never decreasing.
        first_slope: slope at the first node, reduced where it would overshoot.
        at: where to evaluate, shape (m,), inside the nodes.

    Returns:
        Values and slopes, shape (m,) each.
    """
    widths = np.diff(nodes)
    secants = np.diff(values) / widths
    inverse = np.concatenate([1.0 / widths, [0.0]])
    before = np.concatenate([[0.0], inverse[:-1]])
    matrix = (
        np.diag(2.0 * (before + inverse)) + np.diag(inverse[:-1], 1) + np.diag(inverse[:-1], -1)
    )
    right = 3.0 * np.concatenate([[0.0], secants * inverse[:-1]])
    right[:-1] += 3.0 * secants * inverse[:-1]
    matrix[0], right[0] = np.eye(nodes.size)[0], first_slope
    slopes = np.maximum(np.linalg.solve(matrix, right), 0.0)
    slopes[:-1] = np.minimum(slopes[:-1], 3.0 * secants)
    slopes[1:] = np.minimum(slopes[1:], 3.0 * secants)
    index = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, secants.size - 1)
    width, share = widths[index], (at - nodes[index]) / widths[index]
    secant, start, end = secants[index], slopes[index], slopes[index + 1]
    square, cube = 3.0 * secant - 2.0 * start - end, start + end - 2.0 * secant
    rise = share * (start + share * (square + share * cube))
    slope = start + share * (2.0 * square + 3.0 * share * cube)
    return values[index] + width * rise, np.maximum(slope, 0.0)
