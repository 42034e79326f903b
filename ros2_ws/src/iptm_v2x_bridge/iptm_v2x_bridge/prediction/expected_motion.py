"""Expected motion of a leader that sends no path: its acceleration decays, it brakes, it drives as usual."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.state import FloatArray, LeaderPreview
from iptm_v2x_bridge.prediction.predictor import CREEP_M_S, ErrorGrowth, LeaderTrack, PredictorName

DECAY_S = 4.0
"""Time constant with which an acceleration dies away."""
SLOPE_WINDOW_S = 1.0
HISTORY_GROWTH = ErrorGrowth(
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
            np.maximum(HISTORY_GROWTH.at(elapsed), unheard_braking_m(track, elapsed, speeds))
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
