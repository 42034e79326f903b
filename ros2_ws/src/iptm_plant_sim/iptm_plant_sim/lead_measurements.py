"""The vehicle ahead inside one interval, from the measurements of the range sensor in it."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import accumulate, pairwise
from operator import itemgetter

from iptm_core.frozen import replace
from iptm_core.lead_track import (
    ANOTHER_LEAD_M,
    ANOTHER_LEAD_M_S,
    FREE_POSITION_M,
    IDENTICAL_M,
    IDENTICAL_M_S,
    KEPT,
    LARGEST_MEASURING_INTERVAL_S,
    LONGEST_PERIOD_S,
    MOVING_M_S,
    LeadTrack,
    Sample,
    emptied,
    followed,
)
from iptm_core.radio_lead import RadioLead
from iptm_core.signal_residuals import (
    RANGE_LIMIT_M,
    RANGE_TIME_S,
    Residual,
    after,
    unexplained_change,
)
from iptm_core.state import LeaderPreview, LeaderState

_RESOLUTION_S = 1e-9

OwnMotion = Callable[[float], "tuple[float, float]"]
"""From the time since the start of an interval to position and speed of the ego vehicle."""

_time_s = itemgetter(0)


class LeadMeasurements:
    """The vehicle ahead at any instant of an interval, from what the range sensor has measured by then.

    At the instant of a measurement it is that; behind it, a motion that goes on with the measured
    deceleration, and once a measurement is missing the hardest one. A measured acceleration is not relied on.
    """

    def __init__(
        self,
        track: LeadTrack,
        samples: LeaderPreview | None,
        own: OwnMotion,
        start_s: float,
        radio: RadioLead | None = None,
    ) -> None:
        """Take the measurements of an interval.

        Args:
            track: the vehicle ahead as it was known before.
            samples: measurements of the interval in order; none at all for an empty lane. None if the sensor
                is silent.
            own: motion of the ego vehicle in the interval.
            start_s: trip time at which the interval begins.
            radio: where messages place the vehicle ahead; None where they do not count.
        """
        self._before = track
        self._radio = radio
        self._rows: list[tuple[float, ...]] = []
        if samples is not None and samples.times_s.size:
            columns = samples.times_s, samples.positions_m, samples.speeds_m_s
            self._rows = [
                (time_s, position_m, speed_m_s, *own(time_s - start_s))
                for time_s, position_m, speed_m_s in zip(
                    *[values.tolist() for values in columns], strict=True
                )
            ]
        elif samples is not None:
            self._before = track = emptied(track, start_s)
        plain = plainly_followed(track, self._rows) if self._rows else track
        self._are_sound = plain is not None
        self.track = self._tracks[-1] if plain is None else plain

    @cached_property
    def _tracks(self) -> list[LeadTrack]:
        """The track at every measurement."""
        samples = map(Sample._make, self._rows)
        return list(accumulate(samples, followed, initial=self._before))[1:]

    @property
    def _sound(self) -> list[tuple[float, ...]]:
        """Measurements that show where the vehicle ahead is, as `Sample`."""
        if self._are_sound:
            return self._rows
        return [
            row
            for row, track in zip(self._rows, self._tracks, strict=True)
            if track.seen is not None and track.seen.time_s == row[0]
        ]

    def bounds(self) -> tuple[float, float] | None:
        """Return smallest position and speed measured; None unless all of several measurements are sound."""
        if self._radio is not None or not self._are_sound or len(self._rows) < 2:
            return None
        return min([row[1] for row in self._rows]), min([row[2] for row in self._rows])

    def at(self, time_s: float, deceleration_m_s2: float) -> tuple[LeaderState | None, float, bool]:
        """Return the vehicle ahead at an instant, None for a free lane.

        Args:
            deceleration_m_s2: hardest one possible.

        Returns:
            The vehicle, for how long its measurements have been missing, and whether it is measured now.
        """
        index = bisect_right(self._rows, time_s + _RESOLUTION_S, key=_time_s) - 1
        if self._are_sound and index >= 0:
            newest = LeaderState(*self._rows[index][:3])
            if abs(time_s - newest.time_s) <= _RESOLUTION_S:
                return self._nearer(newest), 0.0, True
        track = self._before if index < 0 else self._tracks[index]
        if track.seen is not None and abs(time_s - track.seen.time_s) <= _RESOLUTION_S:
            return self._nearer(track.counted(track.seen)), 0.0, True
        lead = track.assumed_at(time_s, deceleration_m_s2)
        if lead is not None:
            lead = self._nearer(track.counted(lead))
        return lead, track.unseen_s(time_s), False

    def _nearer(self, lead: LeaderState) -> LeaderState:
        """Return the nearer and slower one of a vehicle that is measured and the one of the messages."""
        return lead if self._radio is None else self._radio.nearer_and_slower(lead)

    def shown_deceleration_m_s2(self, time_s: float) -> float:
        """Return how hard the vehicle ahead is seen to brake at an instant; see `LeadTrack`."""
        index = bisect_right(self._rows, time_s + _RESOLUTION_S, key=_time_s) - 1
        return (self._before if index < 0 else self._tracks[index]).shown_deceleration_m_s2

    def brakes_harder_than(self, deceleration_m_s2: float) -> bool:
        """Return whether any two steps in a row may show more than a deceleration."""
        rows = (*self._before.recent[-2:], *self._rows)
        was_harder = False
        for (then_s, _, then_m_s, *_), (time_s, _, speed_m_s, *_) in pairwise(rows):
            is_harder = then_m_s - speed_m_s > deceleration_m_s2 * (time_s - then_s)
            if is_harder and was_harder:
                return True
            was_harder = is_harder
        return False

    def smallest_gap_m(self, after_s: float) -> float:
        """Return the smallest gap that is soundly measured after an instant, NaN for none."""
        after_s += _RESOLUTION_S
        return min([row[1] - row[3] for row in self._sound if row[0] > after_s], default=math.nan)


def _are_apart(values: list[float], by: float) -> bool:
    """Return whether any two values differ by more than a distance."""
    values.sort()
    last = -math.inf
    for value in values:
        if not value - last > by:
            return False
        last = value
    return True


def plainly_followed(track: LeadTrack, samples: Sequence[tuple[float, ...]]) -> LeadTrack | None:
    """Return a track after measurements in order, of which none repeats or contradicts another.

    The same as `followed` sample by sample; None where one of them needs a closer look.

    Args:
        samples: numbers of a `Sample` each.
    """
    if track.frozen or track.seen is None or not track.recent or track.is_doubtful:
        return None
    rows = (*track.recent, *samples)
    speeds = [row[2] for row in rows]
    fastest_m_s = max(speeds)
    is_moving = fastest_m_s > MOVING_M_S or max([row[4] for row in rows]) > MOVING_M_S
    if is_moving and not _are_apart(speeds, IDENTICAL_M_S):
        # The same speed again is no repetition where gap and, of a moving vehicle, position differ.
        if not _are_apart([row[1] - row[3] for row in rows], 2.0 * IDENTICAL_M):
            return None
        if fastest_m_s > MOVING_M_S and not _are_apart([row[1] for row in rows], 2 * IDENTICAL_M):
            return None
    last_s, last_m, last_m_s = track.recent[-1][:3]
    interval_s = acceleration_m_s2 = 0.0
    residual = track.unexplained.value, track.unexplained.noise, track.unexplained.last
    for time_s, position_m, speed_m_s, _, _ in samples:
        interval_s, change_m_s = time_s - last_s, speed_m_s - last_m_s
        farther_m = position_m - last_m - 0.5 * (last_m_s + speed_m_s) * interval_s
        if not (
            _RESOLUTION_S < interval_s <= LARGEST_MEASURING_INTERVAL_S
            and abs(farther_m) <= ANOTHER_LEAD_M
            and abs(change_m_s) <= ANOTHER_LEAD_M_S
            and position_m < FREE_POSITION_M
        ):
            return None
        acceleration_m_s2 = change_m_s / interval_s
        changed_m = unexplained_change(position_m - last_m, last_m_s, speed_m_s, interval_s)
        residual = after(*residual, changed_m, min(interval_s / RANGE_TIME_S, 1.0))
        if abs(residual[0]) > RANGE_LIMIT_M and Residual(*residual).beyond(RANGE_LIMIT_M):
            return None
        last_s, last_m, last_m_s = time_s, position_m, speed_m_s
    return replace(
        track,
        seen=LeaderState(*samples[-1][:3]),
        acceleration_m_s2=acceleration_m_s2,
        period_s=min(interval_s, LONGEST_PERIOD_S),
        recent=rows[-KEPT:],
        empty_since_s=math.nan,
        unexplained=Residual(*residual),
    )
