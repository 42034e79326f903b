"""The vehicle ahead as one range sensor shows it: measured, repeated, lost or gone.

A sensor that repeats itself, falls silent or reports an empty lane is as wrong as one that measures badly,
and none of this shows in a single value. So consecutive measurements are compared with each other and with
the own motion. Controller and safety monitor follow the vehicle ahead each on its own.

- Frozen: measurements with the same speed and the same gap or position, although speeds and own motion imply
  another one; within three measurements.
- Ghost: a vehicle that appears, and a moment later is farther on although it drives as before: it goes with
  the own vehicle. The vehicle seen before it is hidden, but not known to brake hard.
- Lost: no measurement, or an empty lane where a vehicle was a moment ago. It is free once it has been empty
  for `CONFIRMED_FREE_S`, or at once when a source reports a clear lane, see `clear_lane`.
- From the first measurement that is missing or repeated on, the vehicle ahead is assumed to brake.
- Contradicted: the gap changes as the measured speed does not explain (`iptm_core.signal_residuals`). The
  vehicle ahead counts as nearer by what opens too fast, and as slower by what closes too fast.
- Moved away: within an instant farther off at the same speed. It is the same vehicle, measured too far, or
  another one like it; for a while the nearer one counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

import numpy as np

from iptm_core.frozen import replace
from iptm_core.signal_residuals import (
    RANGE_LIMIT_M,
    RANGE_TIME_S,
    Residual,
    unexplained_change,
)
from iptm_core.state import LeaderPreview, LeaderState

CONFIRMED_FREE_S = 10.0
"""Time for which a lane has to be empty: longer than a radar loses a target that brakes."""
FREE_POSITION_M = 1e9
"""Stands for no vehicle ahead where a source has seen that there is none."""
ANOTHER_LEAD_M = 3.0
"""Position jump, beyond the motion at its speeds, from which it is another vehicle."""
ANOTHER_LEAD_M_S, ANOTHER_LEAD_M_S2 = 3.0, 12.0
"""Change of speed, beyond the second value times the interval, from which it is another vehicle."""
SAME_SPEED_M_S = 1.0
LARGEST_AWAY_M, AWAY_S = 15.0, 20.0
"""A target that moves away within an instant, by no more than the first value and at a speed that differs by
less than `SAME_SPEED_M_S`, counts as nearer by that distance for this time."""
RATE_S = 0.3
"""Time over which positions show a speed that is in doubt."""
LARGEST_MEASURING_INTERVAL_S = 5.0
"""Longest interval between two measurements from which an acceleration is estimated."""
IDENTICAL_M, IDENTICAL_M_S = 1e-6, 1e-9
"""Differences up to which two values are the same: rounding of positions far down the road."""
MOVING_M_S = 0.5
"""A vehicle that is measured slower may stand, and its position stays."""
FROZEN_CHANGE_M = 0.02
"""Change that has to be missing, beyond the resolution of the sensor, before it counts as frozen."""
RESOLUTIONS = (1.0, 0.5, 0.25, 0.2, 0.1, 0.05, 0.02, 0.01)
"""Steps of a coarse sensor in m or m/s, which show in its digits; a fine one does not repeat itself."""
RECOVERED_STEPS = 2
"""Consecutive steps that agree with the measured speeds, after which a frozen sensor counts again."""
GHOST_S = 3.0
"""Time after its appearance in which a vehicle shows that it is a ghost, and for which the vehicle that it
hides is not assumed to brake hard."""
GHOST_CONFIRMED_S = 1.2
"""Time for which what appears in place of a ghost has to move as measured before it counts."""
HIDDEN_DECELERATION_M_S2 = 3.0
"""Deceleration assumed of a vehicle that a ghost hides, harder than in ordinary driving."""
LONGEST_PERIOD_S = 1.5
"""A sensor is taken to measure at least this often."""
KEPT = 12
"""Measurements that a track remembers."""
_RESOLUTION_S = 1e-9


class LeadStatus(Enum):
    """Knowledge of the vehicle ahead."""

    FREE = "free"
    MEASURED = "measured"
    FROZEN = "frozen"
    LOST = "lost"


class RangeTrack(NamedTuple):
    """A vehicle ahead as a range sensor measures it, from the front bumper of the own one.

    Attributes:
        gap_m: to its rear bumper.
        left_m: to the left of the own axis.
        relative_speed_m_s: its speed less the own one.
    """

    gap_m: float
    left_m: float
    relative_speed_m_s: float


class Sample(NamedTuple):
    """One measurement, and the own vehicle at the same instant."""

    time_s: float
    position_m: float
    speed_m_s: float
    own_position_m: float
    own_speed_m_s: float

    @property
    def lead(self) -> LeaderState:
        """The vehicle ahead."""
        return LeaderState(self.time_s, self.position_m, self.speed_m_s)


@dataclass(frozen=True)
class LeadTrack:
    """State carried from measurement to measurement; the default stands for a lane never looked at.

    Attributes:
        seen: newest sound measurement, None for a free lane.
        acceleration_m_s2: between the last two of them.
        period_s: time between measurements; the next one is missing after that.
        frozen: whether the sensor repeats itself.
        ghost: whether that was a vehicle which appeared and has never been there.
        sound_steps: steps since then that agree with the speeds.
        recent: newest measurements, sound or not, oldest first.
        before: vehicle seen before another one appeared, None for none.
        appeared_s: when that was.
        empty_since_s: from when on the lane has been empty; NaN if it is not.
        unexplained: residual of the gap against the speed.
        away_m: distance by which the vehicle has moved away within an instant.
        away_until_s: until when that counts.
    """

    seen: LeaderState | None = None
    acceleration_m_s2: float = 0.0
    period_s: float = LONGEST_PERIOD_S
    frozen: bool = False
    ghost: bool = False
    sound_steps: int = 0
    recent: tuple[tuple[float, ...], ...] = ()
    before: LeaderState | None = None
    appeared_s: float = 0.0
    empty_since_s: float = math.nan
    unexplained: Residual = field(default_factory=Residual)
    away_m: float = 0.0
    away_until_s: float = 0.0

    def status(self, time_s: float) -> LeadStatus:
        """Return the vehicle ahead at a trip time."""
        if self.seen is None:
            return LeadStatus.FREE
        if self.frozen:
            return LeadStatus.FROZEN
        return LeadStatus.LOST if self.unseen_s(time_s) > 0.0 else LeadStatus.MEASURED

    @property
    def shown_deceleration_m_s2(self) -> float:
        """Deceleration that each of the last two steps between measurements shows, not negative."""
        newest_m_s2 = -self.acceleration_m_s2
        if newest_m_s2 <= 0.0 or len(self.recent) < 3:
            return 0.0
        first, second = self.recent[-3], self.recent[-2]
        return max(min(newest_m_s2, (first[2] - second[2]) / (second[0] - first[0])), 0.0)

    @property
    def is_doubtful(self) -> bool:
        """Whether the vehicle may count as nearer or slower than it is measured."""
        return self.away_m > 0.0 or self.unexplained.beyond(RANGE_LIMIT_M) != 0.0

    def counted(self, lead: LeaderState) -> LeaderState:
        """Return a vehicle ahead, as measured or assumed, nearer and slower by what is in doubt."""
        if not self.is_doubtful:
            return lead
        beyond_m = self.unexplained.beyond(RANGE_LIMIT_M)
        nearer_m = max(beyond_m, 0.0) + (self.away_m if lead.time_s <= self.away_until_s else 0.0)
        speed_m_s = lead.speed_m_s
        if beyond_m < 0.0:
            speed_m_s = min(speed_m_s + beyond_m / RANGE_TIME_S, self._rate_m_s())
        return LeaderState(lead.time_s, lead.position_m - nearer_m, max(speed_m_s, 0.0))

    def _rate_m_s(self) -> float:
        """Return the speed that the last measured positions show, infinite without enough of them."""
        if len(self.recent) < 2:
            return math.inf
        newest_s, newest_m = self.recent[-1][:2]
        past = [entry for entry in self.recent[:-1] if newest_s - entry[0] >= RATE_S]
        then_s, then_m = (past[-1] if past else self.recent[-2])[:2]
        return (newest_m - then_m) / (newest_s - then_s)

    def unseen_s(self, time_s: float) -> float:
        """Return for how long measurements have been missing at a trip time, 0 if none is."""
        if self.seen is None:
            return 0.0
        waited_s = time_s - self.seen.time_s - self.period_s
        return waited_s if waited_s > _RESOLUTION_S else 0.0

    def assumed_at(self, time_s: float, deceleration_m_s2: float) -> LeaderState | None:
        """Return the vehicle ahead at a trip time, not before it was seen; None for a free lane.

        Until the next measurement is due it keeps a measured deceleration; then it brakes.

        Args:
            deceleration_m_s2: hardest deceleration that is possible, positive.
        """
        if self.seen is None:
            return None
        unseen_s = self.unseen_s(time_s)
        braking_m_s2 = max(-self.acceleration_m_s2, 0.0)
        lead = slowed(self.seen, braking_m_s2, time_s - self.seen.time_s - unseen_s)
        if self.ghost:
            hidden_s = min(unseen_s, GHOST_S)
            hidden_m_s2 = min(HIDDEN_DECELERATION_M_S2, deceleration_m_s2)
            lead = slowed(lead, max(braking_m_s2, hidden_m_s2), hidden_s)
            unseen_s -= hidden_s
        if unseen_s:
            lead = slowed(lead, max(braking_m_s2, deceleration_m_s2), unseen_s)
        return replace(lead, time_s=time_s)


def slowed(lead: LeaderState, deceleration_m_s2: float, duration_s: float) -> LeaderState:
    """Return a vehicle that has braked for a while, to standstill at most."""
    if deceleration_m_s2 > 0.0:
        duration_s = min(duration_s, lead.speed_m_s / deceleration_m_s2)
    moved_m = duration_s * (lead.speed_m_s - 0.5 * deceleration_m_s2 * duration_s)
    speed_m_s = max(lead.speed_m_s - deceleration_m_s2 * duration_s, 0.0)
    return LeaderState(lead.time_s + duration_s, lead.position_m + moved_m, speed_m_s)


def clear_lane(time_s: float) -> LeaderPreview:
    """Return what a source reports that sees a lane without any vehicle: one at no distance that matters."""
    return LeaderPreview(np.array([time_s]), np.array([FREE_POSITION_M]), np.array([0.0]))


def followed(track: LeadTrack, sample: Sample) -> LeadTrack:
    """Return a track after one more measurement; one of an instant before begins a new track."""
    if sample.position_m >= FREE_POSITION_M:
        return LeadTrack(period_s=track.period_s)
    if track.recent and sample.time_s < track.recent[-1][0] - _RESOLUTION_S:
        track = LeadTrack(period_s=track.period_s)
    if not track.recent or track.seen is None:
        return LeadTrack(seen=sample.lead, period_s=track.period_s, recent=(sample,))
    last = Sample._make(track.recent[-1])
    interval_s, change_m_s = sample.time_s - last.time_s, sample.speed_m_s - last.speed_m_s
    if interval_s <= _RESOLUTION_S:  # measured again
        return replace(track, seen=sample.lead, recent=(*track.recent[:-1], sample))
    recent, period_s = (*track.recent[1 - KEPT :], sample), min(interval_s, LONGEST_PERIOD_S)
    first = _frozen_since(recent, sample)
    moved_m = sample.position_m - last.position_m
    farther_m = moved_m - 0.5 * (last.speed_m_s + sample.speed_m_s) * interval_s
    jumped = (abs(farther_m) > ANOTHER_LEAD_M and not _goes_on(track, farther_m)) or abs(
        change_m_s
    ) > ANOTHER_LEAD_M_S + ANOTHER_LEAD_M_S2 * interval_s
    if first is None and not (track.frozen or jumped):
        unexplained_m = unexplained_change(moved_m, last.speed_m_s, sample.speed_m_s, interval_s)
        unexplained = track.unexplained.after(unexplained_m, interval_s, RANGE_TIME_S)
        away_m, until_s = track.away_m, track.away_until_s
        if sample.time_s > until_s:
            away_m = 0.0
        is_back = away_m > 0.0 and unexplained_m < -RANGE_LIMIT_M
        if (unexplained_m > RANGE_LIMIT_M or is_back) and unexplained.beyond(RANGE_LIMIT_M):
            away_m, until_s = max(away_m + unexplained_m, 0.0), sample.time_s + AWAY_S
            unexplained = replace(unexplained, value=0.0)
        return LeadTrack(
            sample.lead,
            change_m_s / interval_s if interval_s <= LARGEST_MEASURING_INTERVAL_S else 0.0,
            period_s,
            ghost=track.ghost,
            sound_steps=track.sound_steps,
            recent=recent,
            before=track.before,
            appeared_s=track.appeared_s,
            unexplained=unexplained,
            away_m=away_m,
            away_until_s=until_s,
        )
    track = replace(track, recent=recent, period_s=period_s, empty_since_s=math.nan)
    if first is not None:
        return _as_frozen(track, first)
    return _stepped(track, last, sample, farther_m, jumped=jumped)


def _goes_on(track: LeadTrack, farther_m: float) -> bool:
    """Return whether the position contradicted the speed in the same direction before: no other vehicle."""
    if track.unexplained.beyond(RANGE_LIMIT_M) * farther_m > 0.0:
        return True
    if len(track.recent) < 2:
        return False
    before, last = (Sample._make(entry) for entry in track.recent[-2:])
    interval_s = last.time_s - before.time_s
    moved_m = last.position_m - before.position_m
    before_m = moved_m - 0.5 * (before.speed_m_s + last.speed_m_s) * interval_s
    return abs(before_m) > ANOTHER_LEAD_M and before_m * farther_m > 0.0


def _stepped(
    track: LeadTrack, last: Sample, sample: Sample, farther_m: float, *, jumped: bool
) -> LeadTrack:
    """Return a track after a measurement that repeats no other one, but jumps or follows a frozen one."""
    interval_s, change_m_s = sample.time_s - last.time_s, sample.speed_m_s - last.speed_m_s
    if track.frozen:
        moved_m = sample.position_m - last.position_m
        repeated = abs(moved_m) < IDENTICAL_M and sample.speed_m_s > MOVING_M_S
        steps = 0 if jumped or repeated else track.sound_steps + 1
        if steps < _needed_steps(track, sample, interval_s):
            return replace(track, sound_steps=steps)
        track = replace(track, frozen=False, ghost=False, sound_steps=0, before=None)
    if jumped:
        is_new = sample.time_s - track.appeared_s <= GHOST_S
        if is_new and abs(change_m_s) <= IDENTICAL_M_S and farther_m > 0.0:
            without = _without_newest(track, sample.speed_m_s)
            if without.ghost:
                return without
        away_m = 0.0
        if abs(change_m_s) <= SAME_SPEED_M_S:
            away_m = max(track.away_m + farther_m, 0.0)
        return replace(
            track,
            seen=sample.lead,
            acceleration_m_s2=0.0,
            before=track.seen,
            appeared_s=sample.time_s,
            unexplained=Residual(),
            away_m=away_m if away_m <= LARGEST_AWAY_M else 0.0,
            away_until_s=sample.time_s + AWAY_S,
        )
    acceleration = 0.0
    if interval_s <= LARGEST_MEASURING_INTERVAL_S:
        acceleration = change_m_s / interval_s
    return replace(track, seen=sample.lead, acceleration_m_s2=acceleration)


def emptied(track: LeadTrack, time_s: float) -> LeadTrack:
    """Return a track after an empty lane was reported; a free one if it has been empty for long enough."""
    if track.seen is None:
        return track
    if math.isnan(track.empty_since_s):
        return replace(track, empty_since_s=time_s)
    confirmed = time_s - track.empty_since_s >= CONFIRMED_FREE_S - _RESOLUTION_S
    return LeadTrack(period_s=track.period_s) if confirmed else track


def _frozen_since(recent: Sequence[tuple[float, ...]], sample: Sample) -> Sample | None:
    """Return the measurement that a sensor repeats with the newest one, None if it does not repeat any.

    Three in a row are frozen when a change is missing that the sensor would have shown; an earlier one
    that comes back after a large change is, too.
    """
    time_s, position_m, speed_m_s, own_m, own_m_s = sample
    for entry in recent[:-1]:
        if not abs(entry[2] - speed_m_s) > IDENTICAL_M_S:
            break
    else:
        return None
    gap_m, run, unbroken = position_m - own_m, 0, True
    first: Sample | None = None
    for entry in reversed(recent[:-1]):
        then_s, then_m, then_m_s, then_own_m, _ = entry
        if abs(then_m_s - speed_m_s) > IDENTICAL_M_S:
            unbroken = False
            continue
        elapsed_s = time_s - then_s
        expected_m = 0.0
        repeated = False
        if abs(gap_m - then_m + then_own_m) < IDENTICAL_M and max(own_m_s, speed_m_s) > MOVING_M_S:
            repeated, expected_m = True, abs(speed_m_s * elapsed_s - (own_m - then_own_m))
        if abs(position_m - then_m) < IDENTICAL_M:
            repeated = True
            if speed_m_s > MOVING_M_S:
                expected_m = max(expected_m, speed_m_s * elapsed_s)
        if not repeated:
            unbroken = False
            continue
        run += unbroken
        missing_m = expected_m - (0.0 if unbroken and run >= 2 else ANOTHER_LEAD_M)
        if missing_m > FROZEN_CHANGE_M and missing_m > FROZEN_CHANGE_M + _rounding_m(
            recent, speed_m_s, elapsed_s
        ):
            first = Sample(*entry)
    return first


def _rounding_m(recent: Sequence[tuple[float, ...]], speed_m_s: float, elapsed_s: float) -> float:
    """Return by how much the change of a gap may be off where a sensor rounds gap and speed."""
    coarsest_m = max(resolution(position_m - own_m) for _, position_m, _, own_m, _ in recent)
    return 2.0 * coarsest_m + resolution(speed_m_s) * elapsed_s


def resolution(value: float) -> float:
    """Return the coarsest of `RESOLUTIONS` that divides a value, 0 for none."""
    for step in RESOLUTIONS:
        if abs(value - step * round(value / step)) < IDENTICAL_M:
            return step
    return 0.0


def _as_frozen(track: LeadTrack, first: Sample) -> LeadTrack:
    """Return a track whose sensor repeats itself since a measurement; before that it was sound.

    A vehicle that appeared with that measurement has never been there.
    """
    if track.frozen:
        return replace(track, sound_steps=0)
    if track.before is not None and first.time_s <= track.appeared_s + _RESOLUTION_S:
        return _without_newest(track, first.speed_m_s)
    return replace(track, frozen=True, sound_steps=0, seen=first.lead, acceleration_m_s2=0.0)


def _without_newest(track: LeadTrack, speed_m_s: float) -> LeadTrack:
    """Return a track whose newest vehicle, with its speed, has never been there: the one before counts.

    At another speed it was a ghost; at the same one it was that vehicle, measured in a wrong place.
    """
    seen = track.before
    ghost = seen is not None and abs(speed_m_s - seen.speed_m_s) > ANOTHER_LEAD_M_S
    frozen = replace(track, frozen=True, ghost=ghost, sound_steps=0, seen=seen)
    return replace(frozen, acceleration_m_s2=0.0)


def _needed_steps(track: LeadTrack, sample: Sample, interval_s: float) -> int:
    """Return the steps that have to agree before a frozen sensor counts again.

    In place of a ghost, more than for the vehicle that it has hidden.
    """
    seen = track.seen
    if not track.ghost or seen is None:
        return RECOVERED_STEPS
    elapsed_s = sample.time_s - seen.time_s
    nearest_m = slowed(seen, HIDDEN_DECELERATION_M_S2, elapsed_s).position_m - ANOTHER_LEAD_M
    farthest_m = slowed(seen, -HIDDEN_DECELERATION_M_S2, elapsed_s).position_m + ANOTHER_LEAD_M
    if nearest_m <= sample.position_m <= farthest_m:
        return RECOVERED_STEPS
    return max(RECOVERED_STEPS, math.ceil(GHOST_CONFIRMED_S / interval_s))
