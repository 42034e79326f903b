"""The lead vehicle from range sensor and radio, cross-checked: neither is trusted alone.

The safety monitor of the vehicle follows it with measurements of its own (`iptm_core.lead_track`). Where
range sensor and radio differ by more than both can be wrong, the nearer and the slower one counts; where
messages are not authenticated, for as long as that has cost no more than `LARGEST_LOSS_M_S`. A radio that
contradicts itself, is old or places the lead vehicle behind the ego vehicle is not compared.

Without a radio a range sensor that shows a constant speed for longer than traffic drives at one may repeat
itself within its noise. Then the distance is opened in comfort, until the speed moves: a gap that is repeated
does not open with it, which shows.

A message cannot arrive before it was sent. One that seems to proves that the clock of its sender is ahead by
at least as much; what is left is the time that the fastest message took. Clocks that differ by more than
`LARGEST_OFFSET_S` were never set, and their previews are refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from iptm_core.braking import (
    SLIPPERY_LEAD_SHARE,
    RadioSettings,
    RoadFrictionSettings,
    SafetyMonitorSettings,
    SensorAccuracySettings,
    braking_capability,
    further_gap_m,
)
from iptm_core.frozen import replace
from iptm_core.lead_track import MOVING_M_S, LeadTrack, Sample, followed
from iptm_core.parameters.model import BrakeParameters, GapParameters, LimitParameters
from iptm_core.radio_lead import RadioLead
from iptm_core.signal_residuals import Contradiction
from iptm_core.state import (
    LeaderPreview,
    LeaderState,
    VehicleState,
)

LARGEST_POSITION_ERROR_M = 10.0
LARGEST_SPEED_ERROR_M_S = 6.0
"""Beyond these differences a preview belongs to another drive, or the range sensor is wrong. The latter is
four times the noise that the study of imperfect previews assumes."""
FROZEN = "the range sensor repeats a measurement"
LARGEST_LOSS_M_S = 5.0
"""Speed that is given up for messages that are not authenticated, with what is lost while braking ends; in
the tick of the decision and the next one up to 2 m/s more."""
FORGOTTEN_LOSS_S = 60.0
"""Time without a difference after which such messages may cost as much again."""
STILL_BAND_M_S, STILL_S = 0.06, 10.0
"""A speed that stays within this band, twice the noise of a good sensor, for this time is in doubt."""
OPENED_M_S, MOST_OPENED_M = 0.5, 10.0
"""Rate at which the distance is opened then, and how far."""
STEEP_SHARE, STEEP_M = 1.1, 2.0
"""Room above the distance at which the safety monitor brakes downhill."""
GAINS_M_S2 = 1.5
"""Own acceleration for which it still suffices there."""
_SLIPPERY_M_S2 = SafetyMonitorSettings.monitor_slippery_deceleration_m_s2
_REACTION_S = SafetyMonitorSettings.monitor_reaction_s
_OWN_M_S2 = SafetyMonitorSettings.monitor_own_deceleration_m_s2
_LEAD_M_S2 = SafetyMonitorSettings.monitor_lead_deceleration_m_s2


@dataclass(frozen=True)
class LeadMemory:
    """State carried from tick to tick: the lead vehicle by range sensor and by radio.

    Attributes:
        loss_from_m_s: own speed when messages that are not authenticated began to differ.
        differed_s: when they last did.
        still_m_s: lowest and highest speed measured since then.
        still_since_s: from when on the measured speed has not moved.
    """

    ranged: LeadTrack = field(default_factory=LeadTrack)
    radioed: RadioLead | None = None
    loss_from_m_s: float = 0.0
    differed_s: float = -math.inf
    still_m_s: tuple[float, float] = (0.0, 0.0)
    still_since_s: float = math.inf


class LeadCheck:
    """Compares the sources of the lead vehicle tick by tick, and allows for their stated accuracy."""

    def __init__(
        self,
        accuracy: SensorAccuracySettings,
        road: RoadFrictionSettings,
        limits: LimitParameters,
        gap: GapParameters | None = None,
        radio: RadioSettings | None = None,
        brakes: BrakeParameters | None = None,
    ) -> None:
        self.memory = LeadMemory()
        self.friction = road.road_friction
        self._gap, self._brakes = gap, brakes
        self._is_authenticated = (radio or RadioSettings()).authenticated_radio
        self._gap_m, self._speed_m_s = accuracy.gap_accuracy_m, accuracy.lead_speed_accuracy_m_s
        self._hardest_m_s2 = -limits.min_acceleration_m_s2
        self._jerk_m_s3 = limits.max_jerk_m_s3
        self._per_speed = 2.0 * math.sqrt(self._hardest_m_s2 * limits.max_acceleration_m_s2)

    def checked(
        self,
        state: VehicleState,
        leader: LeaderState | None,
        preview: LeaderPreview,
        *,
        is_free: bool,
    ) -> tuple[LeaderState | None, str]:
        """Return the lead vehicle that counts, None for one that is not measured, and the fault.

        Args:
            leader: as measured by range sensor, None if it is not.
            is_free: no vehicle is ahead.
        """
        if is_free:
            self.memory = LeadMemory()
            return None, ""
        memory = self.memory
        ranged, before = memory.ranged, memory.radioed
        own = state.position_m, state.speed_m_s
        heard = RadioLead.of(preview, state.time_s)
        if leader is not None:
            ranged = followed(
                ranged, Sample(leader.time_s, leader.position_m, leader.speed_m_s, *own)
            )
        self.memory = replace(memory, ranged=ranged, radioed=heard or before)
        if leader is None:
            return None, ""
        if ranged.frozen:
            return None, FROZEN
        counted = ranged.counted(leader)
        doubt = "" if counted is leader else Contradiction.RANGE.value
        if heard is None:
            return self._opened(counted), doubt
        fits = before is None or heard.time_s == before.time_s or heard.follows(before)
        if not fits or heard.position_m < state.position_m:
            return counted, doubt
        nearer = heard.nearer_and_slower(counted, LARGEST_POSITION_ERROR_M, LARGEST_SPEED_ERROR_M_S)
        if nearer is counted:
            return counted, doubt
        reason = (
            f"by radio the lead vehicle is {counted.position_m - heard.position_m:.1f} m nearer and "
            f"{counted.speed_m_s - heard.speed_m_s:.1f} m/s slower than measured; "
        )
        if self._is_authenticated or self._may_lose(state):
            return nearer, reason + "the nearer and slower one counts"
        return (
            counted,
            reason + "not authenticated, it has cost enough speed; the measured one counts",
        )

    def _may_lose(self, state: VehicleState) -> bool:
        """Return whether messages that are not authenticated may brake the vehicle in this tick."""
        memory = self.memory
        if not 0.0 <= state.time_s - memory.differed_s <= FORGOTTEN_LOSS_S:
            memory = replace(memory, loss_from_m_s=state.speed_m_s)
        self.memory = replace(memory, differed_s=state.time_s)
        braking_m_s2 = min(state.acceleration_m_s2, 0.0)
        ends_m_s = state.speed_m_s - braking_m_s2 * braking_m_s2 / (2.0 * self._jerk_m_s3)
        return ends_m_s >= memory.loss_from_m_s - LARGEST_LOSS_M_S

    def _opened(self, leader: LeaderState) -> LeaderState:
        """Return a lead vehicle nearer the longer its speed has not moved, where no message confirms it."""
        low, high = self.memory.still_m_s
        low, high = min(low, leader.speed_m_s), max(high, leader.speed_m_s)
        since_s = self.memory.still_since_s
        if high - low > STILL_BAND_M_S or since_s > leader.time_s:
            low, high, since_s = leader.speed_m_s, leader.speed_m_s, leader.time_s
        self.memory = replace(self.memory, still_m_s=(low, high), still_since_s=since_s)
        still_s = leader.time_s - since_s - STILL_S
        if still_s <= 0.0 or leader.speed_m_s <= MOVING_M_S:
            return leader
        opened_m = min(OPENED_M_S * still_s, MOST_OPENED_M)
        return replace(leader, position_m=leader.position_m - opened_m)

    def cautious(
        self, leader: LeaderState, ego_speed_m_s: float, slope_rad: float = 0.0
    ) -> LeaderState:
        """Return a lead vehicle nearer by what its measurement may be off, and what the road asks for.

        Args:
            slope_rad: of the road at the ego vehicle, positive uphill.
        """
        further_m = self._gap_m + self._speed_m_s * ego_speed_m_s / self._per_speed
        if self.friction > 0.0:
            dry = braking_capability(_OWN_M_S2, _LEAD_M_S2)
            known = braking_capability(_OWN_M_S2, _LEAD_M_S2, self.friction)
            further_m += further_gap_m(ego_speed_m_s, known, dry)
        elif slope_rad < 0.0:
            further_m += self._steep_m(leader.speed_m_s, ego_speed_m_s, slope_rad)
        return replace(leader, position_m=leader.position_m - further_m) if further_m else leader

    def _steep_m(self, lead_m_s: float, own_m_s: float, slope_rad: float) -> float:
        """Return the distance that a steep descent asks for beyond the smallest gap.

        There the monitor allows for a slippery road, and would brake at gaps that are wide enough elsewhere.
        """
        gap, brakes = self._gap, self._brakes
        if gap is None or brakes is None:
            return 0.0
        steep_m, level_m = (
            self._slippery_m(lead_m_s, own_m_s, along_rad, brakes) for along_rad in (slope_rad, 0.0)
        )
        closing_m = own_m_s * (own_m_s - lead_m_s) / self._per_speed
        smallest_m = gap.standstill_gap_m + gap.time_headway_s * own_m_s + closing_m
        return max(
            STEEP_SHARE * steep_m + STEEP_M - max(smallest_m, STEEP_SHARE * level_m + STEEP_M), 0.0
        )

    @staticmethod
    def _slippery_m(
        lead_m_s: float, own_m_s: float, slope_rad: float, brakes: BrakeParameters
    ) -> float:
        both = braking_capability(
            _SLIPPERY_M_S2, SLIPPERY_LEAD_SHARE * _SLIPPERY_M_S2, 0.0, slope_rad
        )
        wait_s = _REACTION_S + brakes.delay_s + 0.5 * both.own_m_s2 / brakes.build_up_m_s3
        later_m_s = own_m_s + GAINS_M_S2 * wait_s
        own_m = 0.5 * (own_m_s + later_m_s) * wait_s + 0.5 * later_m_s * later_m_s / both.own_m_s2
        return max(own_m - 0.5 * lead_m_s * lead_m_s / both.lead_m_s2, 0.0)

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


@dataclass(frozen=True)
class ClockMemory:
    """State carried from tick to tick: the largest offset that showed, and when it last did."""

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
"""The same for plans that are drawn to a desired headway, of a leader that speeds up. A longer one predicts
better and saves less there: with little room a wrong guess costs more than a late one, and equipped cars
behind each other amplify it."""
BRIEF_BRAKING_DECAY_S = 20.0
"""The same of a leader that brakes: braking is taken to go on. With little room above s_min, a plan that
expects its end breaks s_min for as long as the leader brakes, and brakes harder for it in the end."""
ACCELERATION_WINDOW_S = 1.0
"""The acceleration is the least-squares slope of the speeds in this window, of at least two samples."""
LARGEST_ACCELERATION_M_S2 = 10.0
"""More than tyres transmit: a larger change of the measured speed is not the motion of one vehicle."""
RANGE_ERROR_M = 1.0
"""A position jump larger than this, beyond what the speeds explain, means that another vehicle leads."""
EXTRAPOLATED_DECAYS = 5.0
SHORTEST_STOP_S = 1e-3
EXTRAPOLATED_NODES = 41


def unpredicted_s(gap: GapParameters) -> tuple[float, float]:
    """Return the decay times of a measured acceleration without a prediction: speeding up, and braking."""
    if gap.desired_time_headway_s:
        return BRIEF_DECAY_S, BRIEF_BRAKING_DECAY_S
    return ACCELERATION_DECAY_S, ACCELERATION_DECAY_S
