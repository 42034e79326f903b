"""Predictions along a path: the one that the leader sends, or where drivers of the same road are slow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.state import FloatArray, LeaderPreview
from iptm_v2x_bridge.prediction.predictor import (
    CREEP_M_S,
    DECAY_S,
    ErrorGrowth,
    LeaderTrack,
    PredictorName,
    present_acceleration_m_s2,
)

SPACING_M = 5.0
"""Grid of the profile along the road."""
BLEND_S = 5.0
"""Time in which the driver's own speed gives way to the usual one."""
GROWTH = ErrorGrowth(
    (0.0, 0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0, 60.0),
    (0.02, 0.03, 0.05, 0.2, 0.43, 0.86, 2.1, 5.4, 21.2, 51.0, 114.0, 231.0),
)
_STEP_S = 0.25


class LearntProfile:
    """Predicts from the usual speed along the road and the usual standing time at each place."""

    name = PredictorName.LEARNT_PROFILE

    def __init__(self, drives: Sequence[tuple[FloatArray, FloatArray]]) -> None:
        """Learn from drives.

        Args:
            drives: positions (m, of the same point of the car as the observations') and speeds at 1 Hz, one
                pair of arrays for each drive.

        Raises:
            RouteError: no drive, or one that does not move.
        """
        if not drives:
            raise RouteError("learnt profile: 0 drives; allowed: at least 1")
        end_m = max(float(positions[-1]) for positions, _ in drives)
        start_m = min(float(positions[0]) for positions, _ in drives)
        if end_m - start_m < SPACING_M:
            raise RouteError(
                f"learnt profile: drives of {end_m - start_m:.1f} m; allowed: 5 m or more"
            )
        self._grid = np.arange(start_m, end_m + SPACING_M, SPACING_M)
        paces, stands = zip(*(self._pace(*drive) for drive in drives), strict=True)
        # The mean time per metre, so that the mean of the drives' times comes out.
        self._speeds = 1.0 / np.mean(paces, axis=0)
        self._stands_s = np.mean(stands, axis=0)

    def _pace(self, positions: FloatArray, speeds: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return seconds per metre while driving, and seconds of standing in each cell of the grid."""
        moving = speeds > CREEP_M_S
        places, unique = np.unique(positions[moving], return_index=True)
        pace = 1.0 / np.interp(self._grid, places, speeds[moving][unique])
        cells = np.clip(
            ((positions[~moving] - self._grid[0]) / SPACING_M).astype(np.int64),
            0,
            self._grid.size - 1,
        )
        stands = np.bincount(cells, minlength=self._grid.size).astype(np.float64)
        return pace, stands

    def predict(self, track: LeaderTrack, times_s: FloatArray) -> LeaderPreview | None:
        """Return the motion; None off the part of the road that was learnt."""
        last = track.last
        if not self._grid[0] - SPACING_M <= last.position_m <= self._grid[-1]:
            return None
        count = int(np.ceil(max(float(times_s[-1]) - last.time_s, 0.0) / _STEP_S)) + 1
        position, speed = last.position_m, last.speed_m_s
        own_speed, acceleration = speed, present_acceleration_m_s2(track)
        standing_s = self._remaining_stand_s(track)
        positions, speeds = [position], [speed]
        for step in range(1, count + 1):
            elapsed = step * _STEP_S
            usual = float(np.interp(position, self._grid, self._speeds))
            gone = 1.0 - np.exp(-elapsed / DECAY_S)
            free = max(own_speed + acceleration * DECAY_S * gone, 0.0)
            share = min(elapsed / BLEND_S, 1.0)
            aimed = (1.0 - share) * free + share * usual
            if standing_s > 0.0:
                standing_s, aimed = standing_s - _STEP_S, 0.0
            moved = 0.5 * _STEP_S * (speed + aimed)
            cell = int((position + moved - self._grid[0]) / SPACING_M)
            entered = cell > int((position - self._grid[0]) / SPACING_M)
            if entered and 0 <= cell < self._stands_s.size and self._stands_s[cell] > 1.0:
                standing_s += float(self._stands_s[cell])
            position, speed = position + moved, aimed
            positions.append(position)
            speeds.append(speed)
        reached = last.time_s + _STEP_S * np.arange(count + 1)
        return LeaderPreview(
            times_s,
            np.interp(times_s, reached, positions),
            np.interp(times_s, reached, speeds),
            GROWTH.at(np.maximum(times_s - last.time_s, 0.0)) + last.bound_m,
        )

    def _remaining_stand_s(self, track: LeaderTrack) -> float:
        """Return for how long a standing leader usually goes on standing here."""
        last = track.last
        if last.speed_m_s > CREEP_M_S:
            return 0.0
        cell = int(np.clip((last.position_m - self._grid[0]) / SPACING_M, 0, self._grid.size - 1))
        usual_s = float(self._stands_s[max(cell - 1, 0) : cell + 2].sum())
        return max(usual_s - track.stood_s, 0.0)


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
