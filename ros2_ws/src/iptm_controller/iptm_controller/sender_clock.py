"""The clock of who sends previews: by how much it is ahead, and previews by the own clock.

A message cannot arrive before it was sent. One that seems to proves that the clock of its sender is ahead by
at least as much; what is left is the time that the fastest message took. Clocks that differ by more than
`LARGEST_OFFSET_S` were never set, and their previews are refused.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from iptm_core.state import LeaderPreview

LARGEST_OFFSET_S = 0.5
"""Largest offset that is put right: clocks set by satellites or network are closer by far."""
FORGOTTEN_AFTER_S = 60.0
"""Time after which an offset that has not shown again is forgotten: another vehicle may send."""
_RESOLUTION_S = 1e-6


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
        ahead_s = preview.generated_at_s - now_s if preview.times_s.size else 0.0
        if _RESOLUTION_S < ahead_s <= LARGEST_OFFSET_S and ahead_s >= memory.ahead_s:
            memory = ClockMemory(ahead_s, now_s)
        self.memory = memory
        if not memory.ahead_s or ahead_s > LARGEST_OFFSET_S:
            return preview
        return replace(preview, times_s=preview.times_s - memory.ahead_s)
