"""The vehicle ahead inside one interval, from the measurements of the range sensor in it."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable

import numpy as np

from iptm_core.lead_track import LeadTrack, emptied, followed, samples_of
from iptm_core.state import FloatArray, LeaderPreview, LeaderState

_RESOLUTION_S = 1e-9

OwnMotion = Callable[[FloatArray], "tuple[FloatArray, FloatArray]"]
"""From times since the start of an interval to positions and speeds of the ego vehicle, shape (n,) each."""


class LeadMeasurements:
    """The vehicle ahead at any instant of an interval, from what the range sensor has measured by then.

    At the instant of a measurement it is that; behind it, a motion that goes on with the measured
    deceleration, and once a measurement is missing the hardest one. A measured acceleration is not relied on.
    """

    def __init__(
        self, track: LeadTrack, samples: LeaderPreview | None, own: OwnMotion, start_s: float
    ) -> None:
        """Take the measurements of an interval.

        Args:
            track: the vehicle ahead as it was known before.
            samples: measurements of the interval in order; none at all for an empty lane. None if the sensor
                is silent.
            own: motion of the ego vehicle in the interval.
            start_s: trip time at which the interval begins.
        """
        self._before = track
        self._tracks: list[LeadTrack] = []
        self._times_s: list[float] = []
        if samples is not None and samples.times_s.size:
            for sample in samples_of(samples, *own(samples.times_s - start_s)):
                track = followed(track, sample)
                self._tracks.append(track)
                self._times_s.append(sample.time_s)
        elif samples is not None:
            self._before = track = emptied(track, start_s)
        self.track = track

    def bounds(self) -> tuple[float, float] | None:
        """Return smallest position and speed measured; None unless all of several measurements are sound."""
        if len(self._tracks) < 2:
            return None
        seen = [
            track.seen
            for track, time_s in zip(self._tracks, self._times_s, strict=True)
            if track.seen is not None and track.seen.time_s == time_s
        ]
        if len(seen) < len(self._tracks):
            return None
        return min(lead.position_m for lead in seen), min(lead.speed_m_s for lead in seen)

    def at(self, time_s: float, deceleration_m_s2: float) -> tuple[LeaderState | None, float, bool]:
        """Return the vehicle ahead at an instant, None for a free lane.

        Args:
            deceleration_m_s2: hardest one possible.

        Returns:
            The vehicle, for how long its measurements have been missing, and whether it is measured now.
        """
        index = bisect_right(self._times_s, time_s + _RESOLUTION_S) - 1
        track = self._before if index < 0 else self._tracks[index]
        if track.seen is not None and abs(time_s - track.seen.time_s) <= _RESOLUTION_S:
            return track.seen, 0.0, True
        return track.assumed_at(time_s, deceleration_m_s2), track.unseen_s(time_s), False

    def measured_after(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Return times and positions of the sound measurements after an instant, shape (n,) each."""
        rows = [
            (track.seen.time_s, track.seen.position_m)
            for track, measured_s in zip(self._tracks, self._times_s, strict=True)
            if track.seen is not None and track.seen.time_s == measured_s > time_s + _RESOLUTION_S
        ]
        times, positions = np.array(rows).reshape(-1, 2).T
        return times, positions
