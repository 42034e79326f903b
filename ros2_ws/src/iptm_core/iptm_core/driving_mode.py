"""Who drives a car that carries the suite."""

from __future__ import annotations

from iptm_core.declaration import TextEnum


class DrivingMode(TextEnum):
    """Who drives; `vehicle/engagement` carries the position in this list, counted from 0."""

    OFF = "off"
    READY = "ready"
    ENGAGED = "engaged"
    OVERRIDDEN = "overridden"
    HAND_OVER = "hand_over"

    @property
    def number(self) -> float:
        """Position in the list."""
        return float(list(DrivingMode).index(self))
