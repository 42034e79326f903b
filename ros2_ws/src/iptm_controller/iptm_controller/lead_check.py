"""The lead vehicle from range sensor and radio, cross-checked: neither is trusted alone.

The safety monitor of the vehicle follows it with measurements of its own (`iptm_core.lead_track`). Where
range sensor and radio differ by more than both can be wrong, the nearer and the slower one counts. A radio
that repeats itself, is old or places the lead vehicle behind the ego vehicle is not compared.

A message cannot arrive before it was sent. One that seems to proves that the clock of its sender is ahead by
at least as much; what is left is the time that the fastest message took. Clocks that differ by more than
`LARGEST_OFFSET_S` were never set, and their previews are refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from iptm_core.braking import (
    RoadFrictionSettings,
    SafetyMonitorSettings,
    SensorAccuracySettings,
    braking_capability,
    further_gap_m,
)
from iptm_core.frozen import light, replace
from iptm_core.lead_track import LeadTrack, Sample, followed
from iptm_core.parameters.model import GapParameters, LimitParameters
from iptm_core.state import (
    SPEED_AT_REST_M_S,
    TOLERANCE_S,
    FloatArray,
    LeaderPreview,
    LeaderState,
    VehicleState,
)

FRESH_S = 1.5
"""Age up to which a preview shows where the lead vehicle is."""
LARGEST_POSITION_ERROR_M = 10.0
LARGEST_SPEED_ERROR_M_S = 6.0
"""Beyond these differences a preview belongs to another drive, or the range sensor is wrong. The latter is
four times the noise that the study of imperfect previews assumes."""
FROZEN = "the range sensor repeats a measurement"
_OWN_M_S2 = SafetyMonitorSettings.monitor_own_deceleration_m_s2
_LEAD_M_S2 = SafetyMonitorSettings.monitor_lead_deceleration_m_s2


@light
@dataclass(frozen=True)
class LeadMemory:
    """What is carried from tick to tick: the lead vehicle by range sensor and by radio."""

    ranged: LeadTrack = field(default_factory=LeadTrack)
    radioed: LeadTrack = field(default_factory=LeadTrack)


class LeadCheck:
    """Compares the sources of the lead vehicle tick by tick, and allows for their stated accuracy."""

    def __init__(
        self,
        accuracy: SensorAccuracySettings,
        road: RoadFrictionSettings,
        limits: LimitParameters,
    ) -> None:
        self.memory = LeadMemory()
        self.friction = road.road_friction
        self._gap_m, self._speed_m_s = accuracy.gap_accuracy_m, accuracy.lead_speed_accuracy_m_s
        self._hardest_m_s2 = -limits.min_acceleration_m_s2
        self._per_speed = 2.0 * math.sqrt(self._hardest_m_s2 * limits.max_acceleration_m_s2)

    def checked(
        self,
        state: VehicleState,
        leader: LeaderState | None,
        preview: LeaderPreview,
        *,
        is_free: bool,
    ) -> tuple[LeaderState | None, str]:
        """Return the lead vehicle that counts, None for one that is not measured, and what is wrong.

        Args:
            leader: as measured by range sensor, None if it is not.
            is_free: no vehicle is ahead.
        """
        if is_free:
            self.memory = LeadMemory()
            return None, ""
        ranged, radioed = self.memory.ranged, self.memory.radioed
        own = state.position_m, state.speed_m_s
        radio = self._radioed(state, preview)
        if radio is not None:
            radioed = followed(
                radioed, Sample(radio.time_s, radio.position_m, radio.speed_m_s, *own)
            )
        if leader is not None:
            ranged = followed(
                ranged, Sample(leader.time_s, leader.position_m, leader.speed_m_s, *own)
            )
        self.memory = LeadMemory(ranged, radioed)
        if leader is None:
            return None, ""
        if ranged.frozen:
            return None, FROZEN
        if radio is None or radioed.frozen or radio.position_m < state.position_m:
            return leader, ""
        slower_m_s = leader.speed_m_s - radio.speed_m_s
        nearer_m = leader.position_m - radio.position_m
        if slower_m_s <= LARGEST_SPEED_ERROR_M_S and nearer_m <= LARGEST_POSITION_ERROR_M:
            return leader, ""
        position_m = radio.position_m if nearer_m > LARGEST_POSITION_ERROR_M else leader.position_m
        slower = LeaderState(leader.time_s, position_m, min(leader.speed_m_s, radio.speed_m_s))
        return slower, (
            f"by radio the lead vehicle is {nearer_m:.1f} m nearer and {slower_m_s:.1f} m/s slower than "
            "measured; the nearer and slower one counts"
        )

    @staticmethod
    def _radioed(state: VehicleState, preview: LeaderPreview) -> LeaderState | None:
        """Return the lead vehicle as its newest preview began, moved on; None if that shows nothing."""
        sizes = preview.times_s.size, preview.positions_m.size, preview.speeds_m_s.size
        if not min(sizes):
            return None
        speed_m_s, age_s = preview.speeds_m_s.item(0), state.time_s - preview.times_s.item(0)
        position_m = preview.positions_m.item(0) + speed_m_s * age_s
        if not (0.0 <= age_s <= FRESH_S and math.isfinite(position_m)):
            return None
        if speed_m_s < SPEED_AT_REST_M_S:
            return None
        return LeaderState(state.time_s, position_m, max(speed_m_s, 0.0))

    def cautious(self, leader: LeaderState, ego_speed_m_s: float) -> LeaderState:
        """Return a lead vehicle nearer by what its measurement may be off, and what the road asks for."""
        further_m = self._gap_m + self._speed_m_s * ego_speed_m_s / self._per_speed
        if self.friction > 0.0:
            dry = braking_capability(_OWN_M_S2, _LEAD_M_S2)
            known = braking_capability(_OWN_M_S2, _LEAD_M_S2, self.friction)
            further_m += further_gap_m(ego_speed_m_s, known, dry)
        return replace(leader, position_m=leader.position_m - further_m) if further_m else leader

    @property
    def braking_share(self) -> float:
        """Share of the hardest ordinary braking that the road permits, 1 where friction is not known."""
        known = braking_capability(_OWN_M_S2, _LEAD_M_S2, self.friction)
        return min(known.own_m_s2 / self._hardest_m_s2, 1.0)

    def lost_leader(self, time_s: float) -> LeaderState | None:
        """Return a lead vehicle that is not measured any more, braking as hard as it can; None for none."""
        hardest_m_s2 = braking_capability(_OWN_M_S2, _LEAD_M_S2, self.friction).lead_m_s2
        return self.memory.ranged.assumed_at(time_s, hardest_m_s2)


LARGEST_OFFSET_S = 0.5
"""Largest offset that is put right: clocks set by satellites or network are closer by far."""
FORGOTTEN_AFTER_S = 60.0
"""Time after which an offset that has not shown again is forgotten: another vehicle may send."""
_RESOLUTION_S = 1e-6


@light
@dataclass(frozen=True)
class ClockMemory:
    """What is carried from tick to tick: the largest offset that showed, and when it last did."""

    ahead_s: float = 0.0
    shown_s: float = 0.0


class SenderClock:
    """Puts the times of previews right."""

    def __init__(self) -> None:
        self.memory = ClockMemory()

    def by_own_clock(self, preview: LeaderPreview, now_s: float) -> LeaderPreview:
        """Return a preview with the times of the own clock; the same one while no offset has shown.

        Args:
            preview: as received, possibly empty.
            now_s: trip time at which it is used.
        """
        memory = self.memory
        if now_s < memory.shown_s or now_s - memory.shown_s > FORGOTTEN_AFTER_S:
            memory = ClockMemory()
        ahead_s = preview.times_s.item(0) - now_s if preview.times_s.size else 0.0
        if _RESOLUTION_S < ahead_s <= LARGEST_OFFSET_S and ahead_s >= memory.ahead_s:
            memory = ClockMemory(ahead_s, now_s)
        self.memory = memory
        if not memory.ahead_s or ahead_s > LARGEST_OFFSET_S:
            return preview
        return replace(preview, times_s=preview.times_s - memory.ahead_s)


ACCELERATION_DECAY_S = 4.0
"""Time constant with which the lead vehicle's acceleration decays where nothing is predicted. In every
published cycle positions 3 to 8 s ahead are predicted better than at a constant speed, and over all of them
together better than with half or twice the constant (a test checks both)."""
BRIEF_DECAY_S = 1.0
"""The same for plans that are drawn to a desired headway. A longer one predicts better and saves less there:
with little room a wrong guess costs more than a late one, and equipped cars behind each other amplify it."""
ACCELERATION_WINDOW_S = 1.0
"""The acceleration is the least-squares slope of the speeds in this window, of at least two samples."""
LARGEST_ACCELERATION_M_S2 = 10.0
"""More than tyres transmit: a larger change of the measured speed is not the motion of one vehicle."""
RANGE_ERROR_M = 1.0
"""A position jump larger than this, beyond what the speeds explain, means that another vehicle leads."""
_EXTRAPOLATED_DECAYS = 5.0
_SHORTEST_STOP_S = 1e-3
EXTRAPOLATED_NODES = 41
_SHARES: FloatArray = np.arange(EXTRAPOLATED_NODES) / (EXTRAPOLATED_NODES - 1)


def measured_acceleration_m_s2(measured: Sequence[LeaderState]) -> float:
    """Return the leader's acceleration from its speeds of the last second, 0 without enough of them.

    Args:
        measured: leader at increasing times, the newest one last. Where a measurement is missing, the one
            before counts instead.
    """
    if len(measured) < 2:
        return 0.0
    last, before = measured[-1], measured[-2]
    passed_s, changed_m_s = last.time_s - before.time_s, last.speed_m_s - before.speed_m_s
    moved_m = last.position_m - before.position_m
    unexplained_m = abs(moved_m - 0.5 * passed_s * (last.speed_m_s + before.speed_m_s))
    if unexplained_m > 0.5 * passed_s * abs(changed_m_s) + RANGE_ERROR_M:
        return 0.0
    since_s = min(last.time_s - ACCELERATION_WINDOW_S - TOLERANCE_S, before.time_s)
    recent = [state for state in measured if state.time_s >= since_s]
    mean_s = moment = spread = 0.0
    for state in recent:
        mean_s += state.time_s
    mean_s /= len(recent)
    for state in recent:
        moment += (state.time_s - mean_s) * state.speed_m_s
        spread += (state.time_s - mean_s) * (state.time_s - mean_s)
    slope_m_s2 = moment / spread
    return slope_m_s2 if abs(slope_m_s2) <= LARGEST_ACCELERATION_M_S2 else 0.0


def unpredicted_s(gap: GapParameters) -> tuple[float, float]:
    """Return time constants of a leader without a prediction: of its return, and of its acceleration.

    The first is `gap.leader_return_s`, the second the one with which the measured acceleration decays.
    """
    return (
        gap.leader_return_s,
        BRIEF_DECAY_S if gap.desired_time_headway_s else ACCELERATION_DECAY_S,
    )


def extrapolated_motion(
    leader: LeaderState, acceleration_m_s2: float, decay_s: float = ACCELERATION_DECAY_S
) -> LeaderPreview:
    """Return how a leader goes on of which only the present is known.

    Its acceleration dies away exponentially, which is what to expect of one that varies as a first-order
    Gauss-Markov process (R. A. Singer, Estimating optimal tracking filter performance for manned
    maneuvering targets, IEEE Transactions on Aerospace and Electronic Systems 6, 1970). It never drives
    backwards.

    Args:
        acceleration_m_s2: as measured, negative when braking.
        decay_s: time constant of its decay.
    """
    change_m_s, shares = decay_s * acceleration_m_s2, _SHARES
    until_s = _EXTRAPOLATED_DECAYS * decay_s
    if leader.speed_m_s + change_m_s < 0.0:
        stop_s = -decay_s * math.log1p(leader.speed_m_s / change_m_s)
        until_s = min(until_s, stop_s)
        if stop_s < _SHORTEST_STOP_S:
            shares = shares[:1]
    elapsed_s = until_s * shares
    gone = -np.array([math.expm1(each) for each in (-elapsed_s / decay_s).tolist()])
    speeds_m_s = np.maximum(leader.speed_m_s + change_m_s * gone, 0.0)
    moved_m = leader.speed_m_s * elapsed_s + change_m_s * (elapsed_s - decay_s * gone)
    return LeaderPreview(leader.time_s + elapsed_s, leader.position_m + moved_m, speeds_m_s)
