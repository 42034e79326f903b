"""Predictions of a leader of whose future nothing is known: its acceleration dies away, or it brakes."""

from __future__ import annotations

import numpy as np

from iptm_core.state import FloatArray, LeaderPreview
from iptm_v2x_bridge.prediction.predictor import (
    ErrorGrowth,
    LeaderTrack,
    PredictorName,
)

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
