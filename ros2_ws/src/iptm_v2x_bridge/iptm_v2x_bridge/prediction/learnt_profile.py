"""A prediction from earlier drives of the same road: where drivers are slow, and where they stop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.state import FloatArray, LeaderPreview
from iptm_v2x_bridge.prediction.extrapolation import DECAY_S, present_acceleration_m_s2
from iptm_v2x_bridge.prediction.predictor import (
    ErrorGrowth,
    LeaderTrack,
    PredictorName,
)
from iptm_v2x_bridge.stations.station import CREEP_M_S

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
