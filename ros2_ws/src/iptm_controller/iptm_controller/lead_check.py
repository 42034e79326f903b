"""The lead vehicle as the inputs of the controller show it: range sensor and radio, neither trusted alone.

The safety monitor of the vehicle follows it with measurements of its own (`iptm_core.lead_track`). Where
range sensor and radio differ by more than both can be wrong, the nearer and the slower one counts. A radio
that repeats itself, is old or places the lead vehicle behind the ego vehicle is not compared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from iptm_core.lead_track import LeadTrack, Sample, followed
from iptm_core.monitor_settings import SafetyMonitorSettings, SensorAccuracySettings
from iptm_core.parameters.model import LimitParameters
from iptm_core.road_friction import (
    RoadFrictionSettings,
    braking_capability,
    further_gap_m,
)
from iptm_core.state import SPEED_AT_REST_M_S, LeaderPreview, LeaderState, VehicleState

FRESH_S = 1.5
"""Age up to which a preview shows where the lead vehicle is."""
LARGEST_POSITION_ERROR_M = 10.0
LARGEST_SPEED_ERROR_M_S = 6.0
"""Beyond these differences a preview belongs to another drive, or the range sensor is wrong. The latter is
four times the noise that the study of imperfect previews assumes."""
FROZEN = "the range sensor repeats a measurement"
_OWN_M_S2 = SafetyMonitorSettings.monitor_own_deceleration_m_s2
_LEAD_M_S2 = SafetyMonitorSettings.monitor_lead_deceleration_m_s2


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
            radioed = followed(radioed, Sample.of(radio, *own))
        if leader is not None:
            ranged = followed(ranged, Sample.of(leader, *own))
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
        speed_m_s, age_s = float(preview.speeds_m_s[0]), state.time_s - preview.generated_at_s
        position_m = float(preview.positions_m[0]) + speed_m_s * age_s
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
