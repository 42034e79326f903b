"""The vehicle ahead as its own messages place it, beside what a range sensor measures.

Where the two differ by more than both can be wrong, the nearer and slower one counts. Messages that
contradict each other, as repeated ones do, show nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_core.signal_residuals import JUMP_M, unexplained_change
from iptm_core.state import SPEED_AT_REST_M_S, LeaderPreview, LeaderState

FRESH_S = 1.5
"""Age up to which a preview shows where the vehicle ahead is."""
FARTHEST_OFF_M, FASTEST_OFF_M_S = 4.0, 3.0
"""Differences up to which both sources are right: satellite positions, and a preview's stated noise twice."""
LONGEST_SILENCE_S = 5.0
"""Messages farther apart are not compared."""
GAINED_M_S2 = 1.5
"""By as much a vehicle may be faster for each second since its message, and farther: half of what cars do."""


@dataclass(frozen=True)
class RadioLead:
    """Where the newest preview places the vehicle ahead; it goes on at its speed.

    Attributes:
        time_s: trip time for which position and speed hold.
        age_s: of the preview then.
        bound_m: by how much the position may be off beyond its usual error.
    """

    time_s: float
    position_m: float
    speed_m_s: float
    age_s: float = 0.0
    bound_m: float = 0.0

    @classmethod
    def of(cls, preview: LeaderPreview, time_s: float) -> RadioLead | None:
        """Return the vehicle at a trip time, None where the preview shows nothing about it."""
        if not min(preview.times_s.size, preview.positions_m.size, preview.speeds_m_s.size):
            return None
        speed_m_s, age_s = preview.speeds_m_s.item(0), time_s - preview.times_s.item(0)
        position_m = preview.positions_m.item(0) + speed_m_s * age_s
        if not (0.0 <= age_s <= FRESH_S and math.isfinite(position_m)):
            return None
        if speed_m_s < SPEED_AT_REST_M_S:
            return None
        bound_m = preview.bounds_m.item(0) if preview.bounds_m.size else 0.0
        return cls(time_s, position_m, max(speed_m_s, 0.0), age_s, bound_m)

    def follows(self, before: RadioLead) -> bool:
        """Return whether both messages can be of one vehicle that moves as they state."""
        elapsed_s = self.time_s - before.time_s
        if not 0.0 < elapsed_s <= LONGEST_SILENCE_S:
            return False
        moved_m = self.position_m - before.position_m
        rates = before.speed_m_s, self.speed_m_s
        return abs(unexplained_change(moved_m, *rates, elapsed_s)) <= JUMP_M + self.bound_m

    def at(self, time_s: float) -> LeaderState:
        """Return the vehicle at a trip time."""
        moved_m = self.speed_m_s * (time_s - self.time_s)
        return LeaderState(time_s, self.position_m + moved_m, self.speed_m_s)

    def nearer_and_slower(
        self,
        lead: LeaderState,
        off_m: float = FARTHEST_OFF_M,
        off_m_s: float = FASTEST_OFF_M_S,
    ) -> LeaderState:
        """Return the vehicle that counts; the measured one, the same object, where both agree.

        Args:
            off_m: difference of the positions up to which they agree, beyond the bound.
            off_m_s: the same of the speeds.
        """
        by_radio = self.at(lead.time_s)
        old_s = self.age_s + max(lead.time_s - self.time_s, 0.0)
        gained_m_s = GAINED_M_S2 * old_s
        off_m += self.bound_m + 0.5 * gained_m_s * old_s
        is_nearer = lead.position_m - by_radio.position_m > off_m
        is_slower = lead.speed_m_s - self.speed_m_s > off_m_s + gained_m_s
        if not (is_nearer or is_slower):
            return lead
        return LeaderState(
            lead.time_s,
            by_radio.position_m if is_nearer else lead.position_m,
            min(lead.speed_m_s, self.speed_m_s),
        )

    def agrees_with(self, samples: LeaderPreview) -> bool:
        """Return whether measurements of an interval surely agree; False where some may not."""
        if not samples.times_s.size:
            return False
        elapsed_s = samples.times_s - self.time_s
        farther_m = samples.positions_m - self.position_m - self.speed_m_s * elapsed_s
        return bool(
            farther_m.max() <= FARTHEST_OFF_M + self.bound_m
            and samples.speeds_m_s.max() - self.speed_m_s <= FASTEST_OFF_M_S
        )
